"""Rows that a recording lost although its clock went on: short gaps, filled from what lies beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lumbar.records.record import FEWEST_SAMPLES, LARGEST, Record

LONGEST_GAP = 10
"""Rows in a row that are filled at most: over more of them a motion cannot be guessed."""
LARGEST_SHARE = 0.05
"""Share of a record's rows that is filled at most."""
_OFF_CLOCK = 0.1
"""How far a step over a gap may be from a whole number of sampling intervals."""


def with_missing_rows(
    record: Record, lines: Sequence[int] | None = None
) -> tuple[Record, Sequence[int] | None]:
    """Fill gaps of a few rows by a cubic spline; `record` itself where there is none, or one that cannot be filled.

    Parameters
    ----------
    record : Record
        Not yet checked.
    lines : sequence of int, optional
        Line of each sample in the file that it was read from.

    Returns
    -------
    Record
        With the samples that were filled in as its `filled`.
    sequence of int or None
        Line of each sample; of a filled one, the line before it.
    """
    if len(record.time) < FEWEST_SAMPLES or not _finite(record):
        return record, lines
    steps = np.diff(record.time)
    step = float(np.median(steps))
    if step <= 0:
        return record, lines
    share = steps / step
    rows = np.round(share).astype(int)
    missing = rows - 1
    even = (np.abs(share - rows) <= _OFF_CLOCK) & (rows >= 1) & (missing <= LONGEST_GAP)
    if not missing.any() or not even.all() or missing.sum() > LARGEST_SHARE * len(record.time):
        return record, lines
    places = np.concatenate([[0], np.cumsum(rows)])
    every = np.arange(places[-1] + 1)
    filled = np.setdiff1d(every, places)
    time = np.interp(every, places, record.time)
    if lines is not None:
        before = np.searchsorted(places, every, side="right") - 1
        lines = [lines[index] for index in before]
    whole = replace(record, time=time, filled=tuple(filled.tolist()))
    return whole.with_values(**_interpolated(record, places, every)), lines


def _finite(record: Record) -> bool:
    series = [record.time, *(channel.values for channel in record.channels.values())]
    return all(np.all(np.abs(values) <= LARGEST) for values in series)


def _interpolated(record: Record, places: np.ndarray, every: np.ndarray) -> dict[str, np.ndarray]:
    from scipy.interpolate import make_interp_spline

    values = {}
    for role, channel in record.channels.items():
        values[role] = make_interp_spline(places, channel.values, k=3)(every)
        values[role][places] = channel.values
    return values
