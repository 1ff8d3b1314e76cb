"""Checks of finished FMUs: schema, lint, simulation against a reference."""
