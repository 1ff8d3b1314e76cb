"""The closed loop of eqs 4.1 to 4.3: trajectory, regulator, saturation."""
