"""What a hand can tell: thresholds with their sources, and a difference of two forces in their units."""
