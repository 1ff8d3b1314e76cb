"""One view of where a model fails: numbers for a figure, and a sentence."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class View:
    """Where the error is, seen along one thing."""

    name: str
    """E.g. ``"depth"``."""
    share: float
    """Share of the explainable error's variance that this view accounts for, the noise's part taken off. Views overlap:
    shares of several do not add up."""
    p_value: float
    """Probability that noise alone shows as much."""
    sentence: str
    """What is seen, with numbers, in plain English."""
    table: dict[str, np.ndarray]
    """Columns of equal length, as drawn."""
    numbers: dict = field(default_factory=dict)
    """Single figures behind the sentence."""


def percent(share: float) -> str:
    """Share in percent for a sentence."""
    if 0 < share < 0.001:
        return "less than 0.1 %"
    return f"{100 * share:.2g} %" if share < 0.095 else f"{100 * share:.0f} %"


def probability(p_value: float) -> str:
    """Probability for a sentence, e.g. ``"p = 0.03"``."""
    return "p < 0.0001" if p_value < 1e-4 else f"p = {p_value:.2g}"


def only(share: float) -> str:
    """Share with the word that puts a small one in its place."""
    return f"only {percent(share)}" if share < 0.1 else percent(share)
