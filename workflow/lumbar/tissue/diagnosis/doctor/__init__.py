"""What could have been seen in records: effects and faults put into them at falling strength, and diagnosed blind."""
