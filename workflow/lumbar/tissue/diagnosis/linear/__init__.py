"""What linear dynamics of higher order explain, how much of an error is nonlinear, and which way round records are."""
