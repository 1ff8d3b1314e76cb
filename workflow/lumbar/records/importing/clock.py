"""Even clock of a record, from exact or rounded time stamps, a stated rate or by resampling; integration of a velocity."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.importing.raw_table import StatedRate
from lumbar.records.record import CLOCK_TOLERANCE, MIN_SAMPLES, Channel, Record, place_of

MAX_STEP = 3.0
"""Longest step of an uneven clock, in median steps, that is interpolated."""
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
            f"{source}: no column of time and no rate is stated; give --time COLUMN or --rate HZ (points of a static test "
            "have neither: lumbar diagnose reads their plain table position_mm,force_N)"
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


def check_forward(time: np.ndarray, lines: Sequence[int] | None, source: str) -> None:
    """Raise if time stamps are missing, repeated or backward.

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
        If a time stamp is wrong, with the lines of all wrong time stamps.
    """
    problems = Problems(source)
    steps = np.diff(time)
    repeated = "drop the duplicate rows; replace stamps too coarse for an even clock by --time none --rate HZ"
    for fault, samples, remedy in (
        ("without a number", np.flatnonzero(~np.isfinite(time)), "fix or remove these rows"),
        ("repeated", np.flatnonzero(steps == 0) + 1, repeated),
        (
            "backward",
            np.flatnonzero(steps < 0) + 1,
            "split the recording there, or select a part with --trim",
        ),
    ):
        if samples.size:
            places = ", ".join(place_of(int(sample), lines) for sample in samples[:_MAX_LISTED])
            more = f" and {samples.size - _MAX_LISTED} more" if samples.size > _MAX_LISTED else ""
            problems.add(f"{places}{more}", f"{samples.size} time stamps {fault}", remedy)
    problems.raise_if_any()


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


def even_clock(record: Record, lines: Sequence[int] | None) -> tuple[Record, str]:
    """Return the record on an even clock.

    A clock within `CLOCK_TOLERANCE` of an even clock is kept. Otherwise a cubic spline is evaluated at the median rate. It is
    limited to the values of the two neighbouring samples: it would overshoot at a clipped sensor or an impact.

    Parameters
    ----------
    record : Record
        Record with an increasing clock.
    lines : sequence of int, or None
        Line of each sample in the file.

    Returns
    -------
    Record
        `record` itself if its clock is even.
    str
        Note on the change; empty if nothing changed.

    Raises
    ------
    InputError
        If a step is longer than `MAX_STEP` median steps: the motion in between is unknown.
    """
    steps = np.diff(record.time)
    step = float(np.median(steps))
    even = record.time[0] + record.sampling_time * np.arange(len(record))
    if np.all(np.abs(record.time - even) <= CLOCK_TOLERANCE * step):
        return record, ""
    gaps = np.flatnonzero(steps > MAX_STEP * step)
    problems = Problems(record.source)
    for gap in gaps[:_MAX_LISTED]:
        problem = f"{steps[gap]:.4g} s without samples, {steps[gap] / step:.4g} median steps"
        problems.add(place_of(int(gap) + 1, lines), problem)
    if gaps.size:
        hint = trim_hint(record.time, [0, *(gaps + 1), len(record)], step)
        problems.add("", f"{gaps.size} gaps are longer than {MAX_STEP:g} median steps", hint)
    problems.raise_if_any()
    # A rate that differs from three digits by the rounding of its time stamps only is rounded.
    rate = 1 / step
    rounded = float(f"{rate:.3g}")
    if abs(rounded / rate - 1) < 1e-3:
        rate = rounded
    time = record.time[0] + np.arange(int((record.time[-1] - record.time[0]) * rate * (1 + 1e-12)) + 1) / rate
    # A cubic spline, but a straight line if it leaves the range of the two samples around a new one: a limit would repeat values.
    from scipy.interpolate import CubicSpline

    channels, after = {}, np.clip(np.searchsorted(record.time, time), 1, len(record) - 1)
    for role, channel in record.channels.items():
        around = channel.values[after - 1], channel.values[after]
        values = CubicSpline(record.time, channel.values)(time)
        line = np.interp(time, record.time, channel.values)
        values = np.where((values - around[0]) * (values - around[1]) > 0, line, values)
        channels[role] = Channel(values, channel.quantity, channel.unit)
    dropped = int(np.sum(np.maximum(np.round(steps / step) - 1, 0)))
    return replace(record, time=time, channels=channels), (
        f"the clock is uneven (steps of {1e3 * steps.min():.4g} to {1e3 * steps.max():.4g} ms, {dropped} samples dropped): "
        f"resampled to its median rate, {rate:g} Hz, by a cubic spline that stays between neighbouring samples"
    )


def trim_hint(time: np.ndarray, edges: Sequence[int], step: float) -> str:
    """Return advice to read only the longest part without a gap, with the command-line option.

    Parameters
    ----------
    time : ndarray, shape (samples,)
        Seconds.
    edges : sequence of int
        First sample of each part, then the stop of the last part.
    step : float
        Sampling interval in seconds.
    """
    first, stop = max(pairwise(edges), key=lambda part: part[1] - part[0])
    return f"the longest part without one is --trim {time[first]:.9g}:{time[stop - 1] + step / 2:.9g}"


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

    steps = np.diff(time)
    first, last = samples[0], samples[-1]
    longest = MAX_STEP * np.median(steps[first:last])
    is_gap = ~((steps >= 0) & (steps <= longest) & np.isfinite(velocity[1:] + velocity[:-1]))
    start = int(max(np.flatnonzero(is_gap[:first]) + 1, default=0))
    part = slice(start, last + 1)
    position = cumulative_trapezoid(velocity[part], recover_even_clock(time[part])[0], initial=0)
    drift = 0.01 * float(np.sqrt(np.mean(velocity[part] ** 2)) * (time[last] - time[first]))
    zero = place_of(start, lines) if start else "the first sample"
    return position[samples - start], (
        f"over time (trapezoids), 0 at {zero} as the true position is unknown; a velocity offset of 1 % RMS would drift the "
        f"position by {drift:.3g} {unit} to the end"
    )
