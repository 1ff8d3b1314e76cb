"""Basins of attraction as funnels: the exact method, limits, a better V, and their checks by simulation and by proof."""
