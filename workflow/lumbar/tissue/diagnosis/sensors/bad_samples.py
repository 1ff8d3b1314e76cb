"""Samples that are not measurements: missing rows, outliers, values repeated by the sensor, lost rows without a gap in time."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.models.transfer_function import filtered

_RELAXATION_TIMES = (0.03, 0.1, 0.3, 1.0, 3.0)
"""Relaxation times of `linear_response` in time scales of the record."""


@dataclass(frozen=True, eq=False)
class Repair:
    """A record after repair of a fault of a sensor or clock, and the findings on the fault."""

    record: Record
    findings: tuple[Finding, ...]


def linear_response(record: Record, left_out: np.ndarray | None = None) -> np.ndarray:
    """Return the force of a tissue with relaxations fitted to a record without the samples `left_out`, shape (samples,)."""
    position, step = record["input"] - record["input"][0], record.sampling_time
    columns = [np.ones(len(position)), position, np.gradient(position, step)]
    for time in _RELAXATION_TIMES:
        decay = np.exp(-step / (time * record.time_scale))
        columns.append(filtered([1 - decay], [1.0, -decay], position))
    columns = np.column_stack(columns)
    fitted = np.ones(len(position), dtype=bool)
    if left_out is not None:
        fitted[left_out] = False
    return columns @ np.linalg.lstsq(columns[fitted], record["output"][fitted], rcond=1e-10)[0]


# Outliers
_MEDIAN_WINDOW = 7
"""Number of samples of the running median that outliers are compared with."""
_MAX_OUTLIER_SHARE = 1e-3
"""Largest share of outliers: more frequent outliers belong to the force."""
_MIN_JUMP = 0.1
"""Smallest step of a position that jumps, as a share of its range."""
# Stuck values
_MAX_RUN_LENGTH = 25
"""Largest number of repeated samples in a row; a longer rest may be intended."""
_SPEED_SAMPLES = 3
"""Number of samples on either side of a run from which the speed is computed."""
_MIN_STEP_RATIO = 20
"""Smallest changes next to a run, in resolution steps of the channel, at which equal neighbours do not occur by chance."""
_MIN_VARIED_SHARE = 0.5
"""Smallest share of runs with different values: all runs in a dead zone have one value."""
_MIN_MOVING_SHARE = 0.5
"""Smallest share of moving samples next to a stuck run, in a channel with clearly stuck runs elsewhere."""
_MIN_RUNS = 2
_MAX_CHANCE, _UNCERTAIN_RUNS = 1e-4, 0.5
"""Largest probability that rounding causes as many runs of two equal values; runs added to the expected ones in this test."""
_MIN_LONG_SHARE = 0.2
"""Smallest share of runs of three equal values or more that cannot be chance."""
_DIGITS = 2e-6
"""Resolution of values written with six or seven digits, relative to the largest value."""
_MIN_RESOLUTION = 1e-3
"""Smallest detectable resolution, relative to the median step from sample to sample."""
_MAX_NEAR_DIFFERENCE = 0.05
"""Largest difference of nearly equal values, relative to the median step from sample to sample."""
_JUMP_RATIOS = (0.4, 6.0)
"""Smallest and largest ratio of the jump after a run to the travel at its neighbours' speed; less is a start after a rest."""
_MIN_JUMP_SHARE = 0.6
"""Smallest share of runs with a jump among the runs with a clear speed."""
_MAX_ROUGHNESS = 0.7
"""Largest ratio of the changes of steps to the steps in a channel that moves smoothly."""
_MIN_REPEATED_SHARE = 0.01
"""Smallest share of repeated samples in a rough channel: rounding before a resampling repeats fewer."""
# Lost rows
_MAX_LOST = 3
"""Largest number of samples lost in one place; if a larger number fits better, the place may be a corner of the motion."""
_DEGREE = 5
_POINTS = 12
"""Number of samples to which a polynomial is fitted around a place, half of them on either side."""
_MIN_MISFIT_RATIO = 100.0
"""Smallest ratio of the squared misfit at a jump to the median of the record."""
_MIN_IMPROVEMENT = 30.0
"""Smallest factor by which the squared misfit falls if lost samples are inserted."""
_MIN_TRAVEL = 0.03
"""Smallest travel per sample, relative to that of the whole record, at which a loss is reported."""


