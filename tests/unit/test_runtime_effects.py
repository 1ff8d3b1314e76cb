"""Models with effects: the C code against the step-by-step simulation in Python, bit for bit, and closed forms."""

from __future__ import annotations

SAMPLING_TIME = 0.01
