"""Samples that are not measurements: missing rows, outliers, values held by the sensor, rows that were dropped unnoticed."""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.models.transfer_function import filtered

_RELAXATION_TIMES = (0.03, 0.1, 0.3, 1.0, 3.0)
"""In the record's time scale."""


@dataclass(frozen=True, eq=False)
class Repair:
    """A record without a fault of its sensor or clock, and the findings on the fault."""

    record: Record
    findings: tuple[Finding, ...]
    """Faults with their sizes and what to do."""


def linear_response(record: Record, left_out: np.ndarray | None = None) -> np.ndarray:
    """Force of the linear tissue that fits a record: a constant, stiffness, damping and relaxing branches.

    Roughly: to fill samples in, and to see whether a repair helps.

    The result has shape (samples,); not fitted to the samples `left_out`.
    """
    position, step = record["input"] - record["input"][0], record.sampling_time
    columns = [np.ones(len(position)), position, np.gradient(position, step)]
    for time in _RELAXATION_TIMES:
        decay = np.exp(-step / (time * record.time_scale))
        columns.append(filtered([1 - decay], [1.0, -decay], position))
    columns = np.column_stack(columns)
    kept = np.ones(len(position), dtype=bool)
    if left_out is not None:
        kept[left_out] = False
    return columns @ np.linalg.lstsq(columns[kept], record["output"][kept], rcond=1e-10)[0]


# Wild readings
_BESIDE_WILD = 7
"""Samples of the running median that a wild one is measured from."""
_MOST_WILD = 1e-3
"""Largest share of outliers: what is more frequent belongs to the force."""
# Held values
_LONGEST = 25
"""Largest number of repeated samples in a row; a longer rest may be intended."""
_BESIDE = 3
"""Samples on either side over which the speed is taken."""
_STEPS_OF_RESOLUTION = 20
"""Size of the changes next to a run, in steps of the channel's resolution, at which equal neighbours do not occur by chance."""
_VARIED = 0.5
"""Smallest share of runs with different values: those of a dead zone share one."""
_NEXT_TO_ANOTHER = 0.5
"""Smallest share of moving samples next to a run, in a channel that is held elsewhere."""
_FEWEST_RUNS = 2
_CHANCE = (5, 4)
"""Offset and factor: runs of two equal values are reported if there are more than offset + factor × the number by chance."""
_LONG = 0.2
"""Share of runs of three equal values and more that is never by chance."""
_DIGITS = 2e-6
"""Resolution of values written with six or seven digits, in the largest of them."""
_FINE = 1e-3
"""Smallest detectable resolution, relative to the median step from sample to sample."""
_NEAR = 0.05
"""Largest difference of nearly equal values, relative to that step."""
_JUMPS = (0.4, 6.0)
"""Jump after a run over the travel that its neighbours' speed makes of it; less is a start after a rest."""
_SHARE = 0.6
"""Share of the runs that must catch up, of those whose speed shows it."""
_SMOOTH = 0.7
"""Change of the steps over the steps, below which a channel moves smoothly."""
# Dropped rows
_MOST_TOGETHER = 3
"""Largest number of samples lost in one place; if more would fit better, a corner of the motion may look like them."""
_DEGREE = 5
_POINTS = 12
"""Points of the polynomial through a place, half of them on either side."""
_CLEAR = 100.0
"""Ratio of the squared misfit at a jump to the median of the record."""
_CURED = 30.0
"""Factor by which the squared misfit must fall if samples are inserted."""
_FEWEST_STEPS = 0.03
"""Smallest travel per sample, relative to that of the whole record, at which a loss is reported."""


def find_gaps(record: Record) -> Repair | None:
    """Find rows that the clock says are missing; they were filled in when the record was read."""
    if not record.filled:
        return None
    count = len(record.filled)
    sentence = (
        f"{record.name}: {count} row{'s are' if count > 1 else ' is'} missing, the first at "
        f"{record.time[record.filled[0]]:.4g} s. Missing samples were interpolated; check whether rows are lost while recording."
    )
    finding = Finding("gap", sentence, count, "samples", record.name)
    return Repair(record, (finding,))


