"""What a record's motion covered: the range that a model fitted to it is known to hold in."""

from __future__ import annotations

import numpy as np

from lumbar.tissue.models.model_data import MotionRange
from lumbar.tissue.signals.spectral_edge import occupied_band

_SPEED_SHARE = 0.99
"""Share of the samples below the speed that is told: the fastest ones may be noise of the sensor."""


def motion_range(position: np.ndarray, sampling_time: float) -> MotionRange:
    """Return the range of positions, the speed and the band of a motion.

    Parameters
    ----------
    position : numpy.ndarray, shape (samples,)
        At least three samples, not all alike.
    sampling_time : float
        Seconds.

    Examples
    --------
    >>> time = np.arange(1000) * 0.01
    >>> covered = motion_range(2 * np.sin(2 * np.pi * time), 0.01)
    >>> print(f"{covered.lowest:.1f} to {covered.highest:.1f}, {covered.speed:.1f}/s, {covered.highest_Hz:.1f} Hz")
    -2.0 to 2.0, 12.6/s, 1.0 Hz
    """
    speeds = np.abs(np.diff(position)) / sampling_time
    low, high = occupied_band(position, sampling_time)
    return MotionRange(
        lowest=float(position.min()),
        highest=float(position.max()),
        speed=float(np.quantile(speeds, _SPEED_SHARE)),
        lowest_Hz=low,
        highest_Hz=high,
    )
