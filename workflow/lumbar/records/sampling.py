"""Samples of a record: parts of a recording, rows that are missing, and another rate."""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import FEWEST_SAMPLES, LARGEST, Record


def samples_between(time: np.ndarray, trim: tuple[float, float], source: str) -> np.ndarray:
    """Return the numbers of the samples with ``start <= time < stop`` (seconds); a time that is NaN lies nowhere.

    Raises
    ------
    InputError
        If fewer than `FEWEST_SAMPLES` lie between them.
    """
    keep = np.flatnonzero((time >= trim[0] - 1e-9) & (time < trim[1] - 1e-9))
    if len(keep) < FEWEST_SAMPLES:
        raise InputError(
            f"{source}: {len(keep)} samples from {trim[0]:g} to {trim[1]:g} s; the clock runs from {np.nanmin(time):g} to "
            f"{np.nanmax(time):g} s, and at least {FEWEST_SAMPLES} samples are needed"
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
    if len(record.time) < FEWEST_SAMPLES or not is_finite:
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
