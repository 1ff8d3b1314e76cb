"""What every room stands on: errors, files, YAML, progress, templates, the environment."""
