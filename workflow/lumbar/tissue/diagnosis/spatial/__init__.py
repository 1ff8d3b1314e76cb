"""Records of several axes: data for fits, symmetry of the tissue, and diagnosis."""
