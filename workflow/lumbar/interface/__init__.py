"""The verbs of `lumbar` on objects: what commands, scripts and notebooks call."""
