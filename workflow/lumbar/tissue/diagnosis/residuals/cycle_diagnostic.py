"""In which cycles of the motion a model fails: large or fast ones, or all alike."""

from __future__ import annotations

import numpy as np

from lumbar.tissue.diagnosis.residuals.residual import SIGNIFICANT, Residual
from lumbar.tissue.diagnosis.residuals.residual_diagnostic import View, probability
from lumbar.tissue.diagnosis.residuals.state_diagnostics import reversals

_FEWEST_CYCLES = 8
_RELATED = 0.3
"""Rank correlation from which on a relation is worth telling, however significant."""


def cycle_view(residual: Residual) -> View:
    """RMS of the residual in every cycle of the motion, from one lower turning point to the next.

    Columns ``start``, ``stop`` (s), ``amplitude`` (half the stroke), ``speed`` (largest) and ``rms``.
    """
    turns, directions = reversals(residual.position)
    bounds = turns[directions > 0]
    if len(bounds) <= _FEWEST_CYCLES:
        words = f"Over cycles: the motion has {max(len(bounds) - 1, 0)}, too few to compare."
        return View("cycles", 0.0, 1.0, words, {name: np.zeros(0) for name in _COLUMNS})
    table = _cycles(residual, bounds)
    rms, unit = table["rms"], residual.unit
    with_amplitude, amplitude_p = rank_correlation(table["amplitude"], rms)
    with_speed, speed_p = rank_correlation(table["speed"], rms)
    p_value = min(1.0, 2 * min(amplitude_p, speed_p))  # Bonferroni
    low, high = np.quantile(rms, [0.1, 0.9])
    spread = f"in eight of ten of the motion's {len(rms)} cycles the error's RMS lies from {low:.3g} to {high:.3g} {unit}"
    numbers = {"cycles": len(rms), "rank_with_amplitude": with_amplitude, "rank_with_speed": with_speed}
    related = [
        f"{'grows' if rank > 0 else 'falls'} with their {name} (rank correlation {rank:+.2f}, {probability(p)})"
        for name, rank, p in (("amplitude", with_amplitude, amplitude_p), ("speed", with_speed, speed_p))
        if 2 * p < SIGNIFICANT and abs(rank) > _RELATED
    ]
    told = f"it {' and '.join(related)}" if related else "it hardly depends on their amplitude or speed"
    return View("cycles", 0.0, p_value, f"Over cycles: {spread}; {told}.", table, numbers)


_COLUMNS = ("start", "stop", "amplitude", "speed", "rms")


def _cycles(residual: Residual, bounds: np.ndarray) -> dict[str, np.ndarray]:
    """What `cycle_view` tabulates; `bounds` are the samples of the lower turning points."""
    inside = slice(bounds[0], bounds[-1])
    starts, lengths = bounds[:-1] - bounds[0], np.diff(bounds)
    position, speed = residual.position[inside], np.abs(residual.velocity[inside])
    stroke = np.maximum.reduceat(position, starts) - np.minimum.reduceat(position, starts)
    return {
        "start": residual.time[bounds[:-1]],
        "stop": residual.time[bounds[1:]],
        "amplitude": stroke / 2,
        "speed": np.maximum.reduceat(speed, starts),
        "rms": np.sqrt(np.add.reduceat(residual.values[inside] ** 2, starts) / lengths),
    }


def rank_correlation(first: np.ndarray, second: np.ndarray) -> tuple[float, float]:
    """Spearman's rank correlation and its two-sided p-value by Student's t; for values without ties.

    C. Spearman, Am. J. Psychol. 15 (1904) 72-101.
    """
    from scipy.special import stdtr

    ranks = [np.argsort(np.argsort(values)) for values in (first, second)]
    correlation = float(np.corrcoef(*ranks)[0, 1])
    degrees = len(first) - 2
    size = abs(correlation) * np.sqrt(degrees / max(1 - correlation**2, 1e-300))
    return correlation, float(2 * stdtr(degrees, -size))
