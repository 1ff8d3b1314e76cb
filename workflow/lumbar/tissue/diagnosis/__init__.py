"""Compare a model with measurements, locate where it fails, diagnose what is missing, refine it."""
