"""Names of axes, without the settings that use them: programs that only read a file need no pydantic."""

AXES, SIDES = ("x", "y", "z"), ("input", "output")
"""Axes of a record, and the two sides of which roles name an axis, as in ``input_x``."""
