"""Silent corruptions of marker recordings, for tests: each changes some markers in some frames and says which."""

from dataclasses import dataclass

import numpy as np

Points = dict[str, np.ndarray]


@dataclass(frozen=True)
class Corrupted:
    """A recording after a corruption, and what a check has to name."""

    points: Points
    rate: float
    kind: str
    markers: frozenset[str] = frozenset()
    frames: slice | None = None


@dataclass(frozen=True)
class Trunk:
    """Labels that stand for C7, T12 and L5 in a file, or the nearest ones on the trunk."""

    c7: str
    t12: str
    l5: str


def changed(points: Points, label: str, frames: slice, values: np.ndarray) -> Points:
    """Put other values in some frames of a marker."""
    positions = points[label].copy()
    positions[frames] = values
    return {**points, label: positions}


def exchanged(points: Points, one: str, other: str, frames: slice) -> Points:
    """Exchange two labels in some frames."""
    first, second = points[one][frames].copy(), points[other][frames].copy()
    return changed(changed(points, one, frames, second), other, frames, first)


def _middle(points: Points, rate: float, seconds: float, share: float = 0.45) -> slice:
    n_frames = len(next(iter(points.values())))
    start = int(share * n_frames)
    return slice(start, min(n_frames - 5, start + round(seconds * rate)))


CORRUPTIONS = {
    "tenfold_unit": "every coordinate ten times too large",
    "c7_t12_for_a_while": "C7 and T12 exchanged for 0.4 s",
    "c7_frozen": "C7 keeps its position for 1 s",
    "jump": "C7 is 100 mm off from some frame on",
    "beyond": "C7 lies at 1e38 m for 0.2 s",
    "all_beyond": "every coordinate is 1e38 m",
}


def corrupted(name: str, points: Points, rate: float, trunk: Trunk, rng: np.random.Generator) -> Corrupted:
    """Corrupt a recording in one of these ways."""
    c7, t12 = trunk.c7, trunk.t12
    first = frozenset({c7})
    match name:
        case "tenfold_unit":
            return Corrupted({label: 10 * positions for label, positions in points.items()}, rate, "unit")
        case "c7_t12_for_a_while":
            while_ = _middle(points, rate, 0.4)
            return Corrupted(
                exchanged(points, c7, t12, while_), rate, "exchanged", frozenset({c7, t12}), while_
            )
        case "c7_frozen":
            second = _middle(points, rate, 1.0)
            return Corrupted(
                changed(points, c7, second, points[c7][second.start]), rate, "frozen", first, second
            )
        case "jump":
            frames, direction = slice(int(0.7 * len(points[c7])), len(points[c7])), rng.normal(size=3)
            moved = points[c7][frames] + 0.1 * direction / np.linalg.norm(direction)
            return Corrupted(changed(points, c7, frames, moved), rate, "jump", first, frames)
        case "beyond":
            frames = _middle(points, rate, 0.2)
            return Corrupted(
                changed(points, c7, frames, np.full(3, 1e38)), rate, "beyond laboratory", first, frames
            )
        case "all_beyond":
            return Corrupted({label: np.full_like(p, 1e38) for label, p in points.items()}, rate, "unit")
    raise KeyError(name)