def find_gaps(record: Record) -> Repair | None:
    """Find missing rows by gaps in time; they were filled in when the record was read."""
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

    An outlier differs from the running median of seven samples by more than the range of all such medians. A jump of the force, a
    peak of more than one sample, or a force near a jump of the position is not an outlier. Outliers are replaced by linear
    interpolation.
    """
    force = record["output"]
    near = sliding_window_view(np.pad(force, _MEDIAN_WINDOW // 2, "edge"), _MEDIAN_WINDOW)
    smooth = np.median(near, axis=1)
    steps = np.abs(np.diff(record["input"], prepend=record["input"][0]))
    jumps = scipy.ndimage.maximum_filter1d(steps, _MEDIAN_WINDOW) > _MIN_JUMP * np.ptp(record["input"])
    outliers = np.flatnonzero((np.abs(force - smooth) > np.ptp(smooth)) & ~jumps)
    count = len(outliers)
    if not 0 < count <= max(1.0, _MAX_OUTLIER_SHARE * len(force)) or np.any(np.diff(outliers) == 1):
        return None
    if outliers[0] == 0 or outliers[-1] == len(force) - 1:
        return None
    channel = record.channels["output"]
    worst = float(force[outliers][np.argmax(np.abs(force[outliers]))])
    sentence = (
        f"{record.name}: {count} outlier{'s' * (count > 1)} of the {channel.quantity} outside the range of all other samples, "
        f"the first at {record.time[outliers[0]]:.4g} s, the largest {worst:.3g} {channel.unit}. Outliers were interpolated; "
        "check for a loose contact or readings that were lost on the way."
    )
    finding = Finding("wild_samples", sentence, count, "samples", record.name)
    repaired = force.copy()
    repaired[outliers] = 0.5 * (force[outliers - 1] + force[outliers + 1])
    return Repair(record.with_values(output=repaired), (finding,))


def find_stuck_samples(record: Record, role: str) -> Repair | None:
    """Find samples of a channel that repeats one value for a few samples while it moves, and then jumps.

    These samples are interpolated by a cubic spline, and noted as filled. The response of a linear tissue to the known position
    is first subtracted from a force.
    """
    runs = _stuck_runs(record[role])
    if runs is None:
        return None
    samples = np.concatenate([start + 1 + np.arange(length) for start, length in zip(*runs, strict=True)])
    sentence = (
        f"{record.name}: the {record.channels[role].quantity} is constant over {len(samples)} samples in {len(runs[0])} places "
        f"while it moves, the first at {record.time[samples[0]]:.4g} s. These samples were interpolated; check whether a sensor "
        "is read too often or messages are lost."
    )
    finding = Finding("held_samples", sentence, len(samples), "samples", record.name)
    known = linear_response(record, samples) if role == "output" else np.zeros(len(record))
    measured = np.setdiff1d(np.arange(len(record)), samples)
    spline = scipy.interpolate.make_interp_spline(measured, (record[role] - known)[measured], k=3)
    values = record[role].copy()
    values[samples] = known[samples] + spline(samples)
    filled = tuple(np.union1d(record.filled, samples).astype(int).tolist())
    return Repair(record.with_samples(record.time, {role: values}, filled), (finding,))


def _stuck_runs(values: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the first samples of all runs in which a moving channel was stuck, and their numbers of repetitions, or None.

    Values also repeat in a rest, a flat top, a dead zone and the crest of a wave. Stuck runs differ: the channel moves on both
    sides of them, they have different values, and the channel jumps to the present value of the motion after them. If noise hides
    the jump, repetition is still evidence, because values with a resolution far below the noise do not repeat by chance.
    """
    steps = np.diff(values)
    equal = np.concatenate([[False], steps == 0, [False]])
    starts = np.flatnonzero(~equal[:-1] & equal[1:])
    lengths = np.flatnonzero(equal[:-1] & ~equal[1:]) - starts
    if len(starts) < _MIN_RUNS:
        return None
    resolution = _resolution(values, steps)
    shares = _moving_shares(steps, starts, lengths, resolution)
    shares[(values[starts] == values.max()) | (values[starts] == values.min())] = 0
    sure, sure_lengths = starts[shares == 1], lengths[shares == 1]
    if len(sure) < _MIN_RUNS or len(np.unique(values[sure])) < _MIN_VARIED_SHARE * len(sure):
        return None
    if np.sum(sure_lengths > 1) < max(_MIN_RUNS, _MIN_LONG_SHARE * len(sure)):
        # Runs of two may be chance: steps that are rounded to 0 are as dense as other small steps.
        near = max(_MAX_NEAR_DIFFERENCE * float(np.median(np.abs(steps[steps != 0]))), 2.5 * resolution)
        expected = np.sum((steps != 0) & (np.abs(steps) < near)) * resolution / (2 * near - resolution)
        if scipy.special.pdtrc(len(sure) - 1, expected + _UNCERTAIN_RUNS) > _MAX_CHANCE:
            return None
    if not _jumps_after_runs(steps, sure, sure_lengths):
        return None
    # Close to another run, a run need not move on both sides.
    stuck = (shares >= _MIN_MOVING_SHARE) & (lengths <= sure_lengths.max())
    return starts[stuck], lengths[stuck]


def _resolution(values: np.ndarray, steps: np.ndarray) -> float:
    """Return the smallest distance between two values, at least the resolution of truncated digits."""
    gaps = np.diff(np.unique(values))
    least = max(_DIGITS * np.abs(values).max(), _MIN_RESOLUTION * float(np.median(np.abs(steps[steps != 0]))))
    gaps = gaps[gaps > least]
    return float(gaps.min()) if gaps.size else least


