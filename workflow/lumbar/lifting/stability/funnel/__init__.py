"""Basins of attraction as funnels: the exact method, the thesis's alternation, a better V, checks by simulation and by proof."""
