"""Held samples: a channel that stays at one value for a few samples while it is moving, and then catches up."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.sensors.linear_response import linear_response

_LONGEST = 25
"""Repeated samples in a row; what stays longer may be meant to."""
_BESIDE = 3
"""Samples on either side over which the speed is taken."""
_STEPS_OF_RESOLUTION = 20
"""Size of the changes beside a run, in steps of the channel's resolution, that leaves no room for equal neighbours."""
_VARIED = 0.5
"""Least share of the runs that stand at values of their own: those of a dead zone share one."""
_NEXT_TO_ANOTHER = 0.5
"""Share of the samples beside a run at which the channel must move, in a channel that is held elsewhere."""
_FEWEST_RUNS = 2
_CHANCE = (5, 4)
"""Runs of two equal values that are told: so many more than as many times what is expected by chance."""
_LONG = 0.2
"""Share of runs of three equal values and more that is never by chance."""
_DIGITS = 2e-6
"""Resolution of values written with six or seven digits, in the largest of them."""
_FINE = 1e-3
"""Resolution that cannot be told from finer ones, in the usual step from sample to sample."""
_NEAR = 0.05
"""What is nearly equal, in that step."""
_JUMPS = (0.4, 6.0)
"""Jump after a run over the travel that its neighbours' speed makes of it; less is a start after a rest."""
_SHARE = 0.6
"""Share of the runs that must catch up, of those whose speed shows it."""
_SMOOTH = 0.7
"""Change of the steps over the steps, below which a channel moves smoothly."""


@dataclass(frozen=True, eq=False)
class HeldSamples:
    """Samples of one channel that repeat the one before."""

    role: str
    samples: np.ndarray
    """Every repeated sample."""
    runs: int

    kind = "held_samples"

    def finding(self, record: Record) -> Finding:
        """Say how many samples were held in which channel, and where the first is."""
        quantity = record.channels[self.role].quantity
        return Finding(
            self.kind,
            f"{record.name}: the {quantity} is held over {len(self.samples)} samples in {self.runs} places, the first at "
            f"{record.time[self.samples[0]]:.4g} s, while it moves; they are filled in from beside: look for a sensor that "
            "is read too often, or for lost messages",
            len(self.samples),
            "samples",
            record.name,
        )

    def mended(self, record: Record) -> Record:
        """The record with the held samples interpolated by a cubic spline, and noted as filled.

        Of a force, what a linear tissue makes of the position is taken off first: the position is known there.
        """
        from scipy.interpolate import make_interp_spline

        known = linear_response(record, self.samples) if self.role == "output" else np.zeros(len(record))
        values = record[self.role].copy()
        kept = np.setdiff1d(np.arange(len(record)), self.samples)
        between = make_interp_spline(kept, (values - known)[kept], k=3)
        values[self.samples] = known[self.samples] + between(self.samples)
        filled = tuple(np.union1d(record.filled, self.samples).astype(int).tolist())
        return replace(record.with_values(**{self.role: values}), filled=filled)


def find_held(record: Record, role: str) -> HeldSamples | None:
    """Return the samples of a channel that were held while it moved, or None.

    A rest, a flat top, a dead zone and the crest of a wave repeat a value too. A held sample differs from them in that
    the channel moves on both sides of it, that the runs stand at different values, and that the value jumps afterwards to
    where the motion has gone. Where noise hides that jump, values that are far finer than the noise do not repeat by
    chance.
    """
    values = record[role]
    steps = np.diff(values)
    starts, lengths = _runs(steps)
    if len(starts) < _FEWEST_RUNS:
        return None
    resolution = _resolution(values, steps)
    shares = _moving(steps, starts, lengths, resolution)
    shares[(values[starts] == values.max()) | (values[starts] == values.min())] = 0
    every = starts, lengths
    starts, lengths = starts[shares == 1], lengths[shares == 1]
    if len(starts) < _FEWEST_RUNS or len(np.unique(values[starts])) < _VARIED * len(starts):
        return None
    several = np.sum(lengths > 1) >= max(_FEWEST_RUNS, _LONG * len(starts))
    if not several and len(starts) < _CHANCE[0] + _CHANCE[1] * _by_chance(steps, resolution):
        return None
    if not _caught_up(steps, starts, lengths):
        return None
    # Of two runs close to each other either hides that the channel moves beside the other.
    beside = (shares >= _NEXT_TO_ANOTHER) & (every[1] <= lengths.max())
    starts, lengths = (found[beside] for found in every)
    samples = np.concatenate(
        [start + 1 + np.arange(length) for start, length in zip(starts, lengths, strict=True)]
    )
    return HeldSamples(role, samples, len(starts))


def _runs(steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First sample of every run of equal values, and how many samples repeat it."""
    equal = np.concatenate([[False], steps == 0, [False]])
    starts = np.flatnonzero(~equal[:-1] & equal[1:])
    return starts, np.flatnonzero(equal[:-1] & ~equal[1:]) - starts


def _resolution(values: np.ndarray, steps: np.ndarray) -> float:
    """Smallest distance between two values that occur, and no less than what digits that were cut off may make of it."""
    gaps = np.diff(np.unique(values))
    least = max(_DIGITS * np.abs(values).max(), _FINE * float(np.median(np.abs(steps[steps != 0]))))
    gaps = gaps[gaps > least]
    return float(gaps.min()) if gaps.size else least


def _moving(steps: np.ndarray, starts: np.ndarray, lengths: np.ndarray, resolution: float) -> np.ndarray:
    """Share of the samples beside every run at which the channel moves; 0 where it moves by little more than its resolution."""
    before = starts[:, None] - 1 - np.arange(_BESIDE)
    after = (starts + lengths)[:, None] + np.arange(_BESIDE + 1)
    inside = (before.min(axis=1) >= 0) & (after.max(axis=1) < len(steps)) & (lengths <= _LONGEST)
    beside = np.abs(steps[np.clip(np.hstack([before, after]), 0, len(steps) - 1)])
    moves = beside > 0
    usual = beside.sum(axis=1) / np.maximum(moves.sum(axis=1), 1)
    return np.where(inside & (usual > _STEPS_OF_RESOLUTION * resolution), moves.mean(axis=1), 0.0)


def _by_chance(steps: np.ndarray, resolution: float) -> float:
    """Equal neighbours to be expected of a channel that is read to this resolution: as dense as those that are nearly equal."""
    near = max(_NEAR * float(np.median(np.abs(steps[steps != 0]))), 2.5 * resolution)
    return float(np.sum((steps != 0) & (np.abs(steps) < near)) * resolution / (2 * near))


def _caught_up(steps: np.ndarray, starts: np.ndarray, lengths: np.ndarray) -> bool:
    """Whether the channel jumps after its runs to where it would have gone; or is too rough to show it."""
    before = starts[:, None] - 1 - np.arange(_BESIDE)
    after = (starts + lengths + 1)[:, None] + np.arange(_BESIDE)
    near = np.hstack([before[:, ::-1], after])
    speed = steps[near].mean(axis=1)
    roughness = np.median(np.abs(np.diff(steps[near], axis=1)), axis=1)
    jump = steps[starts + lengths] / np.where(speed == 0, np.inf, speed * (lengths + 1))
    clear = np.abs(speed) * lengths > 2 * roughness
    if clear.sum() >= _FEWEST_RUNS:
        return bool(np.mean((jump[clear] > _JUMPS[0]) & (jump[clear] < _JUMPS[1])) >= _SHARE)
    moved = np.abs(steps[steps != 0])
    return bool(np.median(np.abs(np.diff(steps))) > _SMOOTH * np.median(moved))
