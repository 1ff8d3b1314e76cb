"""Selection of missing effects: forward selection, ties, the verdict and its sentences."""
