"""Recordings as validated tables with units, whatever the file format."""
