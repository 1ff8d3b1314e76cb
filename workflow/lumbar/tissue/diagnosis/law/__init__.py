"""Search of a short formula for a missing force that no effect of the catalogue explains."""
