"""Chapters of a study."""

from __future__ import annotations

from typing import get_args

from lumbar.settings.study_settings import Chapter

CHAPTERS: tuple[str, ...] = get_args(Chapter)
NEEDS = {
    "signals": ["surgeon"],
    "improvement": ["tissue"],
    "runtime": ["tissue"],
    "stability": ["lifting"],
}
"""Chapters that build on another one of the same study."""
LIFTED = {"lifting", "population"}
"""Chapters that begin with the recorded lifts."""
