"""An even clock for a record: from the time column, behind rounded time stamps, from a stated rate, or by resampling; and the
motion from a column of velocity, its integral over the clock.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.importing.raw_table import StatedRate
from lumbar.records.record import CLOCK_TOLERANCE, FEWEST_SAMPLES, Record, place_of

LONGEST_STEP = 3.0
"""Longest step of an uneven clock, in median steps, that is interpolated over."""
_FEWEST_ODD = 10
"""Odd steps of a coarse clock, evenly spread, that show that its stamps are rounded and no samples dropped."""
_FINE = 0.01
"""Last digit of the stamps, in median steps, below which their rounding is nothing."""
_MOST_NAMED = 5
_AGREE = 0.01
"""Relative difference from which a stated rate contradicts the clock."""


def stated_time(
    samples: int, told: float | None, stated: Sequence[StatedRate], source: str
) -> tuple[np.ndarray, str]:
    """Return the time of a table without a column of time, from the rate, and where the rate comes from.

    Raises
    ------
    InputError
        If no rate is told or stated, or the file states several.
    """
    if told is not None:
        return np.arange(samples) / told, f"no column; {told:g} Hz as told by --rate"
    values = [rate.value for rate in stated]
    if not values:
        raise InputError(
            f"{source}: no column of time and no rate is stated; give --time COLUMN or --rate HZ (points of a static test "
            "have neither, and no clock is made up for them: lumbar diagnose takes a plain table position_mm,force_N as it is)"
        )
    if max(values) > (1 + 1e-6) * min(values):
        found = ", ".join(f"{rate.value:g} Hz ({rate.place})" for rate in stated)
        raise InputError(f"{source}: no column of time, and the file states {found}; choose by --rate HZ")
    return np.arange(samples) / values[0], f"no column; {values[0]:g} Hz as {stated[0].place} says"


def contradictions(record: Record, stated: Sequence[StatedRate]) -> list[str]:
    """Sentences on stated rates that the clock does not have."""
    rate = 1 / record.sampling_time
    return [
        f"the file states {item.value:g} Hz ({item.place}), but its clock has {rate:g} Hz"
        for item in stated
        if abs(item.value / rate - 1) > _AGREE
    ]


def check_forward(time: np.ndarray, lines: Sequence[int] | None, source: str) -> None:
    """Refuse time stamps that are missing, stand twice or go backward, with their lines."""
    problems = Problems(source)
    steps = np.diff(time)
    for found, at, do in (
        ("without a number", np.flatnonzero(~np.isfinite(time)), "mend or cut these rows"),
        (
            "repeated",
            np.flatnonzero(steps == 0) + 1,
            "drop the rows that stand twice; stamps too coarse for an even clock are replaced by --time none --rate HZ",
        ),
        ("backward", np.flatnonzero(steps < 0) + 1, "part the recording there, or choose a part with --trim"),
    ):
        if at.size:
            places = ", ".join(place_of(int(sample), lines) for sample in at[:_MOST_NAMED])
            more = f" and {at.size - _MOST_NAMED} more" if at.size > _MOST_NAMED else ""
            problems.add(f"{places}{more}", f"{at.size} time stamps {found}", do)
    problems.raise_if_any()


def unrounded(time: np.ndarray) -> tuple[np.ndarray, str]:
    """Return the even clock that time stamps of few digits are rounded from, and that in words; else the stamps themselves.

    They are where their last digit is all by which they leave it. With digits as coarse as the clock, a few long or short
    steps would also be samples that were dropped or stand twice: then they are taken for that.
    """
    if len(time) < FEWEST_SAMPLES:
        return time, ""
    number, steps = np.arange(len(time)), np.diff(time)
    usual = float(np.median(steps))
    last = time[
        -max(FEWEST_SAMPLES, len(time) // 10) :
    ]  # of six digits, say, the last stamps have the coarsest
    digit = next(
        (10.0**-k for k in range(10) if np.allclose(last * 10**k, np.rint(last * 10**k), 0, 1e-3)), 0
    )
    odd = np.sum(np.abs(steps - usual) > 0.5 * digit)
    dropped = digit > 0.5 * usual and not _FEWEST_ODD <= odd < len(steps) / 3
    if digit <= _FINE * usual or not odd or dropped:
        return time, ""

    def leaves(rate: float) -> float:
        return float(np.ptp(time - number / rate))

    found = 1 / float(np.polyfit(number, time - time[0], 1)[0])
    widest = 1.2 * digit  # the slope of the line is fitted
    if not leaves(found) <= widest:
        return time, ""
    simpler = (float(f"{found:.{digits}g}") for digits in range(1, 16))
    rate = next((rate for rate in simpler if leaves(rate) <= widest), found)
    return time[0] + number / rate, (
        f"the time stamps are rounded to {1e3 * digit:g} ms: the even clock of {rate:.9g} Hz behind them is taken"
    )


def even_clock(record: Record, lines: Sequence[int] | None) -> tuple[Record, list[str]]:
    """Return the record on an even clock, and what was done to it in sentences.

    A clock within `CLOCK_TOLERANCE` of an even one stays as it is. Otherwise a cubic spline through the samples is read at the
    median rate, and kept between the two samples around: it would overshoot where a sensor is clipped or a tool strikes.

    Raises
    ------
    InputError
        If a step is longer than `LONGEST_STEP` median steps: what happened in between is not known.
    """
    steps = np.diff(record.time)
    step = float(np.median(steps))
    even = record.time[0] + record.sampling_time * np.arange(len(record))
    if np.all(np.abs(record.time - even) <= CLOCK_TOLERANCE * step):
        return record, []
    _check_gaps(record, steps, step, lines)
    # A rate that differs from three digits by the rounding of its time stamps only is rounded.
    rate = 1 / step
    rounded = float(f"{rate:.3g}")
    if abs(rounded / rate - 1) < 1e-3:
        rate = rounded
    time = record.time[0] + np.arange(int((record.time[-1] - record.time[0]) * rate * (1 + 1e-12)) + 1) / rate
    # A cubic spline, within the range of the two samples around each new one.
    from scipy.interpolate import CubicSpline

    channels, after = {}, np.clip(np.searchsorted(record.time, time), 1, len(record) - 1)
    for role, channel in record.channels.items():
        around = channel.values[after - 1], channel.values[after]
        spline = CubicSpline(record.time, channel.values)(time)
        channels[role] = replace(channel, values=np.clip(spline, np.minimum(*around), np.maximum(*around)))
    dropped = int(np.sum(np.maximum(np.round(steps / step) - 1, 0)))
    return replace(record, time=time, channels=channels), [
        f"the clock is uneven (steps of {1e3 * steps.min():.4g} to {1e3 * steps.max():.4g} ms, {dropped} samples dropped): "
        f"resampled to its median rate, {rate:g} Hz, by a cubic spline that stays between neighbouring samples"
    ]


def _check_gaps(record: Record, steps: np.ndarray, step: float, lines: Sequence[int] | None) -> None:
    gaps = np.flatnonzero(steps > LONGEST_STEP * step)
    if not gaps.size:
        return
    problems = Problems(record.source)
    for gap in gaps[:_MOST_NAMED]:
        problems.add(
            place_of(int(gap) + 1, lines),
            f"{steps[gap]:.4g} s without samples, {steps[gap] / step:.4g} median steps",
        )
    edges = [0, *(gaps + 1), len(record)]
    problems.add(
        "",
        f"{gaps.size} gaps are longer than {LONGEST_STEP:g} median steps",
        longest(record.time, edges, step),
    )
    problems.raise_if_any()


def longest(time: np.ndarray, edges: Sequence[int], step: float) -> str:
    """Advice to take the longest part between these samples, as an option that can be typed."""
    first, stop = max(pairwise(edges), key=lambda part: part[1] - part[0])
    return f"the longest part without one is --trim {time[first]:.9g}:{time[stop - 1] + step / 2:.9g}"


def position_of(
    time: np.ndarray, velocity: np.ndarray, keep: np.ndarray, unit: str, lines: Sequence[int] | None = None
) -> tuple[np.ndarray, str]:
    """Integrate a velocity by trapezoids, from 0 at the first sample before which nothing is missing.

    Shape (kept,), in the velocity's unit times seconds; and what was done, without the column's name.

    Parameters
    ----------
    time, velocity : numpy.ndarray
        Shape (samples,), of the whole file: parts of it share their zero.
    keep : numpy.ndarray
        Numbers of the samples that are wanted, without a gap among them.
    unit : str
        Of the position.
    lines : sequence of int, optional
        Line of each sample of the file.
    """
    from scipy.integrate import cumulative_trapezoid

    steps = np.diff(time)
    usual = np.median(steps[keep[0] : keep[-1]])
    broken = ~((steps >= 0) & (steps <= LONGEST_STEP * usual) & np.isfinite(velocity[1:] + velocity[:-1]))
    start = int(max(np.flatnonzero(broken[: keep[0]]) + 1, default=0))
    stretch = slice(start, keep[-1] + 1)
    position = cumulative_trapezoid(velocity[stretch], unrounded(time[stretch])[0], initial=0)
    offset = 0.01 * float(np.sqrt(np.mean(velocity[stretch] ** 2)) * (time[keep[-1]] - time[keep[0]]))
    zero = place_of(start, lines) if start else "the first sample"
    return position[keep - start], (
        f"over time (trapezoids between samples), 0 at {zero}: where the tool stood there is not known, and an offset of the "
        f"velocity would be a drift of the position, by {offset:.3g} {unit} to the end for 1 % of its root mean square"
    )
