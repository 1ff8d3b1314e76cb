"""Changing the sampling rate of a record without aliasing."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record

_ZERO_CROSSINGS = 10
"""Half length of the anti-aliasing filter, in samples of the lower of the two rates."""


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
    left_out = -(-_ZERO_CROSSINGS * max(ratio.numerator, ratio.denominator) // ratio.denominator)
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
