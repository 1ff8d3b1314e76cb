"""Ticks of a servo among the samples of an FMU: one, repeating ones, uneven ones."""
