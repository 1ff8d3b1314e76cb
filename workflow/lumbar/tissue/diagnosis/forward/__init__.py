"""Records of which the force is the input and the motion the output: fitted, searched and judged in the unit of the motion."""
