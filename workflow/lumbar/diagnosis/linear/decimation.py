"""Records at a lower rate for fits of linear models, which hold at any rate."""

from __future__ import annotations

import numpy as np

from lumbar.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.models.motion import Motion

_ENOUGH = 6000
"""Samples of all records together that a fit is left with, where the position's band allows it."""
_PER_CYCLE = 12.0
"""Samples per cycle at the upper end of the position's band."""
_BAND_POWER = 0.9999
"""Share of the power of the position's steps below the upper end of its band."""


def decimated(data: FitData) -> FitData:
    """The same records at a lower rate, smoothed over two of its samples; as they are where they are short.

    Position and force go through the same filter, so that a linear model from one to the other stays what it is. The filter
    sees whole windows only: nothing rings at the ends. Errors are then taken as they are: the noise left is another one.
    """
    factor = min(round(data.size / _ENOUGH), _room(data))
    if factor < 2:
        return data
    if isinstance(data, JointData):
        return JointData.of([_decimated(part, factor) for part in data.parts])
    return _decimated(data, factor)


def _room(data: FitData) -> int:
    """Largest factor that leaves `_PER_CYCLE` samples in the fastest cycle of any of the records."""
    parts = data.parts if isinstance(data, JointData) else (data,)
    return min(int(1 / (_PER_CYCLE * _band(part.motion.position))) for part in parts)


def _band(position: np.ndarray) -> float:
    """Frequency (cycles per sample) below which nearly all power of a position's steps lies."""
    steps = np.diff(position)
    power = np.cumsum(np.abs(np.fft.rfft(steps * np.hanning(len(steps)))) ** 2)
    return max(float(np.searchsorted(power, _BAND_POWER * power[-1])), 1.0) / len(steps)


def _decimated(data: FitData, factor: int) -> FitData:
    motion, window = data.motion, np.hanning(2 * factor + 1)[1:-1]
    window /= window.sum()
    position, force = (
        np.convolve(signal, window, "valid")[::factor] for signal in (motion.position, data.force)
    )
    step = factor * motion.sampling_time
    lower = Motion(np.arange(len(position)) * step, position, step, motion.smooth)
    late = (len(window) - 1) / 2 * motion.sampling_time
    return FitData(data.name, lower, force, counts_from=max(data.counts_from - late, 0.0))
