"""Detection of faults of sensors and clocks from records, and repair of the records."""
