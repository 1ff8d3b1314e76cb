"""The motion of a forward record as measured, beside the force that drives it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lumbar.records.record import Record

MEASURED = "measured_motion"
"""Role of the channel with the motion as measured, of which a simulation takes its beginning."""
_BLOCK = 8
"""Blocks of a record whose spectra are averaged."""
_ABOVE = 4.0
"""Power of the motion in that of the noise, from which on it is told from it."""
_QUIET = 0.25
"""Share of the frequencies, the highest ones, whose power is taken for the noise's."""
_ROOM = 1.5
_ORDER = 4
_HIGHEST = 0.45
"""Cycles per sample from which on nothing is smoothed."""


def with_measured_motion(record: Record) -> Record:
    """The record with its motion once more, smoothed, as the channel that a simulation takes its beginning from."""
    output = record.channels["output"]
    return replace(
        record, channels={**record.channels, MEASURED: replace(output, values=smoothed(output.values))}
    )


def smoothed(signal: np.ndarray) -> np.ndarray:
    """A signal without the frequencies at which noise is all that is seen: zero-phase Butterworth filter.

    The noise is what the highest quarter of the frequencies holds; a motion has little there.
    """
    from scipy.signal import butter, sosfiltfilt, welch

    frequency, power = welch(signal, nperseg=min(len(signal), max(len(signal) // _BLOCK, 64)))
    noise = float(np.median(power[frequency > 0.5 * (1 - _QUIET)]))
    seen = np.flatnonzero(power > _ABOVE * noise)
    cut = _ROOM * float(frequency[seen[-1]]) if len(seen) else 0.0
    if not 0 < cut < _HIGHEST:
        return signal
    return sosfiltfilt(butter(_ORDER, 2 * cut, output="sos"), signal)
