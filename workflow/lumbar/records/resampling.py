"""Changing the sampling rate of a record without aliasing."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from lumbar.errors import InputError
from lumbar.records.record import Record


def resample(record: Record, rate: float) -> Record:
    """Return `record` at `rate` hertz.

    A polyphase FIR filter (Kaiser window, zero phase, `scipy.signal.resample_poly`) removes what lies above
    the lower of the two Nyquist frequencies. The signal is continued by its end values, so that an offset
    makes no transient.

    Raises
    ------
    InputError
        If the ratio of the rates is no fraction with terms up to 1000.
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
    channels = {
        role: replace(
            channel, values=resample_poly(channel.values, ratio.numerator, ratio.denominator, padtype="line")
        )
        for role, channel in record.channels.items()
    }
    length = len(next(iter(channels.values())).values)
    return replace(record, time=record.time[0] + np.arange(length) / rate, channels=channels)
