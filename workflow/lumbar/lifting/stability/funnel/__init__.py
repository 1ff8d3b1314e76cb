"""Basins of attraction as funnels, the exact method, and their check by simulation."""
