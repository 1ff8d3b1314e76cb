"""Report of a study: one page with all its results, in the order of the thesis."""
