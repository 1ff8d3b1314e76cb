"""Basins of attraction: Riccati equation, funnels and their certificates."""
