"""Samples of a record: parts of a recording, missing rows, another rate, flat tops.

A force that a mechanism limits (contact that is lost, a gripper that slips) carries the sensor's noise on top and does not
repeat to the last digit; a converter's limit does. What a clipped channel would have shown is not in the file.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.record import LARGEST, MIN_SAMPLES, Record, place_of


def samples_between(time: np.ndarray, trim: tuple[float, float], source: str) -> np.ndarray:
    """Return the numbers of the samples with ``start <= time < stop`` (seconds); a time that is NaN lies nowhere.

    Raises
    ------
    InputError
        If fewer than `MIN_SAMPLES` lie between them.
    """
    keep = np.flatnonzero((time >= trim[0] - 1e-9) & (time < trim[1] - 1e-9))
    if len(keep) < MIN_SAMPLES:
        raise InputError(
            f"{source}: {len(keep)} samples from {trim[0]:g} to {trim[1]:g} s; the clock runs from {np.nanmin(time):g} to "
            f"{np.nanmax(time):g} s, and at least {MIN_SAMPLES} samples are needed"
        )
    return keep


MAX_GAP_ROWS = 10
"""Missing rows in a row that are filled: over more of them a motion cannot be guessed."""
MAX_FILLED_SHARE = 0.05
"""Share of a record's rows that is filled."""
_CLOCK_TOLERANCE_ROWS = 0.1
"""Difference of a step over a gap from a whole number of sampling intervals."""


def fill_missing_rows(
    record: Record, lines: Sequence[int] | None = None
) -> tuple[Record, Sequence[int] | None]:
    """Fill gaps of a few rows by a cubic spline.

    Returns
    -------
    Record
        With the samples that were filled in as its `filled`; `record` itself if no row is missing, or a gap cannot be filled.
    sequence of int or None
        Line of each sample; of a filled one, the line before it.
    """
    channels = {role: channel.values for role, channel in record.channels.items()}
    is_finite = all(np.all(np.abs(values) <= LARGEST) for values in (record.time, *channels.values()))
    if len(record.time) < MIN_SAMPLES or not is_finite:
        return record, lines
    steps = np.diff(record.time)
    step = float(np.median(steps))
    if step <= 0:
        return record, lines
    # Every step must be nearly a whole number of sampling intervals.
    share = steps / step
    rows = np.round(share).astype(int)
    missing = rows - 1
    even = (np.abs(share - rows) <= _CLOCK_TOLERANCE_ROWS) & (rows >= 1) & (missing <= MAX_GAP_ROWS)
    if not missing.any() or not even.all() or missing.sum() > MAX_FILLED_SHARE * len(record.time):
        return record, lines
    # A spline through the recorded rows gives the missing ones; the recorded values stay.
    from scipy.interpolate import make_interp_spline

    recorded = np.concatenate([[0], np.cumsum(rows)])
    every = np.arange(recorded[-1] + 1)
    filled = {}
    for role, values in channels.items():
        filled[role] = replace(record.channels[role], values=make_interp_spline(recorded, values, k=3)(every))
        filled[role].values[recorded] = values
    if lines is not None:
        lines = np.asarray(lines)[np.searchsorted(recorded, every, side="right") - 1].tolist()
    return replace(
        record,
        time=np.interp(every, recorded, record.time),
        channels=filled,
        filled=tuple(np.setdiff1d(every, recorded).tolist()),
    ), lines


_FILTER_HALF_LENGTH = 10
"""Of the anti-aliasing filter, in samples of the lower of the two rates."""


def resample(record: Record, rate: float) -> Record:
    """Return `record` at `rate` hertz, without the samples at its ends that the filter cannot see whole.

    A polyphase FIR filter (Kaiser window, zero phase, `scipy.signal.resample_poly`) removes what lies above the lower
    of the two Nyquist frequencies. Near an end it would have to guess how the signal goes on; whatever is guessed, a
    signal in full motion rings there, and a ringing force looks like a mechanism. Ten samples of the lower rate are
    therefore left out at either end.

    Raises
    ------
    InputError
        If the ratio of the rates is no fraction with terms up to 1000, or hardly anything is left between the ends.
    """
    from scipy.signal import resample_poly

    recorded = 1.0 / record.sampling_time
    ratio = Fraction(rate / recorded).limit_denominator(1000)
    if ratio <= 0 or abs(float(ratio) * recorded / rate - 1) > 1e-4:
        raise InputError(
            f"{record.source}: cannot resample {recorded:g} Hz to {rate:g} Hz; choose a simpler ratio"
        )
    if ratio == 1:
        return record
    left_out = -(-_FILTER_HALF_LENGTH * max(ratio.numerator, ratio.denominator) // ratio.denominator)
    samples = -(-len(record) * ratio.numerator // ratio.denominator)
    # The last sample at the new rate may lie up to one old interval beyond the last one recorded.
    seen_whole = slice(left_out, samples - left_out)
    time = record.time[0] + np.arange(samples)[seen_whole] / rate
    if len(time) < 8:
        raise InputError(
            f"{record.source}: {record.duration:g} s are too short to be resampled to {rate:g} Hz: "
            f"{left_out} samples are left out at either end; at least 8 must remain"
        )
    channels = {
        role: replace(
            channel,
            values=resample_poly(channel.values, ratio.numerator, ratio.denominator, padtype="line")[
                seen_whole
            ],
        )
        for role, channel in record.channels.items()
    }
    # Of a sample that was filled in, the one nearest to it at the new rate is the most made up.
    kept = np.unique(np.round(np.array(record.filled) * float(ratio)).astype(int) - left_out)
    filled = tuple(kept[(kept >= 0) & (kept < len(time))].tolist())
    return replace(record, time=time, channels=channels, filled=filled)


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
