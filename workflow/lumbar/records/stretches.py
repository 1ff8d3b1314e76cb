"""Stretches of samples: where something holds without a break, and flat tops, as of a converter at the end of its range.

A force that a mechanism limits (contact that is lost, a gripper that slips) carries the sensor's noise on top and does not
repeat to the last digit; a converter's limit does. What a clipped channel would have shown is not in the file.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import Problems
from lumbar.records.record import Record, place_of


def runs(flags: np.ndarray) -> Iterator[slice]:
    """Yield the contiguous stretches in which `flags`, shape (n,), is true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], np.asarray(flags, dtype=np.int8), [0]))))
    for start, stop in edges.reshape(-1, 2):
        yield slice(int(start), int(stop))


_SHORTEST_RUN = 3
"""Samples in a row at the extreme that make a flat top."""
_FEWEST_SAMPLES = 6
_CROWDED = 5
"""Times as many samples at the extreme as at the value next to it: a coarse converter repeats its other values too."""
_ENTRY_SPREAD = 1.5
"""Ratio of the speeds at which a position enters its flat tops: a commanded hold is always entered alike."""
_FEWEST_TOPS = 3
_STEPS = 4
"""Samples over which the speed into a flat top is taken."""
_TURNED = 4.0
"""Twice the time, in speed over deceleration, after which a motion that was cut off would be back."""


@dataclass(frozen=True)
class FlatTop:
    """Samples at one extreme of a channel."""

    level: float
    samples: int
    """In flat tops."""
    starts: np.ndarray
    """First sample of every flat top."""


def flat_tops(values: np.ndarray) -> list[FlatTop]:
    """Flat tops at the largest and at the smallest value; empty where a channel is not clipped."""
    found: list[FlatTop] = []
    for extreme in (np.max, np.min):
        level = extreme(values)
        inside = values[values != level]
        if not inside.size:
            return []
        beside = extreme(inside)
        crowd = len(values) - len(inside), int(np.sum(inside == beside))
        if sum(crowd) == len(values):  # two levels are a switch
            return []
        long = [run for run in runs(values == level) if run.stop - run.start >= _SHORTEST_RUN]
        samples = sum(run.stop - run.start for run in long)
        if samples >= _FEWEST_SAMPLES and crowd[0] > _CROWDED * crowd[1]:
            found.append(FlatTop(float(level), samples, np.array([run.start for run in long])))
    return found


def _comes_to_rest(top: FlatTop, values: np.ndarray) -> np.ndarray:
    """For every flat top whether the motion slowed down into it and stayed: bool, shape (tops,).

    What is cut off a motion that goes on would have turned round after speed over deceleration, and come back after twice
    that; a rest is entered without speed, or lasts longer.
    """
    rests = np.zeros(len(top.starts), dtype=bool)
    for number, start in enumerate(top.starts):
        if start < 2 * _STEPS:
            rests[number] = start == 0
            continue
        late = abs(values[start] - values[start - _STEPS]) / _STEPS
        early = abs(values[start - _STEPS] - values[start - 2 * _STEPS]) / _STEPS
        speed, deceleration = late - (early - late) / 2, (early - late) / _STEPS
        left = np.flatnonzero(values[start:] != top.level)
        stays = left[0] if left.size else len(values) - start
        rests[number] = deceleration > 0 and stays * deceleration > _TURNED * speed
    return rests


def check_clipping(record: Record, lines: Sequence[int] | None = None) -> None:
    """Refuse a record whose force is clipped, or whose position is and does not merely rest there.

    Surgeons and people rest where they like: the channels of others are not looked at.

    Raises
    ------
    InputError
        With level, number of samples and stretches of every clipped channel.
    """
    problems = Problems(record.source or record.name)
    for role, channel in record.channels.items():
        excites = role in record.roles("input")
        if not excites and role not in (*record.roles("output"), "moment"):
            continue
        for top in flat_tops(channel.values):
            if excites:  # a position may rest at its extreme: it stops few times, or always at the same speed
                values = channel.values
                entries = top.starts[(top.starts >= 2) & ~_comes_to_rest(top, values)]
                speeds = np.abs(values[entries - 1] - values[entries - 2])
                if len(entries) < _FEWEST_TOPS or speeds.max() <= _ENTRY_SPREAD * speeds.min():
                    continue
            problems.add(
                role,
                f"clipped: {top.samples} samples lie exactly at {top.level:g} {channel.unit}, in {len(top.starts)} stretches "
                f"from {place_of(top.starts[0], lines)} on",
                "record with a larger range, cut the stretches out, or accept them with the layout's 'clipped: accept'",
            )
    problems.raise_if_any()
