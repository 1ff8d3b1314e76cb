"""Viscoelastic models of soft tissue, their identification and their error metrics."""
