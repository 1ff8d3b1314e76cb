"""A difference of two forces in units of what a hand can tell, over one and the same motion.

Slow and fast parts of both are split at `VIBRATION_HZ`, without a shift in time and so that their powers add up; what is
faster than `FASTEST_HZ` is left out. In each part a hand averages power over its window. What it notices of the difference e
beside the force f at an instant is

    d′ = √( ⟨e²⟩ / max(w² ⟨f²⟩, Δ₀²) ),

with the Weber fraction w and the floor Δ₀ of that part: a gain that is wrong by w gives d′ = 1 throughout. Both parts
together give the root of the sum of their squares, as independent senses do (D. M. Green, J. A. Swets, Signal Detection
Theory, 1966). In one stroke, the way from one turning point to the next, the largest d′ counts, and two alternatives are told
apart with the probability Φ(d′/√2).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from lumbar.tissue.perception.thresholds import FASTEST_HZ, NEWTONS, VIBRATION_HZ, Hand, Hands

PHASES = ("rising", "falling", "holding")
"""Input grows, falls, or hardly moves."""
_STEEP = 16
"""Twice the order of the Butterworth filters whose gains, without their phase, part slow from fast."""
_HOLDING = 0.05
"""Share of the RMS velocity below which a motion holds."""
_TURN = 0.05
"""Share of the motion's range that a stroke must cover."""


class Reach(NamedTuple):
    """A figure for the usual hand, and the least and the most of all hands."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, figures: Iterable[float]) -> Reach:
        """Of the figures for every hand, the usual one first."""
        found = list(map(float, figures))
        return cls(found[0], min(found), max(found))


@dataclass(frozen=True, eq=False)
class Difference:
    """Two forces over the same motion, in N, and what of their difference is a sensor's noise.

    Attributes
    ----------
    reference, difference, position : numpy.ndarray, shape (samples,)
        Force that is the standard, the other less it, both in N, and the motion, in any unit.
    noise : tuple of float
        Variances of the slow and the fast noise in the difference, N²: no hand feels a sensor's.
    """

    reference: np.ndarray
    difference: np.ndarray
    position: np.ndarray
    sampling_time: float
    hands: Hands
    noise: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def felt(self) -> Felt:
        """How it is felt, over all that counts."""
        return self.felt_where(np.ones(len(self.difference), dtype=bool))

    def felt_where(self, counts: np.ndarray) -> Felt:
        """How it is felt at the samples that count; `counts` is a mask of shape (samples,)."""
        found = [self._figures(hand, counts) for hand in self.hands.all]
        return Felt(*map(Reach.of, zip(*found, strict=True)))

    def jnd_between(self, low: float, high: float) -> Reach:
        """d′ of what lies between two frequencies in Hz, against the mean square of the thresholds over time."""
        doubled = np.concatenate([self.difference, self.difference[::-1]])
        lines = np.fft.rfftfreq(len(doubled), self.sampling_time)
        inside = (lines >= low) & (lines < high)
        power = np.abs(np.fft.rfft(doubled)) ** 2 * np.where(lines == 0, 1.0, 2.0) / len(doubled) ** 2
        taken = [
            max(float(np.sum((power * gain)[inside])) - noise * _share(gain, inside), 0.0)
            for gain, noise in zip(power_gains(lines), self.noise, strict=True)
        ]
        return Reach.of(
            np.sqrt(sum(own / np.mean(self._threshold(hand, part) ** 2) for part, own in enumerate(taken)))
            for hand in self.hands.all
        )

    @property
    def just_felt_N(self) -> Reach:
        """RMS of a slow difference that is just felt: root mean square of the threshold over time."""
        return Reach.of(np.sqrt(np.mean(self._threshold(hand, 0) ** 2)) for hand in self.hands.all)

    def _figures(self, hand: Hand, counts: np.ndarray) -> tuple[float, float, float, float, float]:
        """d′, that of slow and fast parts, share of time in percent, and probability in percent."""
        from scipy.special import ndtr

        parts = [self._squared(hand, number) for number in (0, 1)]
        kinds = [max(float(np.mean(part[counts])), 0.0) for part in parts]
        whole = sum(kinds)
        local = np.maximum(parts[0], 0.0) + np.maximum(parts[1], 0.0)
        # What noise leaves by chance in single windows is taken off all of them alike.
        chance = float(np.mean(local[counts]))
        local = np.sqrt(local * (whole / chance if chance > 0 else 0.0))
        strokes = self.strokes
        starts = np.flatnonzero(np.diff(strokes, prepend=-1))
        highest = np.maximum.reduceat(np.where(counts, local, -1.0), starts)
        told = float(np.mean(ndtr(highest[highest >= 0] / np.sqrt(2))))
        share = float(np.mean(local[counts] >= 1.0))
        return np.sqrt(whole), np.sqrt(kinds[0]), np.sqrt(kinds[1]), 100 * share, 100 * told

    def _squared(self, hand: Hand, number: int) -> np.ndarray:
        """Squared d′ of the slow (0) or the fast (1) part at every sample; negative where less is there than noise."""
        power = window_mean(self._parts[1][number] ** 2, self._samples(hand)) - self.noise[number]
        return power / self._threshold(hand, number) ** 2

    def _threshold(self, hand: Hand, number: int) -> np.ndarray:
        weber, floor = (
            (hand.force_weber, hand.force_floor_N),
            (hand.vibration_weber, hand.vibration_floor_N),
        )[number]
        mean = window_mean(self._parts[0][number] ** 2, self._samples(hand))
        return np.maximum(weber * np.sqrt(mean), floor)

    def _samples(self, hand: Hand) -> int:
        return max(round(hand.window_s / self.sampling_time), 1)

    @cached_property
    def _parts(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """Slow and fast part of reference and difference."""
        return tuple(split_bands(values, self.sampling_time) for values in (self.reference, self.difference))

    @cached_property
    def _velocity(self) -> np.ndarray:
        samples = self._samples(self.hands.usual)
        return np.gradient(window_mean(self.position, samples)) / self.sampling_time

    @cached_property
    def strokes(self) -> np.ndarray:
        """Number of the stroke that each sample lies in, from 0 on; shape (samples,)."""
        within = max(self._samples(self.hands.usual) // 4, 1)
        turns = turning_points(self.position, _TURN * float(np.ptp(self.position)), within)
        return np.searchsorted(turns, np.arange(len(self.position)), side="right")

    def phase(self, name: str) -> np.ndarray:
        """Mask of the samples of one of `PHASES`; shape (samples,)."""
        velocity = self._velocity
        holding = np.abs(velocity) <= _HOLDING * np.sqrt(np.mean(velocity**2))
        return {
            "holding": holding,
            "rising": ~holding & (velocity > 0),
            "falling": ~holding & (velocity < 0),
        }[name]


@dataclass(frozen=True)
class Felt:
    """A difference in units of what a hand can tell."""

    jnd: Reach
    """d′: root of its mean square over time. 1 is just noticed."""
    slow: Reach
    fast: Reach
    """`slow`, `fast`: d′ of what is slower than `VIBRATION_HZ`, and of what is faster up to `FASTEST_HZ`."""
    time_percent: Reach
    """Share of the time in which d′ is at least 1."""
    told_apart_percent: Reach
    """Probability that a person tells the two apart in one stroke, of two alternatives: 50 is guessing."""


def felt_columns(felt: Felt | None) -> dict[str, float | None]:
    """How a difference is felt, as columns of a table; None where that is not known."""
    if felt is None:
        return dict.fromkeys(("felt_jnd", "felt_low", "felt_high", "felt_time_percent", "told_apart_percent"))
    return {
        **dict(zip(("felt_jnd", "felt_low", "felt_high"), felt.jnd, strict=True)),
        "felt_time_percent": felt.time_percent.value,
        "told_apart_percent": felt.told_apart_percent.value,
    }


def _share(gain: np.ndarray, inside: np.ndarray) -> float:
    """Share of white noise's power that lies on these lines, of all that a part takes up."""
    return float(np.sum(gain[inside]) / np.sum(gain))


