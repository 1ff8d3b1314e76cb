"""Measures that see movement: balance over the feet, posture and load of the back during a lift."""
