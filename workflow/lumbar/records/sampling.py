"""Samples of a record: parts of a recording, missing rows, another rate, flat tops, the frame of its forces.

A force limited by a mechanism (lost contact, a slipping gripper) still has the sensor's noise and does not repeat to the last
digit; the limit of a converter does. The signal beyond it is not in the file.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.record import LARGEST, MIN_SAMPLES, Record, place_of, use_load_as_input
from lumbar.records.rests import find_levels
from lumbar.settings.axes import AXES

MAX_GAP_ROWS = 10
"""Largest number of consecutive missing rows that are filled; in a longer gap the motion is unknown."""
MAX_FILLED_SHARE = 0.05
"""Largest share of a record's rows that is filled."""
_GAP_TOLERANCE_ROWS = 0.1
"""Largest difference of the length of a gap from a whole number of sampling intervals."""
_FILTER_HALF_LENGTH = 10
"""Half the length of the anti-aliasing filter, in samples of the lower of the two rates."""
_MIN_RUN_SAMPLES = 3
"""Smallest number of consecutive samples at the extreme that form a flat top."""
_MIN_TOP_SAMPLES = 6
_MIN_COUNT_RATIO = 5
"""Smallest ratio of samples at the extreme to samples at the next value; a coarse converter repeats all values."""
_MAX_ENTRY_SPEED_RATIO = 1.5
"""Largest ratio of the speeds before commanded holds of a position, which begin with equal speeds."""
_MIN_TOPS = 3
_SPEED_SAMPLES = 4
"""Samples over which the speed before a flat top is measured."""
_RETURN_TIME_FACTOR = 4.0
"""Duration, in speed over deceleration, above which a flat top is a rest; a motion that was cut off is back in half of it."""

_MIN_RESTING_SHARE = 0.5
"""Smallest share of a record that the rests of a commanded channel take."""
_MAX_RETURN_SHARE, _MAX_RETURN_SIGMAS = 0.01, 4.0
"""Largest motion of the other channel beyond both ends of a commanded hold, as a share of its range and in standard deviations of
its noise, which add up."""


def samples_between(time: np.ndarray, trim: tuple[float, float], source: str) -> np.ndarray:
    """Return the indices of the samples with ``start <= time < stop``; samples with the time NaN are left out.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Seconds on the file's clock.
    trim : tuple of float
        Start and stop in seconds.
    source : str
        The file, for messages.

    Raises
    ------
    InputError
        If there are fewer than `MIN_SAMPLES`.
    """
    samples = np.flatnonzero((time >= trim[0] - 1e-9) & (time < trim[1] - 1e-9))
    if len(samples) < MIN_SAMPLES:
        raise InputError(
            f"{source}: {len(samples)} samples from {trim[0]:g} to {trim[1]:g} s; the clock runs from {np.nanmin(time):g} to "
            f"{np.nanmax(time):g} s, and at least {MIN_SAMPLES} samples are needed"
        )
    return samples


def fill_missing_rows(
    record: Record, lines: Sequence[int] | None = None
) -> tuple[Record, Sequence[int] | None]:
    """Fill gaps of a few rows with a cubic spline.

    Parameters
    ----------
    record : Record
        Record before it is validated.
    lines : sequence of int, optional
        Line of each sample in the file.

    Returns
    -------
    Record
        Record with the filled samples in `filled`; `record` itself if no row is missing, or a gap cannot be filled.
    sequence of int or None
        Line of each sample; a filled sample has the line of the sample before it.
    """
    series = {role: channel.values for role, channel in record.channels.items()}
    is_finite = all(np.all(np.abs(values) <= LARGEST) for values in (record.time, *series.values()))
    if len(record.time) < MIN_SAMPLES or not is_finite:
        return record, lines
    steps = np.diff(record.time)
    step = float(np.median(steps))
    if step <= 0:
        return record, lines
    # Every step must be nearly a whole number of sampling intervals.
    share = steps / step
    rows = np.round(share).astype(int)
    missing = rows - 1
    is_even = (np.abs(share - rows) <= _GAP_TOLERANCE_ROWS) & (rows >= 1) & (missing <= MAX_GAP_ROWS)
    is_few = 0 < missing.sum() <= MAX_FILLED_SHARE * len(record.time)
    if not is_even.all() or not is_few:
        return record, lines
    # A spline through the recorded rows gives the missing ones; the recorded values stay.
    from scipy.interpolate import make_interp_spline

    recorded = np.concatenate([[0], np.cumsum(rows)])
    every = np.arange(recorded[-1] + 1)
    filled = {role: make_interp_spline(recorded, values, k=3)(every) for role, values in series.items()}
    for role, values in series.items():
        filled[role][recorded] = values
    if lines is not None:
        lines = np.asarray(lines)[np.searchsorted(recorded, every, side="right") - 1].tolist()
    time, samples = np.interp(every, recorded, record.time), np.setdiff1d(every, recorded)
    return replace(record.with_values(**filled), time=time, filled=tuple(samples.tolist())), lines


