"""Checks whether a marker recording can be a person's body: findings and quality reports."""
