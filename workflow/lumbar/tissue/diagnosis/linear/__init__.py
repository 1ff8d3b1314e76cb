"""Linear dynamics of higher order, the nonlinear share of an error, and detection of exchanged input and output."""
