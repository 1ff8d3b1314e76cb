"""Ratings of the force-feedback models by participants."""
