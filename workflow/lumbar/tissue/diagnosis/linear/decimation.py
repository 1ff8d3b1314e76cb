"""Records at a lower rate for fits of linear models, which hold at any rate."""

from __future__ import annotations

import numpy as np

from lumbar.tissue.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.signals.spectrum import spectral_edge

_ENOUGH = 6000
"""Samples of all records together that a fit is left with, where the position's band allows it."""
_PER_CYCLE = 12.0
"""Samples per cycle at the upper end of the position's band."""
_BAND_POWER = 0.9999
"""Share of the power of the position's steps below the upper end of its band. Of steps, for a damper answers the speed."""


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
    edges = [spectral_edge(np.diff(part.motion.position), _BAND_POWER) for part in parts]
    return min(int(1 / (_PER_CYCLE * edge)) for edge in edges)


def _decimated(data: FitData, factor: int) -> FitData:
    motion, window = data.motion, np.hanning(2 * factor + 1)[1:-1]
    window /= window.sum()
    position, force = (
        np.convolve(signal, window, "valid")[::factor] for signal in (motion.position, data.force)
    )
    step = factor * motion.sampling_time
    lower = Motion(np.arange(len(position)) * step, position, step, motion.smooth)
    late = (len(window) - 1) / 2 * motion.sampling_time
    before = data.begins * motion.sampling_time
    return FitData(data.name, lower, force, counts_from=max(before + data.counts_from - late, 0.0))
