"""Records with the force as input and the motion as output: fitted, searched and judged in the unit of the motion."""