def _moving_shares(
    steps: np.ndarray, starts: np.ndarray, lengths: np.ndarray, resolution: float
) -> np.ndarray:
    """Return the share of moving samples next to every run; 0 if their steps are not far above the resolution."""
    before = starts[:, None] - 1 - np.arange(_SPEED_SAMPLES)
    after = (starts + lengths)[:, None] + np.arange(_SPEED_SAMPLES + 1)
    inside = (before.min(axis=1) >= 0) & (after.max(axis=1) < len(steps)) & (lengths <= _MAX_RUN_LENGTH)
    sizes = np.abs(steps[np.clip(np.hstack([before, after]), 0, len(steps) - 1)])
    moves = sizes > 0
    mean = sizes.sum(axis=1) / np.maximum(moves.sum(axis=1), 1)
    return np.where(inside & (mean > _MIN_STEP_RATIO * resolution), moves.mean(axis=1), 0.0)


def _jumps_after_runs(steps: np.ndarray, starts: np.ndarray, lengths: np.ndarray) -> bool:
    """Return whether the channel jumps after its runs to the expected values, or is too rough to show jumps."""
    before = starts[:, None] - 1 - np.arange(_SPEED_SAMPLES)
    after = (starts + lengths + 1)[:, None] + np.arange(_SPEED_SAMPLES)
    near = np.hstack([before[:, ::-1], after])
    speed = steps[near].mean(axis=1)
    roughness = np.median(np.abs(np.diff(steps[near], axis=1)), axis=1)
    jump = steps[starts + lengths] / np.where(speed == 0, np.inf, speed * (lengths + 1))
    clear = np.abs(speed) * lengths > 2 * roughness
    if clear.sum() >= _MIN_RUNS:
        jumps = (jump[clear] > _JUMP_RATIOS[0]) & (jump[clear] < _JUMP_RATIOS[1])
        return bool(np.mean(jumps) >= _MIN_JUMP_SHARE)
    is_rough = np.median(np.abs(np.diff(steps))) > _MAX_ROUGHNESS * np.median(np.abs(steps[steps != 0]))
    return bool(is_rough and lengths.sum() > _MIN_REPEATED_SHARE * len(steps))


def find_dropped(record: Record) -> Repair | None:
    """Find lost rows that are not visible in the time column: the position jumps by the travel of whole samples.

    A polynomial is fitted to the samples on either side of every place, as recorded and with one to `_MAX_LOST` samples missing
    between them. A corner of the motion, a step or a spike fits in neither case; a loss fits if the lost samples are inserted.
    Lost samples are interpolated by a cubic spline and noted as filled; the record becomes longer.
    """
    values = record["input"]
    if len(values) < 4 * _POINTS:
        return None
    half = _POINTS // 2
    travel = np.abs(np.diff(values))
    smooth = scipy.ndimage.uniform_filter1d(travel, _POINTS - 1)[half - 1 : -half + 1]
    moving = smooth > _MIN_TRAVEL * travel.mean()
    misfit = sum(np.convolve(values, column[::-1], "valid") ** 2 for column in _polynomial_annihilator(0))
    typical = np.median(misfit[moving]) + (1e-7 * np.ptp(values)) ** 2
    windows = np.flatnonzero((misfit > _MIN_MISFIT_RATIO * typical) & moving)
    if not windows.size:
        return None
    around = values[windows[:, None] + np.arange(_POINTS)]
    columns = (_polynomial_annihilator(missing).T for missing in range(1, _MAX_LOST + 3))
    inserted = np.array([np.sum((around @ column) ** 2, axis=1) for column in columns])
    best, least = inserted.argmin(axis=0) + 1, inserted.min(axis=0)
    improvement = np.zeros(len(misfit))
    improvement[windows] = misfit[windows] / np.maximum(least, 1e-3 * typical)
    lost = (improvement[windows] > _MIN_IMPROVEMENT) & (best <= _MAX_LOST)
    lost &= improvement[windows] >= scipy.ndimage.maximum_filter1d(improvement, 2 * half - 1)[windows]
    return _insert(record, windows[lost] + half - 1, best[lost]) if lost.any() else None


def _polynomial_annihilator(missing: int) -> np.ndarray:
    """Return rows orthogonal to all polynomials through `_POINTS` samples with `missing` samples in their middle."""
    half = _POINTS // 2
    places = np.concatenate([np.arange(half), half + missing + np.arange(half)]).astype(float)
    places = (places - places.mean()) / np.ptp(places)
    return np.linalg.qr(np.vander(places, _POINTS, increasing=True))[0][:, _DEGREE + 1 :].T


def _insert(record: Record, places: np.ndarray, missing: np.ndarray) -> Repair:
    """Insert given numbers of missing samples after given places."""
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
    values = {}
    for role, channel in record.channels.items():
        values[role] = scipy.interpolate.make_interp_spline(measured, channel.values, k=3)(every)
        values[role][measured] = channel.values
    filled = np.union1d(np.setdiff1d(every, measured), measured[list(record.filled)]).astype(int)
    time = record.time[0] + record.sampling_time * every
    return Repair(record.with_samples(time, values, tuple(filled.tolist())), (finding,))
