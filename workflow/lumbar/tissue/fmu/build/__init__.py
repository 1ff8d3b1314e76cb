"""From an identified model to an FMU: C code, description, libraries, package."""
