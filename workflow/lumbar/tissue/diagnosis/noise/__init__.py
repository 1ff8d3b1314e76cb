"""What of a record is noise: its floor, its colour, and what does not repeat."""
