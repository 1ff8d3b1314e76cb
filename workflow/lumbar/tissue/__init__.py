"""Soft tissue: from excitations through models, effects and their diagnosis to FMUs, haptics and the survey."""
