"""What a marker file holds before its labels, unit and axes are translated."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lumbar.base.errors import InputError


class NoMarkers(InputError):
    """A table or a MATLAB file that holds something else than markers."""


@dataclass(frozen=True)
class RecordedEvent:
    """An event that somebody, or a program, marked in the recording."""

    label: str
    """As the file has it, e.g. ``"Foot Off"``."""
    context: str
    """Side, e.g. ``"Left"``; empty where none is stated."""
    time: float
    """Seconds on the recording's own clock."""


@dataclass(frozen=True)
class MarkerFile:
    """Trajectories as a file states them: its own labels, unit and axes."""

    source: str
    """Path of the file, for messages."""
    time: np.ndarray
    """Shape (n_frames,): seconds on the recording's own clock: the first frame need not be at 0."""
    rate: float
    """Frames per second."""
    unit: str
    """Unit of length the file states; empty where it states none."""
    positions: dict[str, np.ndarray]
    """Shape (n_frames, 3): measured markers by label; NaN in all three coordinates where a marker was not seen."""
    model_points: dict[str, np.ndarray] = field(default_factory=dict)
    """Shape (n_frames, 3): points that a model computed and the file stores beside the markers (centre of mass, segment
    axes): only read where an alias names them."""
    dropped: dict[str, str] = field(default_factory=dict)
    """Labels that are not measured markers, with the reason. Holds the labels of `model_points` too."""
    events: tuple[RecordedEvent, ...] = ()
    """In the order of time."""
    notes: tuple[str, ...] = ()
    """What the file contradicts itself in without harm to a coordinate."""


def mark_missing(points: np.ndarray) -> np.ndarray:
    """Return a copy with NaN in all coordinates of every missing sample.

    A sample is missing where a coordinate is not finite, or where all three are exactly zero: systems write
    the origin for a marker they did not see, and a real marker is never there to the last bit.

    Parameters
    ----------
    points : ndarray, shape (..., 3)
    """
    points = np.array(points, dtype=float)
    missing = ~np.isfinite(points).all(axis=-1) | (points == 0).all(axis=-1)
    points[missing] = np.nan
    return points
