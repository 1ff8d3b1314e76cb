"""Measures of a lift from its movement: balance over the feet, posture and load of the back."""
