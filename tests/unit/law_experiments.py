"""Tissue tests with a force added that the tests of proposed laws know: spring and Maxwell branch by scipy, 100 Hz."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from lumbar.records.record import Channel, Record
from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment, prepare
from lumbar.tissue.diagnosis.selection.candidate import Candidate, evaluate
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.structure import Structure

STEP, TAU, NOISE = 0.01, 0.15, 0.02


def sines(seconds: float, seed: int, size: float = 4.0, even: bool = True) -> np.ndarray:
    """Position of a multisine up to 4 Hz with a period of 5 s, or of lines that never repeat."""
    random = np.random.default_rng(seed)
    lines = np.arange(1, 21) * 0.2 if even else random.uniform(0.1, 4, 25)
    time = np.arange(round(seconds / STEP)) * STEP
    found = np.cos(2 * np.pi * np.outer(time, lines) + random.uniform(0, 2 * np.pi, len(lines))) @ lines**-0.6
    return size * found / np.abs(found).max()


def tissue(position: np.ndarray) -> np.ndarray:
    """Force of a spring beside a Maxwell branch, at rest when it begins."""
    decay = np.exp(-STEP / TAU)
    increments = np.diff(position, prepend=position[0])
    return 0.5 * position + 0.8 * lfilter([TAU / STEP * (1 - decay)], [1, -decay], increments)


def record(name: str, position: np.ndarray, added, seed: int) -> Record:
    """A record with noise; `added` is a function of position and velocity."""
    velocity = np.gradient(position, STEP, edge_order=2)
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(position))
    force = tissue(position) + added(position, velocity) + noise
    channels = {"input": Channel(position, "position", "mm"), "output": Channel(force, "force", "N")}
    return Record(name, np.arange(len(position)) * STEP, channels)


def records(added, seed: int = 0) -> list[Record]:
    """A long record that repeats and two short ones that do not."""
    return [
        record("long", sines(20, seed), added, seed + 1),
        record("first", sines(8, seed + 2, even=False), added, seed + 3),
        record("second", sines(8, seed + 4, even=False), added, seed + 5),
    ]


def experiment(added, seed: int = 0) -> tuple[Experiment, Candidate]:
    """The records prepared, and the base fitted to them."""
    prepared = prepare(records(added, seed))
    return prepared, evaluate(fit_base(Structure(BASES["KB"]), prepared.training), prepared)


def nothing(position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """No force."""
    return np.zeros_like(position)


def lateral(position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Cross-talk of an axis that moves on its own, over the same 5 s."""
    time = np.arange(len(position)) * STEP
    return 0.3 * np.cos(2 * np.pi * np.outer(time, [0.4, 1.0, 1.8, 2.6]) + [0.3, 1.1, 4.0, 2.2]).sum(axis=1)


def depth_friction(position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Dry friction that grows with the depth of a needle."""
    return 0.25 * np.maximum(position, 0) * np.tanh(velocity / 2.0)


def cogging(position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Magnets every 2.5 mm."""
    return 0.3 * np.sin(2 * np.pi * position / 2.5 + 0.4)
