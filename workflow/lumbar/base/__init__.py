"""Base of all packages: errors, files, YAML, progress, templates, the environment."""
