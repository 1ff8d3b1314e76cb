"""Records of several axes: their data for fits, the symmetry of their tissue, what their diagnosis is."""
