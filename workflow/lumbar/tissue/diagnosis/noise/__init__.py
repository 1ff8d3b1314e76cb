"""Noise of a record: its floor, its colour, and the parts that do not repeat and are not noise."""
