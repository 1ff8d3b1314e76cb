"""Chapters of a study."""

from __future__ import annotations

CHAPTERS = (
    "surgeon",
    "signals",
    "tissue",
    "improvement",
    "runtime",
    "survey",
    "lifting",
    "stability",
    "perturbations",
    "claims",
)
NEEDS = {"signals": ["surgeon"], "improvement": ["tissue"], "runtime": ["tissue"], "stability": ["lifting"]}
"""Chapters that build on another one of the same study."""
