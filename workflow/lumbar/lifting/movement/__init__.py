"""From markers to pendulum states: gaps, filter, events, centres of mass, planes."""
