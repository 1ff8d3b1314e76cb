"""What is lifted: the box by its markers, or the hands where it has none; where it is, how fast, and when it is seen.

Reaching, swinging arms and small corrections also move hands up and down, so that only great swings count where they stand
for a box: a lift is the first rise, a deposit the last descent, of at least half the greatest one.
"""

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from lumbar.lifting.movement.cleaning import derivative
from lumbar.records.markers import MarkerRecording
from lumbar.settings.lifting import EventSettings

WRISTS = ("L_WRIST", "R_WRIST")
GREAT = 0.5
"""Share of the greatest swing that makes another one great too."""
LOWEST = 0.1
"""Share of a rise within which what rises is still at its lowest."""


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


def speed(points: np.ndarray, rate: float) -> np.ndarray:
    """Speed of filtered positions, shape (n,) in m/s; NaN where a sample is missing."""
    return np.linalg.norm(derivative(points, rate), axis=1)


def turning_points(height: np.ndarray, size: float) -> list[int]:
    """Indices of highest and lowest points in turn, at least `size` apart in height; fewer than two where it never goes so far.

    Examples
    --------
    >>> turning_points(np.array([0.0, 1.0, 0.9, 1.2, 0.2, 0.3]), 0.5)
    [0, 3, 4]
    """
    points: list[int] = []
    low = high = direction = 0
    for index, value in enumerate(height):
        low = index if direction <= 0 and value < height[low] else low
        high = index if direction >= 0 and value > height[high] else high
        if direction <= 0 and value - height[low] >= size:
            points.append(low)
            high, direction = index, 1
        elif direction >= 0 and height[high] - value >= size:
            points.append(high)
            low, direction = index, -1
    return [*points, high if direction > 0 else low] if points else []


def great_swings(height: np.ndarray, size: float, sign: int) -> list[tuple[int, int]]:
    """First and last index of every great rise (`sign` 1) or descent (-1) of at least `size`."""
    swings = [
        pair
        for pair in pairwise(turning_points(height, size))
        if sign * (height[pair[1]] - height[pair[0]]) > 0
    ]
    greatest = max((abs(height[last] - height[first]) for first, last in swings), default=0.0)
    return [pair for pair in swings if abs(height[pair[1]] - height[pair[0]]) >= GREAT * greatest]


def greatest_rise(height: np.ndarray) -> float:
    """How far it ever rises above an earlier height, metres."""
    return float(np.max(height - np.minimum.accumulate(height)))


def lift_windows(recording: MarkerRecording, settings: EventSettings) -> list[tuple[float, float]]:
    """Parts of a recording in seconds, one for each great rise of what is lifted, of `hands_rise_m` at least; none without any.

    They are cut in the middle of the time that it stays lowest between two rises.
    """
    points, _ = carried_object(recording)
    seen = np.isfinite(points).all(axis=1) if points is not None else np.zeros(len(recording), bool)
    if not seen.any():
        return []
    time, height = recording.time[seen], points[seen, 2]
    swings, edges = great_swings(height, settings.hands_rise_m, 1), [float(recording.time[0])]
    for (_, before), (low, high) in pairwise(swings):
        lowest = height[before:high] <= height[low] + LOWEST * (height[high] - height[low])
        edges.append(float(np.median(time[before:high][lowest])))
    return list(pairwise([*edges, float(recording.time[-1])])) if swings else []


def last_hand_descent(height: np.ndarray, settings: EventSettings, greatest: bool) -> tuple[int, int] | None:
    """First and last index of the last descent of the hands from the lift-off on; None where there is none of `descent_m`.

    With `greatest` only great descents count: hands that hold nothing together may do anything besides.
    """
    if greatest:
        swings = great_swings(height, settings.descent_m, -1)
        return swings[-1] if swings else None
    points = turning_points(height, settings.descent_m)
    ends = [pair for pair in pairwise(points) if height[pair[1]] < height[pair[0]]]
    return ends[-1] if ends else None
