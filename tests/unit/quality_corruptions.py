"""Silent corruptions of marker recordings, for tests: each changes some markers in some frames and says which."""

from collections.abc import Callable
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


def tenfold_unit(points, rate, trunk, rng):
    """Every coordinate ten times too large."""
    return Corrupted({label: 10 * positions for label, positions in points.items()}, rate, "unit")


def c7_t12_always(points, rate, trunk, rng):
    """C7 and T12 exchanged in all frames."""
    pair = trunk.c7, trunk.t12
    return Corrupted(exchanged(points, *pair, slice(None)), rate, "exchanged", frozenset(pair))


def c7_t12_for_a_while(points, rate, trunk, rng):
    """C7 and T12 exchanged for 0.4 s."""
    pair, frames = (trunk.c7, trunk.t12), _middle(points, rate, 0.4)
    return Corrupted(exchanged(points, *pair, frames), rate, "exchanged", frozenset(pair), frames)


def t12_l5_always(points, rate, trunk, rng):
    """T12 and L5 exchanged in all frames."""
    pair = trunk.t12, trunk.l5
    return Corrupted(exchanged(points, *pair, slice(None)), rate, "exchanged", frozenset(pair))


def t12_copies_c7(points, rate, trunk, rng):
    """T12 has the coordinates of C7."""
    changed = {**points, trunk.t12: points[trunk.c7].copy()}
    return Corrupted(changed, rate, "copied", frozenset({trunk.t12}))


def c7_frozen(points, rate, trunk, rng):
    """C7 keeps its position for 1 s."""
    frames = _middle(points, rate, 1.0)
    frames = slice(frames.start, frames.stop)
    held = points[trunk.c7][frames.start]
    return Corrupted(changed(points, trunk.c7, frames, held), rate, "frozen", frozenset({trunk.c7}), frames)


def jump(points, rate, trunk, rng):
    """C7 is 100 mm off from some frame on."""
    frames = slice(int(0.7 * len(points[trunk.c7])), None)
    direction = rng.normal(size=3)
    moved = points[trunk.c7][frames] + 0.1 * direction / np.linalg.norm(direction)
    stop = len(points[trunk.c7])
    return Corrupted(
        changed(points, trunk.c7, frames, moved),
        rate,
        "jump",
        frozenset({trunk.c7}),
        slice(frames.start, stop),
    )


def fast_rate(points, rate, trunk, rng):
    """The rate stated is five times the real one."""
    return Corrupted(points, 5 * rate, "rate")


def slow_rate(points, rate, trunk, rng):
    """The rate stated is a fifth of the real one."""
    return Corrupted(points, rate / 5, "rate")


def beyond(points, rate, trunk, rng):
    """C7 lies at 1e38 m for 0.2 s."""
    frames = _middle(points, rate, 0.2)
    return Corrupted(
        changed(points, trunk.c7, frames, np.full(3, 1e38)),
        rate,
        "beyond laboratory",
        frozenset({trunk.c7}),
        frames,
    )


def all_beyond(points, rate, trunk, rng):
    """Every coordinate is 1e38 m."""
    return Corrupted(
        {label: np.full_like(positions, 1e38) for label, positions in points.items()}, rate, "unit"
    )


CORRUPTIONS: dict[str, Callable] = {
    corruption.__name__: corruption
    for corruption in (
        tenfold_unit,
        c7_t12_always,
        c7_t12_for_a_while,
        t12_l5_always,
        t12_copies_c7,
        c7_frozen,
        jump,
        fast_rate,
        slow_rate,
        beyond,
        all_beyond,
    )
}