def resample(record: Record, rate: float) -> Record:
    """Return a record at another rate, without the samples at its ends.

    A polyphase FIR filter (Kaiser window, zero phase, `scipy.signal.resample_poly`) removes frequencies above the lower of
    the two Nyquist frequencies. Near an end the signal's continuation is unknown. With any assumption a signal in motion rings
    there, which could be mistaken for a mechanism. Ten samples of the lower rate are therefore omitted at each end.

    Parameters
    ----------
    record : Record
        Evenly sampled record.
    rate : float
        New rate in hertz.

    Raises
    ------
    InputError
        If the ratio of the rates is not a fraction with terms up to 1000, or fewer than `MIN_SAMPLES` are left.
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
    up, down = ratio.numerator, ratio.denominator
    omitted = -(-_FILTER_HALF_LENGTH * max(up, down) // down)
    samples = -(
        -len(record) * up // down
    )  # the last one may be up to one old interval after the last one recorded
    inner = slice(omitted, samples - omitted)
    time = record.time[0] + np.arange(samples)[inner] / rate
    if len(time) < MIN_SAMPLES:
        raise InputError(
            f"{record.source}: {record.duration:g} s are too short to be resampled to {rate:g} Hz: "
            f"{omitted} samples are left out at either end; at least {MIN_SAMPLES} must remain"
        )
    values = {
        role: resample_poly(channel.values, up, down, padtype="line")[inner]
        for role, channel in record.channels.items()
    }
    # The sample at the new rate that is nearest to a filled one depends most on it.
    nearest = np.unique(np.round(np.array(record.filled) * float(ratio)).astype(int) - omitted)
    filled = tuple(nearest[(nearest >= 0) & (nearest < len(time))].tolist())
    return replace(record.with_values(**values), time=time, filled=filled)


def runs(flags: np.ndarray) -> Iterator[slice]:
    """Yield the contiguous intervals of true flags.

    Parameters
    ----------
    flags : ndarray of bool, shape (n,)
        Flag of each sample.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([0], np.asarray(flags, dtype=np.int8), [0]))))
    for start, stop in edges.reshape(-1, 2):
        yield slice(int(start), int(stop))


@dataclass(frozen=True)
class FlatTop:
    """Samples at one extreme of a channel."""

    level: float
    samples: int
    """Samples in flat tops."""
    starts: np.ndarray
    """First sample of every flat top."""


def _flat_tops(values: np.ndarray) -> list[FlatTop]:
    """Return the flat tops at the largest and at the smallest value; none if a channel is not clipped."""
    tops: list[FlatTop] = []
    for extreme in (np.max, np.min):
        level = extreme(values)
        inside = values[values != level]
        if not inside.size:
            return []
        count, next_count = len(values) - len(inside), int(np.sum(inside == extreme(inside)))
        if count + next_count == len(values):  # a switch has two levels
            return []
        long = [run for run in runs(values == level) if run.stop - run.start >= _MIN_RUN_SAMPLES]
        samples = sum(run.stop - run.start for run in long)
        if samples >= _MIN_TOP_SAMPLES and count > _MIN_COUNT_RATIO * next_count:
            tops.append(FlatTop(float(level), samples, np.array([run.start for run in long])))
    return tops


def _comes_to_rest(top: FlatTop, values: np.ndarray) -> np.ndarray:
    """Return for every flat top whether the motion stops there instead of being cut off: bool, shape (tops,).

    A motion that is cut off would reverse after speed over deceleration, and be back after twice this time; a rest begins with
    zero speed, or is longer.
    """
    rests = np.zeros(len(top.starts), dtype=bool)
    for number, start in enumerate(top.starts):
        if start < 2 * _SPEED_SAMPLES:
            rests[number] = start == 0
            continue
        late = abs(values[start] - values[start - _SPEED_SAMPLES]) / _SPEED_SAMPLES
        early = abs(values[start - _SPEED_SAMPLES] - values[start - 2 * _SPEED_SAMPLES]) / _SPEED_SAMPLES
        speed, deceleration = late - (early - late) / 2, (early - late) / _SPEED_SAMPLES
        moved = np.flatnonzero(values[start:] != top.level)
        duration = moved[0] if moved.size else len(values) - start
        rests[number] = deceleration > 0 and duration * deceleration > _RETURN_TIME_FACTOR * speed
    return rests


