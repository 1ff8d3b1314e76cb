"""Forward records as a fit sees them: the force drives, the motion as measured is what a model has to give."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from lumbar.tissue.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.models.measured_motion import smoothed
from lumbar.tissue.models.motion import Motion

_OF_MOTION = ("position", "speed", "path")


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
        experiment,
        training=_forward(experiment.training),
        tests=[_forward(item) for item in experiment.tests],
    )


def _forward(data: FitData) -> FitData:
    if isinstance(data, JointData):
        joint = ForwardJointData.of([_forward(part) for part in data.parts])
        return replace(joint, own_zero=data.own_zero)
    return ForwardData(
        data.name, data.motion, data.force, data.whitening, data.counts_from, own_zero=data.own_zero
    )
