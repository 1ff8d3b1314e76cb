"""Figures and pages of results, and comparison of the thesis's claims with a run."""
