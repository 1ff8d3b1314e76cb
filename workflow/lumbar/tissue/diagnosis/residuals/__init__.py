"""How large a simulation's error is, and where a model fails."""
