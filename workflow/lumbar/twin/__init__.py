"""Synthetic recordings in the formats a laboratory would bring."""
