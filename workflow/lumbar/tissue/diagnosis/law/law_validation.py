"""Tests of a formula before it is proposed: it must stay bounded, release no energy, and have a known range."""

from dataclasses import dataclass, field, replace

import numpy as np

from lumbar.tissue.diagnosis.fitting.fit_data import MIN_SAMPLES_PER_CYCLE, FitData, JointData, band_edge
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.joint_fit import fit as refit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.models.motion import Motion

BLOCK = 1.0
"""Length of a block, in time scales of the motion."""
STRETCH = 1.5
"""Factor on amplitude and speed of the records up to which a law must stay bounded."""
_MAX_FORCE_RATIO = 10.0
"""Largest force of a bounded law, relative to the largest force of the records."""
_SIZES = (0.3, 0.65, 1.0)
"""Amplitudes in half ranges, and speeds relative to the largest, of the cycles for which work is computed."""
_CYCLES, _STEPS = 4, 200
_ROUNDING_WORK = 1e-3
"""Released work, as a share of force times amplitude, that counts as rounding."""
INNER = 0.7
"""Share of the ranges of position and speed to which the test of extrapolation is fitted."""
_MAX_ERROR_RATIO = 1.15
"""Largest ratio of the error outside a range to the error inside, or to that of a fit to all samples, if a law extrapolates."""
_MIN_ERROR_SAMPLES = 50
"""Smallest number of samples from which an error is computed."""
_MIN_THINNED_SAMPLES = 6000
"""Smallest number of samples of the training record after thinning, if its excitation allows it."""


@dataclass(frozen=True, eq=False)
class PartialData(FitData):
    """A record in which only some samples count; the whole record is simulated."""

    whole: FitData = None
    counts: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """True at samples that count, over the samples that count in the whole record."""

    @property
    def zeros(self) -> np.ndarray:
        """Columns of the sensor's zeros of the whole record, at the samples that count."""
        return self.whole.zeros

    @property
    def size(self) -> int:
        """Number of samples that count."""
        return int(self.counts.sum())

    def trim(self, signal: np.ndarray) -> np.ndarray:
        """Return the samples of a signal (samples first) that count."""
        return self.whole.trim(signal)[self.counts]

    def whiten(self, signal: np.ndarray) -> np.ndarray:
        """Return the samples of a whitened signal (samples first) that count."""
        return self.whole.whiten(signal)[self.counts]


def alternate(experiment: Experiment) -> tuple[Experiment, Experiment]:
    """Return the experiment with every other block of its unseen records, for choices, and with the other blocks, for tests."""
    halves = []
    for parity in (0, 1):
        tests = []
        for item in experiment.tests:
            block = max(1, round(BLOCK * item.scale("time") / item.motion.sampling_time))
            counts = np.arange(item.size) // block % 2 == parity
            tests.append(item.convert(PartialData, whole=item, counts=counts))
        halves.append(replace(experiment, tests=tests))
    return halves[0], halves[1]


def is_within(data: FitData, fitted: FitData, share: float) -> np.ndarray:
    """Return whether position and speed are within a share of the ranges of another record; shape (samples that count,)."""
    ranged, fastest = fitted.motion.position, np.abs(fitted.motion.velocity).max()
    middle, half = (ranged.max() + ranged.min()) / 2, np.ptp(ranged) / 2
    near = np.abs(data.trim(data.motion.position) - middle) <= share * half
    return near & (np.abs(data.trim(data.motion.velocity)) <= share * fastest)


def motions(data: FitData) -> list[Motion]:
    """Return the motions of a record, or of several that are fitted together."""
    return [part.motion for part in data.records]


def stays_bounded(fit: Fit, experiment: Experiment) -> bool:
    """Return whether the free run stays bounded on the motions of the records enlarged and accelerated by `STRETCH`."""
    largest = float(np.abs(experiment.training.force).max())
    for motion in (one for item in (experiment.training, *experiment.tests) for one in motions(item)):
        for size, pace in ((1.0, 1.0), (STRETCH, 1.0), (1.0, STRETCH), (STRETCH, STRETCH)):
            stretched = replace(
                motion,
                time=motion.time / pace,
                sampling_time=motion.sampling_time / pace,
                position=motion.position * size,
            )
            with np.errstate(all="ignore"):
                force = fit.simulate(stretched)
            if not np.isfinite(force).all() or np.abs(force).max() > _MAX_FORCE_RATIO * largest:
                return False
    return True


