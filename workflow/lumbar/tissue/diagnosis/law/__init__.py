"""A law for what no effect of the catalogue explains: the missing force estimated, and a short formula for it."""
