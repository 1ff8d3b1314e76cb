"""The closed loop of Eqs 4.1–4.3: trajectory, regulator, limits of the torque."""
