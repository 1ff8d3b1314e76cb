"""What differs between periods at the same places of the motion and lasts: drops, slips and tears, which are no noise.

Noise is as large at one phase of a period as at another. A tissue that breaks a little differently every time adds deviations
that repeat in no form, but come where the motion brings them about. They are told by the places: how large the deviations of
two periods are, phase by phase, is then related. Ranks are compared: spikes and heavy tails, which fall anywhere, do not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

CERTAIN = 6.0
"""Standard errors by which sizes must be related beyond what noise of any colour and distribution gives."""
LASTING = 0.25
"""Share of what neighbouring samples lack of a correlation of 1 where deviations are smallest that they lack less where they are
large. A sensor's noise that grows with the force, and a clock that trembles, make samples that differ but do not last."""
_FEWEST = 4
"""Periods whose differences, two by two, are independent of each other at the same phase."""
_QUIET = 0.25
"""Share of the phases that the noise is measured in: those where other periods spread least."""
_NEIGHBOURS = 5
"""Phases over which a spread is averaged."""
_LOUD = 2.5
"""Variance over that of the noise from which on a phase is not quiet."""


@dataclass(frozen=True, eq=False)
class Bursts:
    """Deviations that come at the same places of every period and last."""

    variance: float
    """Of the noise beside them, per sample."""
    quiet: np.ndarray
    """Shape (samples,): phases without them."""
    rms: float
    """Of them over the whole period, less the noise."""


def find_bursts(noise: np.ndarray, degrees: float) -> Bursts | None:
    """Tell deviations that the motion brings about from noise; None where there are none.

    Parameters
    ----------
    noise : numpy.ndarray, shape (periods, samples)
        Deviations of the periods from their mean.
    degrees : float
        Degrees of freedom that are left in them.
    """
    if len(noise) < _FEWEST or not np.any(noise) or relation_of_sizes(noise) <= CERTAIN:
        return None
    per_row = degrees / noise.size
    halves = noise[::2], noise[1::2]
    quietest = [_spread(rows) <= np.quantile(_spread(rows), _QUIET) for rows in halves]
    # Phases are chosen in some periods and measured in the others: the least of many spreads is no noise level.
    measured = [other[:, phases] for other, phases in zip(halves[::-1], quietest, strict=True)]
    variance = float(
        sum(np.sum(item**2) for item in measured) / (per_row * sum(item.size for item in measured))
    )
    quiet = _spread(noise) <= _LOUD * variance * per_row
    if variance <= 0 or not _last(noise, quiet):
        return None
    excess = float(np.mean(noise**2)) / per_row - variance
    return Bursts(variance, quiet, float(np.sqrt(excess))) if excess > 0 else None


def relation_of_sizes(noise: np.ndarray) -> float:
    """Standard errors by which the sizes of deviations at the same phase of different periods are related.

    Spearman's rank correlation of the sizes of differences between two periods each, over all pairs of such differences.
    Its standard error allows for sizes that resemble their neighbours (M. S. Bartlett, J. R. Stat. Soc. Suppl. 8 (1946) 27-41).

    Parameters
    ----------
    noise : numpy.ndarray, shape (periods, samples)
        Four periods at least.
    """
    count, samples = len(noise) // 2, noise.shape[1]
    sizes = np.abs(noise[: 2 * count : 2] - noise[1 : 2 * count : 2])
    ranks = np.stack([_ranks(row) for row in sizes]) - (samples + 1) / 2
    deviation = np.sqrt(np.mean(ranks**2, axis=1, keepdims=True))
    if not np.all(deviation > 0):
        return 0.0
    ranks /= deviation
    pairs = count * (count - 1) / 2
    together = (np.sum(ranks.sum(axis=0) ** 2) - np.sum(ranks**2)) / 2 / (pairs * samples)
    power = np.sum(np.abs(np.fft.rfft(ranks, axis=1)) ** 2, axis=0) / count
    own = np.fft.irfft(power, samples)[: samples // 8] / samples
    return float(together * np.sqrt(pairs * samples / (1 + 2 * np.sum(own[1:] ** 2))))


def _ranks(values: np.ndarray) -> np.ndarray:
    """Ranks from 1 on, equal values sharing theirs."""
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - (counts - 1) / 2)[place]


def _spread(rows: np.ndarray) -> np.ndarray:
    """Mean square over the periods, averaged over neighbouring phases; shape (samples,)."""
    reach = _NEIGHBOURS // 2
    around = np.pad(np.mean(rows**2, axis=0), reach, mode="wrap")
    return np.convolve(around, np.full(_NEIGHBOURS, 1 / _NEIGHBOURS), mode="valid")


def _last(noise: np.ndarray, quiet: np.ndarray) -> bool:
    """Whether large deviations last longer than the noise remembers."""
    quietest = _spread(noise) <= np.quantile(_spread(noise), _QUIET)
    of_noise = _neighbours(noise, quietest[1:] & quietest[:-1])
    return _neighbours(noise, ~quiet[1:] & ~quiet[:-1]) > of_noise + LASTING * (1 - of_noise)


def _neighbours(noise: np.ndarray, where: np.ndarray) -> float:
    """Correlation of neighbouring samples."""
    first, second = noise[:, :-1][:, where], noise[:, 1:][:, where]
    energy = np.sum(first**2) + np.sum(second**2)
    return float(2 * np.sum(first * second) / energy) if energy > 0 else 0.0
