"""Scores of the diagnosis on experiments whose hidden effect is known."""
