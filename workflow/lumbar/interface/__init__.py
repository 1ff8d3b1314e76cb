"""Functions of `lumbar` on objects, which commands, scripts and notebooks call."""
