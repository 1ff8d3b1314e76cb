"""Soft-tissue force-feedback models and lifting stability, from recordings to tables, figures and FMUs."""

__version__ = "0.1.0"
