"""Two markers that exchange their labels for a while: each leaps to where the other was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.lifting.quality.leaps import Leap

_SHARE, _LEAST_M = 0.25, 0.015
"""How far from the other's place a marker may land: a share of their distance, or this."""


@dataclass(frozen=True)
class Exchange:
    """Two labels change places at some frames and back at others."""

    first: str
    second: str
    """`first`, `second`: labels."""
    frames: tuple[int, ...]
    """First frames after each change."""
    distance: float
    """Metres between both markers at the first change."""

    @property
    def pair(self) -> frozenset[str]:
        """Both labels."""
        return frozenset((self.first, self.second))

    def exchanged(self, n_frames: int) -> list[slice]:
        """Stretches between odd and even changes: with those between even and odd ones they are the recording."""
        edges = [*self.frames, n_frames]
        return [slice(*pair) for pair in zip(edges[::2], edges[1::2], strict=False)]

    def others(self, n_frames: int) -> list[slice]:
        """Stretches before the first change, and between even and odd ones."""
        edges = [0, *self.frames, n_frames]
        return [slice(*pair) for pair in zip(edges[::2], edges[1::2], strict=False)]


def take_exchanges(leaps: dict[str, list[Leap]]) -> tuple[list[Exchange], dict[str, list[Leap]]]:
    """Take the leaps that are exchanges from all leaps.

    Where several markers leap at once, as those of both legs, each leap belongs to the exchange that it fits best.

    Parameters
    ----------
    leaps : dict of str to list of Leap
        By label.

    Returns
    -------
    exchanges : list of Exchange
    remaining : dict of str to list of Leap
        Leaps that no other marker explains.
    """
    changes: dict[tuple[str, str], list[tuple[int, float]]] = {}
    taken: set[tuple[str, int]] = set()
    flat = [(label, leap) for label, found in leaps.items() for leap in found]
    candidates = [
        (_miss(leap, other), (label, leap), (other_label, other))
        for index, (label, leap) in enumerate(flat)
        for other_label, other in flat[index + 1 :]
        if other_label != label and _change_places(leap, other)
    ]
    for _, (label, leap), (other_label, other) in sorted(candidates, key=lambda found: found[0]):
        ends = {(label, leap.first), (other_label, other.first)}
        if taken & ends:
            continue
        taken |= ends
        distance = float(np.linalg.norm(leap.before - other.before))
        changes.setdefault((label, other_label), []).append((min(leap.first, other.first), distance))
    exchanges = [
        Exchange(*pair, tuple(sorted(frame for frame, _ in found)), found[0][1])
        for pair, found in changes.items()
    ]
    remaining = {
        label: [leap for leap in found if (label, leap.first) not in taken] for label, found in leaps.items()
    }
    return exchanges, remaining


def _miss(one: Leap, other: Leap) -> float:
    """How far both leaps end from where the other began, metres."""
    return float(np.linalg.norm(one.after - other.before) + np.linalg.norm(other.after - one.before))


def _change_places(one: Leap, other: Leap) -> bool:
    if one.last >= other.first or other.last >= one.first:
        return False
    tolerance = max(_LEAST_M, _SHARE * float(np.linalg.norm(one.before - other.before)))
    there = np.linalg.norm(one.after - other.before) < tolerance
    return bool(there and np.linalg.norm(other.after - one.before) < tolerance)


def lands_on(leap: Leap, label: str, points: dict[str, np.ndarray]) -> str | None:
    """Return the label of the marker that was seen, just before, where a leap ends; None where there was none."""
    best, nearest = None, max(_LEAST_M, _SHARE * leap.size)
    for other, positions in points.items():
        distance = np.linalg.norm(positions[leap.last] - leap.after)
        if other != label and distance < nearest:
            best, nearest = other, distance
    return best
