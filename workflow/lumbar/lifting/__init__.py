"""People who lift: from marker recordings to centres of mass, basins of attraction and measures of balance."""
