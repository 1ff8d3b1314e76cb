"""Mass, damping, dry friction and delay of a haptic device, from recordings of its stylus in the air."""
