"""Even clock of a record, from exact or rounded time stamps, a stated rate or by resampling; integration of a velocity.

Recordings are split at gaps, in which the motion is unknown. Steps that grow smoothly, as in relaxation tests with logarithmic
times, and changes of the rate are no gaps.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.importing.raw_table import StatedRate
from lumbar.records.record import CLOCK_TOLERANCE, MIN_SAMPLES, Channel, Record, place_of

MAX_STEP = 3.0
"""Longest step of a clock that is interpolated, in usual steps before it or after it."""
_USUAL_STEPS = 4
"""Number of steps before and after a step whose median is usual there."""
_MOVING_SHARE = 0.01
"""Smallest share of the range by which a position moves between two samples in motion."""
_MAX_RESAMPLED = 6000
"""Largest number of samples of a record that is resampled from several rates, unless it has more."""
_MIN_ODD_STEPS = 10
"""Smallest number of odd steps of a coarse clock with rounded stamps; fewer odd steps are dropped samples."""
_NEGLIGIBLE_DIGIT = 0.01
"""Last digit of the stamps, in median steps, below which their rounding is negligible."""
_MAX_LISTED = 5
_RATE_TOLERANCE = 0.01
"""Relative difference at which a stated rate contradicts the clock."""


def stated_time(
    samples: int, rate: float | None, stated: Sequence[StatedRate], source: str
) -> tuple[np.ndarray, str]:
    """Return the time of a table without a column of time.

    Parameters
    ----------
    samples : int
        Rows of the table.
    rate : float or None
        Rate in hertz that the user gave.
    stated : sequence of StatedRate
        Rates that the file states; used if `rate` is None.
    source : str
        The file, for messages.

    Returns
    -------
    ndarray, shape (samples,)
        Seconds from 0.
    str
        Origin of the rate.

    Raises
    ------
    InputError
        If no rate is given or stated, or the file states several.
    """
    if rate is not None:
        return np.arange(samples) / rate, f"no column; {rate:g} Hz as given by --rate"
    values = [item.value for item in stated]
    if not values:
        raise InputError(
            f"{source}: no column of time and no rate is stated; give --time COLUMN with its --time-unit, or --rate HZ (points "
            "of a static test have neither: lumbar diagnose reads their plain table position_mm,force_N)"
        )
    if max(values) > (1 + 1e-6) * min(values):
        listed = ", ".join(f"{item.value:g} Hz ({item.place})" for item in stated)
        raise InputError(f"{source}: no column of time, and the file states {listed}; choose by --rate HZ")
    return np.arange(samples) / values[0], f"no column; {values[0]:g} Hz as {stated[0].place} says"


def contradictions(record: Record, stated: Sequence[StatedRate]) -> list[str]:
    """Return notes on stated rates that differ from the clock's.

    Parameters
    ----------
    record : Record
        Record with the clock of the file.
    stated : sequence of StatedRate
        Rates that the file states.
    """
    rate = 1 / record.sampling_time
    return [
        f"the file states {item.value:g} Hz ({item.place}), but its clock has {rate:g} Hz"
        for item in stated
        if abs(item.value / rate - 1) > _RATE_TOLERANCE
    ]


def check_repeated(time: np.ndarray, lines: Sequence[int] | None, source: str) -> None:
    """Raise if time stamps are repeated.

    Parameters
    ----------
    time : ndarray, shape (samples,)
        Seconds.
    lines : sequence of int, or None
        Line of each sample in the file.
    source : str
        The file, for messages.

    Raises
    ------
    InputError
        If time stamps are repeated, with their lines.
    """
    repeated = np.flatnonzero(np.diff(time) == 0) + 1
    if repeated.size:
        problems = Problems(source)
        places = ", ".join(place_of(int(sample), lines) for sample in repeated[:_MAX_LISTED])
        more = f" and {repeated.size - _MAX_LISTED} more" if repeated.size > _MAX_LISTED else ""
        remedy = (
            "drop the duplicate rows; replace stamps too coarse for an even clock by --time none --rate HZ"
        )
        problems.add(f"{places}{more}", f"{repeated.size} time stamps repeated", remedy)
        problems.raise_if_any()


def split_at_gaps(time: np.ndarray) -> list[slice]:
    """Return the intervals of samples between gaps and backward time stamps.

    A gap is a step longer than `MAX_STEP` usual steps before it and after it.

    Parameters
    ----------
    time : ndarray, shape (samples,)
        Seconds.

    Examples
    --------
    >>> split_at_gaps(np.r_[0:20, 30:50])
    [slice(0, 20, None), slice(20, 40, None)]
    >>> split_at_gaps(np.geomspace(0.1, 1000, 50))
    [slice(0, 50, None)]
    """
    steps = np.diff(time)
    size = np.abs(steps)
    shorter = np.minimum(np.r_[np.inf, size[:-1]], np.r_[size[1:], np.inf])
    long = np.flatnonzero(steps > MAX_STEP * shorter)[:, None]
    distance = np.arange(1, _USUAL_STEPS + 1)
    before = np.median(size[np.maximum(long - distance, 0)], axis=1)
    after = np.median(size[np.minimum(long + distance, len(size) - 1)], axis=1)
    long = long[:, 0]
    before[long == 0], after[long == len(size) - 1] = 0, 0
    gaps = long[size[long] > MAX_STEP * np.maximum(before, after)]
    edges = [0, *np.union1d(gaps, np.flatnonzero(steps < 0)) + 1, len(time)]
    return [slice(int(first), int(stop)) for first, stop in pairwise(edges)]


def recover_even_clock(time: np.ndarray) -> tuple[np.ndarray, str]:
    """Return the even clock of rounded time stamps; other stamps unchanged.

    Stamps are rounded if they differ from an even clock by at most their last digit. If this digit is as coarse as the clock, a
    few odd steps are dropped or repeated samples instead.

    Parameters
    ----------
    time : ndarray, shape (samples,)
        Increasing time stamps in seconds.

    Returns
    -------
    ndarray, shape (samples,)
        Seconds.
    str
        Note; empty if the stamps are unchanged.
    """
    if len(time) < MIN_SAMPLES:
        return time, ""
    number, steps = np.arange(len(time)), np.diff(time)
    step = float(np.median(steps))
    last = time[-max(MIN_SAMPLES, len(time) // 10) :]  # of six digits, the last stamps are the coarsest
    digit = next(
        (10.0**-k for k in range(10) if np.allclose(last * 10**k, np.rint(last * 10**k), 0, 1e-3)), 0
    )
    odd = np.sum(np.abs(steps - step) > 0.5 * digit)
    is_dropped = digit > 0.5 * step and not _MIN_ODD_STEPS <= odd < len(steps) / 3
    if digit <= _NEGLIGIBLE_DIGIT * step or not odd or is_dropped:
        return time, ""

    # The simplest rate within the last digit; 1.2 as the slope of the line is fitted.
    fitted = 1 / float(np.polyfit(number, time - time[0], 1)[0])
    rates = [fitted, *(float(f"{fitted:.{digits}g}") for digits in range(1, 16))]
    fits = [np.ptp(time - number / rate) <= 1.2 * digit for rate in rates]
    if not fits[0]:
        return time, ""
    rate = next((rate for rate, is_fit in zip(rates[1:], fits[1:], strict=True) if is_fit), fitted)
    return time[0] + number / rate, (
        f"the time stamps are rounded to {1e3 * digit:g} ms: their even clock of {rate:.9g} Hz is used"
    )


def even_clock(record: Record) -> tuple[Record, str]:
    """Return the record on an even clock.

    A clock within `CLOCK_TOLERANCE` of an even clock is kept. Otherwise a spline is evaluated at the median rate; if the rate
    changes, at the median rate of the motion. The spline is limited to the values of the two neighbouring samples: it would
    overshoot at a clipped sensor or an impact.

    Parameters
    ----------
    record : Record
        Record with an increasing clock without gaps.

    Returns
    -------
    Record
        `record` itself if its clock is even.
    str
        Note on the change; empty if nothing changed.
    """
    steps = np.diff(record.time)
    step = float(np.median(steps))
    even = record.time[0] + record.sampling_time * np.arange(len(record))
    if np.all(np.abs(record.time - even) <= CLOCK_TOLERANCE * step):
        return record, ""
    usual = (record.time[_USUAL_STEPS:] - record.time[:-_USUAL_STEPS]) / _USUAL_STEPS
    changes = max(usual.max(), step) > MAX_STEP * min(usual.min(), step)
    if changes:
        position = record.stacked("input")
        moves = np.abs(np.diff(position)) > _MOVING_SHARE * np.ptp(position, axis=1, keepdims=True)
        moving = steps[moves.any(axis=0)]
        finest = float(np.median(moving)) if moving.size else float(usual.min())
        most = max(_MAX_RESAMPLED, len(record))
        step = max(finest, (record.time[-1] - record.time[0]) / most)
        # A rate of 1, 2 or 5, so that records with other steps have a simple ratio of rates.
        decade = 10.0 ** np.floor(np.log10(1 / step))
        step = 1 / next(size * decade for size in (1, 2, 5, 10) if size * decade * step > 0.999)
    # A rate that differs from three digits by the rounding of its time stamps only is rounded.
    rate = 1 / step
    rounded = float(f"{rate:.3g}")
    if abs(rounded / rate - 1) < 1e-3:
        rate = rounded
    time = record.time[0] + np.arange(int((record.time[-1] - record.time[0]) * rate * (1 + 1e-12)) + 1) / rate
    # A cubic spline, but a straight line if it leaves the range of the two samples around a new one: a limit would repeat values.
    # Where steps change, only a monotone spline does not swing.
    from scipy.interpolate import CubicSpline, PchipInterpolator

    channels, after = {}, np.clip(np.searchsorted(record.time, time), 1, len(record) - 1)
    for role, channel in record.channels.items():
        around = channel.values[after - 1], channel.values[after]
        values = (PchipInterpolator if changes else CubicSpline)(record.time, channel.values)(time)
        line = np.interp(time, record.time, channel.values)
        values = np.where((values - around[0]) * (values - around[1]) > 0, line, values)
        channels[role] = Channel(values, channel.quantity, channel.unit)
    if changes:
        spread = f"steps of {steps.min():.4g} to {steps.max():.4g} s"
        cause = f"the rate changes ({spread}): {len(record)} samples are"
        clock = f"{rate:g} Hz, at least the median rate in motion unless that gives more than {most} samples,"
    else:
        dropped = int(np.sum(np.maximum(np.round(steps / step) - 1, 0)))
        spread = f"steps of {1e3 * steps.min():.4g} to {1e3 * steps.max():.4g} ms"
        cause = f"the clock is uneven ({spread}, {dropped} samples dropped):"
        clock = f"its median rate, {rate:g} Hz,"
    return replace(record, time=time, channels=channels), (
        f"{cause} resampled to {clock} by a cubic spline that stays between neighbouring samples"
    )


def integrate_velocity(
    time: np.ndarray,
    velocity: np.ndarray,
    samples: np.ndarray,
    unit: str,
    lines: Sequence[int] | None = None,
) -> tuple[np.ndarray, str]:
    """Integrate a velocity by trapezoids, from 0 at the first sample after the last gap before `samples`.

    Parameters
    ----------
    time, velocity : ndarray, shape (n,)
        Seconds and velocity of all samples of the file, because all parts have the same zero.
    samples : ndarray
        Indices of the required samples; there is no gap between them.
    unit : str
        Unit of the position.
    lines : sequence of int, optional
        Line of each sample of the file.

    Returns
    -------
    ndarray, shape (len(samples),)
        Position in the velocity's unit times seconds.
    str
        Note on the integration, to which the column's name must be added.
    """
    from scipy.integrate import cumulative_trapezoid

    first, last = samples[0], samples[-1]
    start = max(part.start for part in split_at_gaps(time) if part.start <= first)
    part = slice(start, last + 1)
    position = cumulative_trapezoid(velocity[part], recover_even_clock(time[part])[0], initial=0)
    drift = 0.01 * float(np.sqrt(np.mean(velocity[part] ** 2)) * (time[last] - time[first]))
    zero = place_of(start, lines) if start else "the first sample"
    return position[samples - start], (
        f"over time (trapezoids), 0 at {zero} as the true position is unknown; a velocity offset of 1 % RMS would drift the "
        f"position by {drift:.3g} {unit} to the end"
    )
