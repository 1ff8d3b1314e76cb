"""Export of identified models to the haptic runtime as FMUs."""
