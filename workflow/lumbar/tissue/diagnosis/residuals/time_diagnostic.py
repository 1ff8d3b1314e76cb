"""Where along a record a model fails: by period or window of time, and whether the error changes."""

from __future__ import annotations

import numpy as np

from lumbar.tissue.diagnosis.noise.noise_spectrum import excess
from lumbar.tissue.diagnosis.noise.nonrepeating import remove_structure
from lumbar.tissue.diagnosis.residuals.residual import SIGNIFICANT, Residual
from lumbar.tissue.diagnosis.residuals.residual_diagnostic import View, percent, probability

_WINDOWS = 10
_LEAST_CYCLE = 0.5
"""Share of a window below which a rest of the record is no window of its own."""


def time_view(residual: Residual) -> View:
    """RMS and mean of the residual by period or window, with tests for a trend of each.

    Columns ``start``, ``stop`` (s), ``rms``, ``mean`` and ``deviation`` of the mean under noise.
    """
    edges = _edges(residual)
    groups = np.searchsorted(edges, np.arange(len(residual.values)), side="right") - 1
    count = len(edges)
    average = residual.averages(groups, count)
    rms = np.sqrt(np.bincount(groups, residual.values**2, count) / average.count)
    stops = np.append(edges[1:], len(residual.values)) - 1
    slope, slope_p = level_trend(residual)
    rms_p = mann_kendall_p(rms)
    table = {
        "start": residual.time[edges],
        "stop": residual.time[stops],
        "rms": rms,
        "mean": average.mean,
        "deviation": average.deviation,
    }
    numbers = {"level_slope": slope, "level_p": slope_p, "rms_trend_p": rms_p}
    unit = residual.unit
    spread = f"RMS from {rms.min():.3g} to {rms.max():.3g} {unit} over {count} {_word(residual, count)}"
    trend = f"{'no trend' if rms_p > 0.05 else ('it rises' if rms[-1] > rms[0] else 'it falls')} ({probability(rms_p)})"
    if residual.folding is None:
        significant = average.p_value < SIGNIFICANT
        level = (
            f"the mean error changes from window to window by more than noise would: {_counted(average.share)} of the "
            f"{residual.base_words}"
            if significant
            else "the mean error of the windows is no more than chance"
        )
        sentence = (
            f"Along time: {spread}, {trend}; {level}. Without a repeating input time cannot be told from what the input "
            "does at that time."
        )
        share = average.share if significant else 0.0
        return View("time", share, average.p_value, sentence, table, numbers)
    share, p_value = _not_repeating(residual)
    numbers |= {"not_repeating_share": share}
    change = slope * (residual.time[-1] - residual.time[0])
    if p_value >= SIGNIFICANT:
        sentence = (
            f"Along time: the error repeats with the input; {spread}, {trend}. Nothing depends on time alone."
        )
    else:
        level = (
            f", its level changes by {change:+.3g} {unit} over the record" if slope_p < SIGNIFICANT else ""
        )
        sentence = (
            f"Along time: {percent(share)} of the {residual.base_words} does not repeat with the input{level}; {spread}, "
            f"{trend}. What does not repeat depends on time or history: a drift, a stiffness that changes, a "
            "disturbance at a frequency of its own."
        )
    return View("time", share if p_value < SIGNIFICANT else 0.0, p_value, sentence, table, numbers)


def _counted(share: float) -> str:
    return percent(share) if share > 0 else "no more than of any smooth error, 0 %"


def _word(residual: Residual, count: int) -> str:
    word = "window" if residual.folding is None else "period"
    return word if count == 1 else f"{word}s"


def _edges(residual: Residual) -> np.ndarray:
    """First samples of the windows: whole periods counted from the end, or equal windows."""
    size = len(residual.values)
    if residual.folding is None:
        return np.linspace(0, size, min(_WINDOWS, size // 8) + 1).astype(int)[:-1]
    starts = residual.folding.rows[:, 0]
    if starts[0] > _LEAST_CYCLE * residual.folding.samples:
        return np.insert(starts, 0, 0)
    return np.insert(starts[1:], 0, 0)


def level_trend(residual: Residual) -> tuple[float, float]:
    """Slope of a straight line through the residual (unit/s), and its p-value under noise alone."""
    from scipy.special import ndtr

    centred = residual.time - residual.time.mean()
    weights = (centred / np.sum(centred**2))[None]
    slope = float(weights[0] @ residual.values)
    deviation = float(np.sqrt(residual.covariance(weights)[0, 0]))
    return slope, float(2 * ndtr(-abs(slope) / deviation)) if deviation > 0 else 1.0


def mann_kendall_p(values: np.ndarray) -> float:
    """Two-sided p-value of a monotonic trend (Mann, Econometrica 13, 1945), normal approximation."""
    from scipy.special import ndtr

    size = len(values)
    if size < 4:
        return 1.0
    score = np.sign(values[None, :] - values[:, None])[np.triu_indices(size, 1)].sum()
    deviation = np.sqrt(size * (size - 1) * (2 * size + 5) / 18)
    return float(min(1.0, 2 * ndtr(-max(abs(score) - 1, 0) / deviation)))


def _not_repeating(residual: Residual) -> tuple[float, float]:
    """Share of the residual's variance that differs between periods beyond noise, and its p-value.

    The periods after the transient tell whether there is any; where there is, what comes before them counts too.
    """
    from scipy.special import ndtr

    folding, noise = residual.folding, residual.floor.rms**2
    folded = folding.fold(residual.values)
    mean = folded.mean(axis=0)
    _, parts, _ = remove_structure(folded - mean, mean, folding.fold(residual.position).mean(axis=0))
    if not parts:
        return 0.0, 1.0
    energy = float(np.sum(sum(part.values for part in parts) ** 2))
    degrees = sum(part.degrees for part in parts)
    p_value = float(ndtr(-excess(energy / noise, degrees))) if noise > 0 else 0.0
    before = int(folding.rows[0, 0])
    transient = residual.values[:before] - mean[np.arange(-before, 0) % folding.samples]
    energy += max(float(np.sum(transient**2)) - before * noise * (1 + 1 / len(folded)), 0.0)
    return residual.share((energy - noise * degrees) / len(residual.values)), p_value
