"""Basins compared: Table 4.1, its controls and verdicts."""
