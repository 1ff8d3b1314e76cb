"""What is wrong with the sensors and their clocks, told from the records alone, and how it is repaired."""