def find_outliers(record: Record) -> Repair | None:
    """Find single readings of the force far outside the range of all others, e.g. from a loose contact or a lost bit.

    A reading is an outlier if it is farther from the median of the seven samples about it than the range of the medians of the
    whole record. A force that jumps, or stays for more than one sample, is not. Outliers are replaced by linear interpolation.
    """
    force = record["output"]
    near = sliding_window_view(np.pad(force, _BESIDE_WILD // 2, "edge"), _BESIDE_WILD)
    smooth = np.median(near, axis=1)
    wild = np.flatnonzero(np.abs(force - smooth) > np.ptp(smooth))
    alone = wild[(wild > 0) & (wild < len(force) - 1)]
    if not len(alone) or len(alone) < len(wild) or len(wild) > max(1.0, _MOST_WILD * len(force)):
        return None
    if not np.all(np.diff(alone) > 1):
        return None
    channel, count = record.channels["output"], len(alone)
    worst = float(force[alone][np.argmax(np.abs(force[alone]))])
    sentence = (
        f"{record.name}: {count} outlier{'s' * (count > 1)} of the {channel.quantity} outside the range of all other samples, "
        f"the first at {record.time[alone[0]]:.4g} s, the largest {worst:.3g} {channel.unit}. Outliers were interpolated; check "
        "for a loose contact or readings that were lost on the way."
    )
    finding = Finding("wild_samples", sentence, count, "samples", record.name)
    repaired = force.copy()
    repaired[alone] = 0.5 * (force[alone - 1] + force[alone + 1])
    return Repair(record.with_values(output=repaired), (finding,))


def find_stuck_samples(record: Record, role: str) -> Repair | None:
    """Find samples of a channel that stays at one value for a few samples while it is moving, and then catches up.

    They are interpolated by a cubic spline, and noted as filled. Of a force, what a linear tissue makes of the position is taken
    off first: the position is known there.
    """
    found = _held_samples(record[role])
    if found is None:
        return None
    samples, runs = found
    sentence = (
        f"{record.name}: the {record.channels[role].quantity} is constant over {len(samples)} samples in {runs} places while it "
        f"moves, the first at {record.time[samples[0]]:.4g} s. These samples were interpolated; check whether a sensor is read "
        "too often or messages are lost."
    )
    finding = Finding("held_samples", sentence, len(samples), "samples", record.name)
    known = linear_response(record, samples) if role == "output" else np.zeros(len(record))
    values = record[role].copy()
    kept = np.setdiff1d(np.arange(len(record)), samples)
    values[samples] = known[samples] + scipy.interpolate.make_interp_spline(
        kept, (values - known)[kept], k=3
    )(samples)
    filled = tuple(np.union1d(record.filled, samples).astype(int).tolist())
    return Repair(replace(record.with_values(**{role: values}), filled=filled), (finding,))


def _held_samples(values: np.ndarray) -> tuple[np.ndarray, int] | None:
    """Every sample of a channel that repeats the one before while it moved, and in how many runs; or None.

    A rest, a flat top, a dead zone and the crest of a wave repeat a value too. A held sample differs from them in that
    the channel moves on both sides of it, that the runs stand at different values, and that the value jumps afterwards to
    where the motion has gone. Where noise hides that jump, values that are far finer than the noise do not repeat by
    chance.
    """
    steps = np.diff(values)
    starts, lengths = _runs(steps)
    if len(starts) < _FEWEST_RUNS:
        return None
    resolution = _resolution(values, steps)
    shares = _moving(steps, starts, lengths, resolution)
    shares[(values[starts] == values.max()) | (values[starts] == values.min())] = 0
    every = starts, lengths
    starts, lengths = starts[shares == 1], lengths[shares == 1]
    if len(starts) < _FEWEST_RUNS or len(np.unique(values[starts])) < _VARIED * len(starts):
        return None
    several = np.sum(lengths > 1) >= max(_FEWEST_RUNS, _LONG * len(starts))
    if not several and len(starts) < _CHANCE[0] + _CHANCE[1] * _by_chance(steps, resolution):
        return None
    if not _caught_up(steps, starts, lengths):
        return None
    # Of two runs close to each other either hides that the channel moves beside the other.
    beside = (shares >= _NEXT_TO_ANOTHER) & (every[1] <= lengths.max())
    starts, lengths = (found[beside] for found in every)
    samples = np.concatenate(
        [start + 1 + np.arange(length) for start, length in zip(starts, lengths, strict=True)]
    )
    return samples, len(starts)


def _runs(steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First sample of every run of equal values, and how many samples repeat it."""
    equal = np.concatenate([[False], steps == 0, [False]])
    starts = np.flatnonzero(~equal[:-1] & equal[1:])
    return starts, np.flatnonzero(equal[:-1] & ~equal[1:]) - starts


def _resolution(values: np.ndarray, steps: np.ndarray) -> float:
    """Smallest distance between two values that occur, and no less than what digits that were cut off may make of it."""
    gaps = np.diff(np.unique(values))
    least = max(_DIGITS * np.abs(values).max(), _FINE * float(np.median(np.abs(steps[steps != 0]))))
    gaps = gaps[gaps > least]
    return float(gaps.min()) if gaps.size else least


def _moving(steps: np.ndarray, starts: np.ndarray, lengths: np.ndarray, resolution: float) -> np.ndarray:
    """Share of the samples beside every run at which the channel moves; 0 where it moves by little more than its resolution."""
    before = starts[:, None] - 1 - np.arange(_BESIDE)
    after = (starts + lengths)[:, None] + np.arange(_BESIDE + 1)
    inside = (before.min(axis=1) >= 0) & (after.max(axis=1) < len(steps)) & (lengths <= _LONGEST)
    beside = np.abs(steps[np.clip(np.hstack([before, after]), 0, len(steps) - 1)])
    moves = beside > 0
    usual = beside.sum(axis=1) / np.maximum(moves.sum(axis=1), 1)
    return np.where(inside & (usual > _STEPS_OF_RESOLUTION * resolution), moves.mean(axis=1), 0.0)


def _by_chance(steps: np.ndarray, resolution: float) -> float:
    """Equal neighbours to be expected of a channel that is read to this resolution: as dense as those that are nearly equal."""
    near = max(_NEAR * float(np.median(np.abs(steps[steps != 0]))), 2.5 * resolution)
    return float(np.sum((steps != 0) & (np.abs(steps) < near)) * resolution / (2 * near))


def _caught_up(steps: np.ndarray, starts: np.ndarray, lengths: np.ndarray) -> bool:
    """Whether the channel jumps after its runs to where it would have gone; or is too rough to show it."""
    before = starts[:, None] - 1 - np.arange(_BESIDE)
    after = (starts + lengths + 1)[:, None] + np.arange(_BESIDE)
    near = np.hstack([before[:, ::-1], after])
    speed = steps[near].mean(axis=1)
    roughness = np.median(np.abs(np.diff(steps[near], axis=1)), axis=1)
    jump = steps[starts + lengths] / np.where(speed == 0, np.inf, speed * (lengths + 1))
    clear = np.abs(speed) * lengths > 2 * roughness
    if clear.sum() >= _FEWEST_RUNS:
        return bool(np.mean((jump[clear] > _JUMPS[0]) & (jump[clear] < _JUMPS[1])) >= _SHARE)
    moved = np.abs(steps[steps != 0])
    return bool(np.median(np.abs(np.diff(steps))) > _SMOOTH * np.median(moved))


def find_dropped(record: Record) -> Repair | None:
    """Find rows that were lost and whose times were written evenly all the same: the position jumps by whole samples' travel.

    Through the samples on either side of every place a polynomial is laid, as they stand and as they would stand with one to
    `_MOST_TOGETHER` samples missing between. A corner of the motion, a step or a spike fits neither way; a lost sample fits
    once it is put in. The lost samples are put in by a cubic spline and noted as filled; the clock goes on for longer.
    """
    values = record["input"]
    if len(values) < 4 * _POINTS:
        return None
    half = _POINTS // 2
    travel = np.abs(np.diff(values))
    moving = (
        scipy.ndimage.uniform_filter1d(travel, _POINTS - 1)[half - 1 : -half + 1]
        > _FEWEST_STEPS * travel.mean()
    )
    misfit = sum(np.convolve(values, column[::-1], "valid") ** 2 for column in _across(0))
    usual = np.median(misfit[moving]) + (1e-7 * np.ptp(values)) ** 2
    windows = np.flatnonzero((misfit > _CLEAR * usual) & moving)
    if not windows.size:
        return None
    around = values[windows[:, None] + np.arange(_POINTS)]
    put_in = np.array(
        [np.sum((around @ _across(missing).T) ** 2, axis=1) for missing in range(1, _MOST_TOGETHER + 3)]
    )
    best, least = put_in.argmin(axis=0) + 1, put_in.min(axis=0)
    cured = np.zeros(len(misfit))
    cured[windows] = misfit[windows] / np.maximum(least, 1e-3 * usual)
    lost = (cured[windows] > _CURED) & (best <= _MOST_TOGETHER)
    lost &= cured[windows] >= scipy.ndimage.maximum_filter1d(cured, 2 * half - 1)[windows]
    return _insert(record, windows[lost] + half - 1, best[lost]) if lost.any() else None


def _across(missing: int) -> np.ndarray:
    """What is at right angles to all polynomials through `_POINTS` samples, so many missing in their middle."""
    half = _POINTS // 2
    places = np.concatenate([np.arange(half), half + missing + np.arange(half)]).astype(float)
    places = (places - places.mean()) / np.ptp(places)
    return np.linalg.qr(np.vander(places, _POINTS, increasing=True))[0][:, _DEGREE + 1 :].T


def _insert(record: Record, places: np.ndarray, missing: np.ndarray) -> Repair:
    """Put so many missing samples in after each of these places."""
    count = int(missing.sum())
    sentence = (
        f"{record.name}: the motion jumps in {len(places)} place{'s' * (len(places) > 1)} by the travel of {count} "
        f"sample{'s' * (count > 1)}, first after {record.time[places[0]]:.4g} s: rows were lost, but the clock does not show it. "
        "They were interpolated; record time stamps where the samples are taken."
    )
    finding = Finding("dropped_samples", sentence, count, "samples", record.name)
    late = np.zeros(len(record), dtype=int)
    late[places + 1] = missing
    measured = np.arange(len(record)) + np.cumsum(late)
    every = np.arange(measured[-1] + 1)
    channels = {}
    for role, channel in record.channels.items():
        values = scipy.interpolate.make_interp_spline(measured, channel.values, k=3)(every)
        values[measured] = channel.values
        channels[role] = replace(channel, values=values)
    filled = np.union1d(np.setdiff1d(every, measured), measured[list(record.filled)]).astype(int)
    time = record.time[0] + record.sampling_time * every
    return Repair(replace(record, time=time, channels=channels, filled=tuple(filled.tolist())), (finding,))
