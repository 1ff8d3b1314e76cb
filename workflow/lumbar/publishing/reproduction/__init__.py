"""The thesis's claims, one by one, against what a run shows."""
