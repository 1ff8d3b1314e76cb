"""How long the state in which a record begins, which nobody knows, tells on what follows: no error counts that start."""

from __future__ import annotations

from lumbar.records.record import Record

_FEWEST, _LEAST, _MOST = 50, 0.005, 0.05
"""Samples, and shares of the record. None of them is a time, so that a verdict does not hang on the unit of the clock."""


def settling_time(record: Record, told: float | None = None) -> float:
    """Seconds at the start of a record that are left out of every error of a free run.

    50 samples, a two-hundredth of a record that is longer than 10,000, never more than a twentieth of it. `told` is the setting
    ``tissue.settling_s``, which stands before all of it.
    """
    if told is not None:
        return told
    samples = len(record)
    return min(max(_FEWEST, _LEAST * samples), _MOST * samples) * record.sampling_time
