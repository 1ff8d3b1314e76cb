"""Figures of results, drawn from plain data."""
