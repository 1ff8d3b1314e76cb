"""Sections of a configuration: one pydantic model per section with type, default, limits, unit and meaning of each key."""
