"""What a formula must pass before it is proposed: it stays bounded, gives no energy away, and where it was found is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lumbar.tissue.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.joint_fit import fit as refit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.law.blocks import Chosen, within
from lumbar.tissue.models.motion import Motion

STRETCH = 1.5
"""Amplitude and speed beyond the records at which a law must stay bounded."""
_LARGEST = 10.0
"""Force there, in the largest force of the records."""
_SIZES = (0.3, 0.65, 1.0)
"""Amplitudes of the cycles in half ranges, and their speeds in the largest, at which work is counted."""
_CYCLES, _STEPS = 4, 200
_ROUNDING = 1e-3
"""Work given away, as a share of force times amplitude, that is none."""
INNER = 0.7
"""Share of the ranges of position and speed that the trial of extrapolation fits to."""
_AS_GOOD = 1.15
"""Error outside a range, in that inside or of a fit to all of it, up to which a law counts as extrapolating."""
_FEWEST = 50
"""Samples that an error is taken from."""


def motions(data: FitData) -> list[Motion]:
    """Motions of a record, or of several that are fitted together."""
    return [part.motion for part in data.parts] if isinstance(data, JointData) else [data.motion]


def stays_bounded(fit: Fit, experiment: Experiment) -> bool:
    """Whether the free run is finite and of the records' size on their motions, larger and faster by `STRETCH`."""
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
            if not np.isfinite(force).all() or np.abs(force).max() > _LARGEST * largest:
                return False
    return True


def least_work(fit: Fit, data: FitData) -> float:
    """Least work that the model takes up in a closed cycle, as a share of the largest force times the amplitude.

    Steady sines within the ranges of position and speed of the records; negative where a passive tissue would give energy away.
    """
    position = np.concatenate([motion.position for motion in motions(data)])
    fastest = max(float(np.abs(motion.velocity).max()) for motion in motions(data))
    middle, half = (position.max() + position.min()) / 2, np.ptp(position) / 2
    found = []
    for size in _SIZES:
        for pace in _SIZES:
            amplitude, rate = size * half, pace * fastest / (size * half)
            phase = 2 * np.pi * np.arange(_CYCLES * _STEPS + 1) / _STEPS
            motion = Motion(phase / rate, middle + amplitude * np.sin(phase), 2 * np.pi / (_STEPS * rate))
            force = fit.simulate(motion)[-_STEPS - 1 :]
            work = np.trapezoid(force * np.cos(phase[-_STEPS - 1 :]), phase[-_STEPS - 1 :])
            found.append(work / max(float(np.abs(force).max()), 1e-300))
    return min(found)


def is_dissipative(fit: Fit, data: FitData) -> bool:
    """Whether no closed cycle gives energy away."""
    return least_work(fit, data) >= -_ROUNDING


@dataclass(frozen=True)
class Extrapolation:
    """How a law does where it was not fitted."""

    inner_rms: float
    """Error on the training record outside its inner range, of a fit to samples in it alone."""
    all_rms: float
    """Error of the fit to all samples, at the same ones."""
    beyond_rms: float | None
    """Error on unseen samples beyond the training record's range of position or speed; None where they are few."""
    floor: float | None
    """Noise."""

    @property
    def holds(self) -> bool:
        """Whether both errors are nearly what they are where the law was fitted."""
        if self.inner_rms > _AS_GOOD * self.all_rms:
            return False
        return self.beyond_rms is None or self.beyond_rms <= _AS_GOOD * max(self.all_rms, self.floor or 0.0)


def extrapolation(fit: Fit, experiment: Experiment) -> Extrapolation | None:
    """Fit to the samples with position and speed within `INNER` of their ranges and look outside; None where too few are.

    Unseen samples beyond the training record's range are looked at as well.
    """
    training = experiment.training
    inner = within(training, training, INNER)
    if min(inner.sum(), (~inner).sum()) < _FEWEST:
        return None
    again = refit(fit.structure, Chosen.of(training, inner), fit.nonlinear)
    outer = Chosen.of(training, ~inner)
    beyond = [Chosen.of(item, ~within(item, training, 1.0)) for item in experiment.tests]
    enough = sum(item.size for item in beyond) >= _FEWEST
    return Extrapolation(
        again.rms(outer),
        fit.rms(outer),
        fit.rms(*beyond) if enough else None,
        None if experiment.floor is None else experiment.floor.rms,
    )
