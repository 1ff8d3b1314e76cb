"""Forward records as a fit sees them: the force drives, the motion as measured is what a model has to give."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lumbar.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.diagnosis.fitting.preparation import Experiment
from lumbar.models.forward_structure import MEASURED
from lumbar.models.motion import Motion
from lumbar.records.record import Record

_OF_MOTION = ("position", "speed", "path")
_BLOCK = 8
"""Blocks of a record whose spectra are averaged."""
_ABOVE = 4.0
"""Power of the motion in that of the noise, from which on it is told from it."""
_QUIET = 0.25
"""Share of the frequencies, the highest ones, whose power is taken for the noise's."""
_ROOM = 1.5
_ORDER = 4
_HIGHEST = 0.45
"""Cycles per sample from which on nothing is smoothed."""


def with_measured_motion(record: Record) -> Record:
    """The record with its motion once more, smoothed, as the channel that a simulation takes its beginning from."""
    output = record.channels["output"]
    return replace(record, channels={**record.channels, MEASURED: replace(output, values=smoothed(output.values))})


@dataclass(frozen=True, eq=False)
class ForwardData(FitData):
    """One forward record; attributes as of `FitData`, with the force as its motion and the motion as its force."""

    @cached_property
    def moved(self) -> Motion:
        """The motion, smoothed."""
        return Motion(self.motion.time, smoothed(self.force), self.motion.sampling_time)

    def scale(self, kind: str) -> float:
        """Size of a quantity for starting values; ``force`` is what a form at the output transforms."""
        return self.moved.scale(kind) if kind in _OF_MOTION else super().scale(kind)


@dataclass(frozen=True, eq=False)
class ForwardJointData(JointData):
    """Several forward records that are fitted together."""

    def scale(self, kind: str) -> float:
        """Largest size in any of the records."""
        return max(part.scale(kind) for part in self.parts)


def forward_experiment(experiment: Experiment) -> Experiment:
    """The same experiment with its records as forward ones."""
    return replace(
        experiment, training=_forward(experiment.training), tests=[_forward(item) for item in experiment.tests]
    )


def _forward(data: FitData) -> FitData:
    if isinstance(data, JointData):
        joint = ForwardJointData.of([_forward(part) for part in data.parts])
        return replace(joint, own_zero=data.own_zero)
    return ForwardData(
        data.name, data.motion, data.force, data.whitening, data.counts_from, data.own_zero
    )


def smoothed(signal: np.ndarray) -> np.ndarray:
    """A signal without the frequencies at which noise is all that is seen: zero-phase Butterworth filter.

    The noise is what the highest quarter of the frequencies holds; a motion has little there.
    """
    from scipy.signal import butter, sosfiltfilt, welch

    frequency, power = welch(signal, nperseg=min(len(signal), max(len(signal) // _BLOCK, 64)))
    noise = float(np.median(power[frequency > 0.5 * (1 - _QUIET)]))
    seen = np.flatnonzero(power > _ABOVE * noise)
    cut = _ROOM * float(frequency[seen[-1]]) if len(seen) else 0.0
    if not 0 < cut < _HIGHEST:
        return signal
    return sosfiltfilt(butter(_ORDER, 2 * cut, output="sos"), signal)
