"""Comparison of the thesis's claims with the results of a run."""
