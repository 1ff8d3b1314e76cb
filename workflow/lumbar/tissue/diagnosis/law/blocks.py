"""Parts of a record's samples: blocks to choose on, blocks that no choice has seen, the inner range of a motion."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.preparation import Experiment

BLOCK = 1.0
"""Seconds of a block."""


@dataclass(frozen=True, eq=False)
class Chosen(FitData):
    """A record of which only some samples count; simulated as a whole."""

    whole: FitData = None
    keep: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """Over the samples that count of the whole."""

    @classmethod
    def of(cls, whole: FitData, keep: np.ndarray) -> Chosen:
        """Let only these samples of a record count."""
        return cls(
            whole.name,
            whole.motion,
            whole.force,
            whole.whitening,
            whole.counts_from,
            begins=whole.begins,
            whole=whole,
            keep=keep,
        )

    @property
    def size(self) -> int:
        """Number of samples that count."""
        return int(self.keep.sum())

    def settled(self, signal: np.ndarray) -> np.ndarray:
        """Signal (samples first) where samples count."""
        return self.whole.settled(signal)[self.keep]

    def counted(self, signal: np.ndarray) -> np.ndarray:
        """Whitened signal (samples first) where samples count."""
        return self.whole.counted(signal)[self.keep]


def alternate(experiment: Experiment) -> tuple[Experiment, Experiment]:
    """The experiment with every other second of its unseen records, and with the seconds in between.

    Choices are made with the first; the second tells what they are worth.
    """
    first, second = [], []
    for item in experiment.tests:
        block = max(1, round(BLOCK / item.motion.sampling_time))
        even = np.arange(item.size) // block % 2 == 0
        first.append(Chosen.of(item, even))
        second.append(Chosen.of(item, ~even))
    return replace(experiment, tests=first), replace(experiment, tests=second)


def within(data: FitData, fitted: FitData, share: float) -> np.ndarray:
    """Samples of a record with position and speed within a share of the ranges of another; shape (samples that count,)."""
    ranged, fastest = fitted.motion.position, np.abs(fitted.motion.velocity).max()
    middle, half = (ranged.max() + ranged.min()) / 2, np.ptp(ranged) / 2
    near = np.abs(data.settled(data.motion.position) - middle) <= share * half
    return near & (np.abs(data.settled(data.motion.velocity)) <= share * fastest)
