"""The seed of bootstraps and simulations where none is given."""

SEED = 2023
