"""What a motion covers: the range in which a model fitted to it is known to hold, and what it asks of a testing machine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import Problems
from lumbar.tissue.models.model_data import MotionRange
from lumbar.tissue.signals.spectrum import occupied_band

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


_POINTS_PER_SAMPLE = 8


@dataclass(frozen=True)
class Kinematics:
    """Peaks of the motion a signal commands, between samples too."""

    displacement: float
    """mm from the machine's zero."""
    velocity: float
    """mm/s."""
    acceleration: float
    """mm/s²."""


QUANTITIES = {"displacement": "mm", "velocity": "mm/s", "acceleration": "mm/s²"}


def peak_kinematics(position: np.ndarray, rate: float) -> Kinematics:
    """Peak displacement, velocity and acceleration of the smooth motion through the samples.

    A quintic spline stands for that motion; differences of samples would miss what happens between them and
    underrate the acceleration of a sine of 20 samples per cycle by 0.8 %.

    Parameters
    ----------
    position : numpy.ndarray of float, shape (samples,)
        mm, at least 6 samples.
    rate : float
        Samples per second, Hz.
    """
    from scipy.interpolate import make_interp_spline

    time = np.arange(len(position)) / rate
    spline = make_interp_spline(time, position, k=5)
    fine = np.linspace(0, time[-1], _POINTS_PER_SAMPLE * (len(position) - 1) + 1)
    return Kinematics(*(float(np.abs(spline(fine, nu=order)).max()) for order in range(3)))


def check_machine_limits(motions: dict[str, Kinematics], limits: Kinematics) -> None:
    """Refuse signals that the testing machine cannot play.

    Raises
    ------
    InputError
        Naming signal, quantity, value, limit and the factor by which to scale the signal, for every
        violation.
    """
    problems = Problems("excitation signals")
    for name, motion in motions.items():
        for quantity, unit in QUANTITIES.items():
            value, limit = getattr(motion, quantity), getattr(limits, quantity)
            if value > limit:
                problems.add(
                    name,
                    f"peak {quantity} is {value:.4g} {unit}, the machine's limit is {limit:g} {unit}",
                    f"multiply signals.amplitude.value_mm by at most {_rounded_down(limit / value)} "
                    "or change signals.machine",
                )
    problems.raise_if_any()


def _rounded_down(factor: float) -> str:
    """Three digits that are never more than the factor, so that following the advice is enough."""
    digits = 2 - int(np.floor(np.log10(factor)))
    return f"{np.floor(factor * 10**digits) / 10**digits:.{max(digits, 0)}f}"
