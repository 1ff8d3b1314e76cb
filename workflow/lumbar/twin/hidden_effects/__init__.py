"""Synthetic tissue tests with a hidden physical effect, made without any code that later looks for it."""
