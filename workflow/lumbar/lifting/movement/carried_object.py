"""What is lifted: the box by its markers, or the hands where it has none; where it is, how fast, and when it is seen."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from lumbar.lifting.movement.cleaning import derivative
from lumbar.records.markers import MarkerRecording
from lumbar.records.stretches import runs

WRISTS = ("L_WRIST", "R_WRIST")


def best_seen(recording: MarkerRecording, names: Iterable[str]) -> list[str]:
    """Those markers that are seen whenever the longest seen one is; none without markers."""
    seen = {name: np.isfinite(recording[name]).all(axis=1) for name in names if name in recording}
    if not seen:
        return []
    best = max(seen.values(), key=np.count_nonzero)
    return [name for name, when in seen.items() if when[best].all()]


def mean_of_best_seen(recording: MarkerRecording, names: Iterable[str]) -> np.ndarray | None:
    """Mean of those markers that are seen whenever the longest seen one is, shape (n, 3); None without markers.

    A marker that is missing for a while is left out altogether: it would shift the mean when it comes and goes.
    """
    best = best_seen(recording, names)
    return np.mean([recording[name] for name in best], axis=0) if best else None


def box_centre(recording: MarkerRecording) -> np.ndarray | None:
    """Centre of the box markers, shape (n, 3) in metres; None without box markers, NaN where they are not seen."""
    return mean_of_best_seen(recording, [name for name in recording.positions if name.startswith("BOX_")])


def wrist_centre(recording: MarkerRecording) -> np.ndarray | None:
    """Mean of the wrists in the recording, shape (n, 3) in metres; None without wrists."""
    return mean_of_best_seen(recording, WRISTS)


def carried_object(recording: MarkerRecording) -> tuple[np.ndarray | None, str]:
    """What is lifted: the box, or the hands where there are no markers on it, and which of the two it is."""
    box = box_centre(recording)
    return (wrist_centre(recording), "hands") if box is None else (box, "box")


def longest_seen(recording: MarkerRecording, points: np.ndarray) -> MarkerRecording:
    """The longest part of a recording throughout which `points` are seen."""
    stretch = max(runs(np.isfinite(points).all(axis=1)), key=lambda run: run.stop - run.start)
    positions = {name: values[stretch] for name, values in recording.positions.items()}
    return replace(recording, time=recording.time[stretch], positions=positions)


def speed(points: np.ndarray, rate: float) -> np.ndarray:
    """Speed of filtered positions, shape (n,) in m/s; NaN where a sample is missing."""
    return np.linalg.norm(derivative(points, rate), axis=1)
