"""Basins of attraction as funnels, the exact engine, and their check by simulation."""
