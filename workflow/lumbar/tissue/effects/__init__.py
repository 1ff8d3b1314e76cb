"""The catalogue of physical effects: each defined once, for equation, simulation, fit and export."""
