"""Synthetic recordings in the formats of a laboratory."""