def is_dissipative(fit: Fit, data: FitData) -> bool:
    """Return whether no steady sine within the ranges of position and speed of the records releases energy in a cycle."""
    position = np.concatenate([motion.position for motion in motions(data)])
    fastest = max(float(np.abs(motion.velocity).max()) for motion in motions(data))
    middle, half = (position.max() + position.min()) / 2, np.ptp(position) / 2
    for size in _SIZES:
        for pace in _SIZES:
            amplitude, rate = size * half, pace * fastest / (size * half)
            phase = 2 * np.pi * np.arange(_CYCLES * _STEPS + 1) / _STEPS
            motion = Motion(phase / rate, middle + amplitude * np.sin(phase), 2 * np.pi / (_STEPS * rate))
            force = fit.simulate(motion)[-_STEPS - 1 :]
            work = np.trapezoid(force * np.cos(phase[-_STEPS - 1 :]), phase[-_STEPS - 1 :])
            if work < -_ROUNDING_WORK * max(float(np.abs(force).max()), 1e-300):
                return False
    return True


@dataclass(frozen=True)
class Extrapolation:
    """Errors of a law outside the range that it was fitted to."""

    inner_rms: float
    """Error of a fit to samples in the inner range only, on the training record outside this range."""
    all_rms: float
    """Error of the fit to all samples, on the training record outside its inner range."""
    beyond_rms: float | None
    """Error on unseen samples beyond the training record's range of position or speed; None if there are few such samples."""
    floor: float | None
    """RMS of the noise floor; None if unknown."""

    @property
    def holds(self) -> bool:
        """True if both errors outside are about as large as within the fitted range."""
        if self.inner_rms > _MAX_ERROR_RATIO * self.all_rms:
            return False
        largest = _MAX_ERROR_RATIO * max(self.all_rms, self.floor or 0.0)
        return self.beyond_rms is None or self.beyond_rms <= largest


def extrapolation(fit: Fit, experiment: Experiment) -> Extrapolation | None:
    """Fit to samples within `INNER` of the ranges of position and speed, evaluate outside; None if there are too few samples."""
    training = experiment.training
    inner = is_within(training, training, INNER)
    if min(inner.sum(), (~inner).sum()) < _MIN_ERROR_SAMPLES:
        return None

    def part(record: FitData, counts: np.ndarray) -> FitData:
        return record.convert(PartialData, whole=record, counts=counts)

    again, outer = refit(fit.structure, part(training, inner), fit.nonlinear), part(training, ~inner)
    beyond = [part(item, ~is_within(item, training, 1.0)) for item in experiment.tests]
    is_enough = sum(item.size for item in beyond) >= _MIN_ERROR_SAMPLES
    floor = None if experiment.floor is None else experiment.floor.rms
    return Extrapolation(again.rms(outer), fit.rms(outer), fit.rms(*beyond) if is_enough else None, floor)


def thin(experiment: Experiment) -> Experiment:
    """Return the experiment with every n-th sample of its records, with `MIN_SAMPLES_PER_CYCLE` in the fastest cycle.

    Nothing is filtered. Errors are not whitened, because the colour of the noise is known at the original rate only. If the
    experiment cannot be thinned, it is returned unchanged.
    """
    parts = [part for item in (experiment.training, *experiment.tests) for part in item.records]
    edges = [band_edge(part.drop_history(part.motion.position)) for part in parts]
    largest = min(int(1 / (MIN_SAMPLES_PER_CYCLE * edge)) for edge in edges)
    factor = min(largest, experiment.training.size // _MIN_THINNED_SAMPLES)
    if factor < 2:
        return experiment

    def every_nth(data: FitData) -> FitData:
        motion, kept = data.motion, slice(data.begins % factor, None, factor)
        position = motion.position[kept]
        step = factor * motion.sampling_time
        channels = {name: values[kept] for name, values in motion.channels.items()}
        lower = Motion(np.arange(len(position)) * step, position, step, motion.smooth, channels)
        settling, begins = round(data.settling / factor), data.begins // factor
        return FitData(data.name, lower, data.force[kept], np.ones(1), settling, data.has_own_zero, begins)

    return experiment.change_data(every_nth, JointData)
