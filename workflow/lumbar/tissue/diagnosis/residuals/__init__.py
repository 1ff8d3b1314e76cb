"""Size of a simulation's error, and location of the error."""