def force_difference(
    reference: np.ndarray,
    other: np.ndarray,
    unit: str,
    position: np.ndarray,
    sampling_time: float,
    hands: Hands,
    noise: tuple[np.ndarray, np.ndarray] | None = None,
) -> Difference | None:
    """Two outputs over the same motion as a hand meets them; None where their unit is not of a force.

    Parameters
    ----------
    reference, other, position : numpy.ndarray, shape (samples,)
        The standard and the other one, in `unit`, and the motion.
    noise : tuple of numpy.ndarray, optional
        Frequencies (Hz) and one-sided density (unit²/Hz) of the noise in the difference, where it is known.
    """
    factor = NEWTONS.get(unit)
    if factor is None:
        return None
    known = (0.0, 0.0) if noise is None else noise_in_bands(noise[0], factor**2 * noise[1])
    return Difference(factor * reference, factor * (other - reference), position, sampling_time, hands, known)


def split_bands(values: np.ndarray, sampling_time: float) -> tuple[np.ndarray, np.ndarray]:
    """Slow and fast part of a signal, shape (samples,) each."""
    doubled = np.concatenate([values, values[::-1]])  # an even continuation has no jump at its ends
    spectrum = np.fft.rfft(doubled)
    powers = power_gains(np.fft.rfftfreq(len(doubled), sampling_time))
    parts = (np.fft.irfft(spectrum * np.sqrt(power), len(doubled)) for power in powers)
    first, second = (part[: len(values)] for part in parts)
    return first, second


def power_gains(frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Share of the power at frequencies in Hz that is in the slow part, and in the fast one."""
    slow, below = (1 / (1 + (frequency / edge) ** _STEEP) for edge in (VIBRATION_HZ, FASTEST_HZ))
    return slow, (1 - slow) * below


def window_mean(values: np.ndarray, samples: int) -> np.ndarray:
    """Mean over a window about each sample, shorter at the ends; shape (samples,)."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    place = np.arange(len(values))
    first = np.maximum(place - (samples - 1) // 2, 0)
    last = np.minimum(place + samples // 2 + 1, len(values))
    return (sums[last] - sums[first]) / (last - first)


def noise_in_bands(frequency: np.ndarray, density: np.ndarray) -> tuple[float, float]:
    """Variances of the slow and the fast part of noise by its one-sided density at evenly spaced frequencies."""
    step = frequency[1] - frequency[0]
    slow, fast = (float(np.sum(density * power) * step) for power in power_gains(frequency))
    return slow, fast


def turning_points(position: np.ndarray, least: float, within: int = 1) -> np.ndarray:
    """Samples at which a motion turns, between ways of at least this length; of each `within` samples the outermost count."""
    starts = np.arange(0, len(position), within)
    ends = [
        start + extreme(position[start : start + within])
        for start in starts
        for extreme in (np.argmin, np.argmax)
    ]
    kept = [0]
    for place in sorted({*ends, len(position) - 1}):
        way = position[place] - position[kept[-1]]
        if len(kept) > 1 and way * (position[kept[-1]] - position[kept[-2]]) >= 0:
            kept[-1] = place
        elif abs(way) >= least and place:
            kept.append(place)
    return np.array(kept[1:-1], dtype=int)