def _is_commanded(values: np.ndarray, response: np.ndarray) -> bool:
    """Return whether a channel jumps between levels, or rests most of the time while the other channel only settles.

    If a motion is cut off, the other channel moves on and back, beyond its values at both ends of the hold.
    """
    levels = find_levels(values)
    if levels is not None and levels.jumps:
        return True
    rests = [run for run in runs(np.diff(values) == 0) if run.stop - run.start >= _MIN_RUN_SAMPLES]
    if sum(run.stop - run.start for run in rests) < _MIN_RESTING_SHARE * len(values):
        return False
    holds = [response[run] for run in rests]
    beyond = [max(hold.max() - max(hold[0], hold[-1]), min(hold[0], hold[-1]) - hold.min()) for hold in holds]
    noise = 1.4826 * float(np.median(np.abs(np.diff(response, 2)))) / np.sqrt(6)
    return (
        float(np.median(beyond)) <= _MAX_RETURN_SHARE * float(np.ptp(response)) + _MAX_RETURN_SIGMAS * noise
    )


def check_clipping(record: Record, lines: Sequence[int] | None = None, load_drives: bool = False) -> None:
    """Raise if the force or the position of a record is clipped; a rest or a commanded level is not.

    Only input and output channels are checked, because surgeons and subjects may rest anywhere.

    Parameters
    ----------
    record : Record
        The record.
    lines : sequence of int, optional
        Line of each sample in the file, for messages.
    load_drives : bool, optional
        True if the load is the input of the test: it is commanded, and only the motion is checked.

    Raises
    ------
    InputError
        If a channel is clipped, with level, number of samples and intervals of every clipped channel.
    """
    problems = Problems(record.source or record.name)
    commanded = use_load_as_input(record)["input"] if load_drives and not record.axes else None
    for role, channel in record.channels.items():
        if channel.values is commanded:
            continue
        excites = role in record.roles("input")
        if not excites and role not in (*record.roles("output"), "moment"):
            continue
        tops = _flat_tops(channel.values)
        other = (
            role.replace("input", "output")
            if excites
            else role.replace("output", "input").replace("moment", "input")
        )
        if tops and other in record.channels and _is_commanded(channel.values, record[other]):
            continue
        for top in tops:
            if excites:  # a position that rests at its extreme stops only a few times, or always at one speed
                values = channel.values
                entries = top.starts[(top.starts >= 2) & ~_comes_to_rest(top, values)]
                speeds = np.abs(values[entries - 1] - values[entries - 2])
                if len(entries) < _MIN_TOPS or speeds.max() <= _MAX_ENTRY_SPEED_RATIO * speeds.min():
                    continue
            problems.add(
                role,
                f"clipped: {top.samples} samples are exactly {top.level:g} {channel.unit}, in {len(top.starts)} intervals, the "
                f"first at {place_of(top.starts[0], lines)}",
                "record with a larger range, remove these intervals, or accept them with the layout's 'clipped: accept'",
            )
    problems.raise_if_any()


def rotate_forces(record: Record, rotation_vector_deg: Sequence[float] | None) -> Record:
    """Return a record of several axes with its forces in the axes of its position.

    Parameters
    ----------
    record : Record
        Forces in the sensor's axes.
    rotation_vector_deg : sequence of three float, or None
        Rotation R from the sensor's axes to the position's, ``f_position = R f_sensor``: along the axis of rotation, its length
        the angle in degrees, right-handed. R's columns are the sensor's axes in position axes. None: no rotation.

    Raises
    ------
    InputError
        If the record has one axis, or two axes and the rotation leaves their plane.
    """
    if rotation_vector_deg is None or not any(rotation_vector_deg):
        return record
    if not record.axes:
        raise InputError(f"{record.name}: has one axis; tissue.force_frame turns the forces of several")
    from scipy.spatial.transform import Rotation

    chosen = [AXES.index(axis) for axis in record.axes]
    out_of_plane = [AXES[index] for index in chosen if rotation_vector_deg[index]]
    if out_of_plane and len(chosen) < len(AXES):
        normal = next(axis for axis in AXES if axis not in record.axes)
        raise InputError(
            f"{record.name}: tissue.force_frame turns about {' and '.join(out_of_plane)}, but the record has the axes "
            f"{' and '.join(record.axes)}; only its component along {normal} may differ from 0"
        )
    is_input = record.channels[record.roles("input")[0]].quantity == "force"
    side = "input" if is_input else "output"
    roles, forces = record.roles(side), record.stacked(side)
    rotation = Rotation.from_rotvec(rotation_vector_deg, degrees=True).as_matrix()
    rotated = rotation[np.ix_(chosen, chosen)] @ forces
    return record.with_values(**dict(zip(roles, rotated, strict=True)))
