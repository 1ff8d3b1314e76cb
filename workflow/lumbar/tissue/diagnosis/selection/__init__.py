"""Which effects are missing: forward selection, ties, the verdict and its sentences."""
