"""Proof by interval arithmetic that a funnel holds between its knots."""
