"""Base of support: the convex hull of what stands on the ground, and how far a point is from its edge.

A hull is kept as its corners and which of them are on the ground; all is computed from its support function
h(n) = max over corners of n·corner, so that one foot, two feet, or a foot on its toes need no cases: the signed distance
of a point p to the edge of a convex set is the smallest h(n) − n·p over all unit directions n, positive inside.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from lumbar.lifting.movement.cleaning import derivative

FOOT_LENGTH, FOOT_BREADTH = 0.152, 0.055
"""Shares of stature (Drillis and Contini 1966; Winter 2009, Figure 4.1)."""
FUNCTIONAL_SHARE = 0.6
"""How far towards the edge people lean with a load in their hands (Holbein and Redfern 1997)."""
FLOOR_PERCENTILE = 5.0
"""A marker of the foot stands on the ground where it is about as low as in the lowest part of its recording."""


@dataclass(frozen=True)
class BaseOfSupport:
    """Convex base of support at n instants."""

    corners: np.ndarray
    """Shape (n, k, 2): metres in the plane of the ground; any order, inner ones do no harm."""
    grounded: np.ndarray
    """Shape (n, k): which corners are on the ground."""

    @property
    def centre(self) -> np.ndarray:
        """Mean of the grounded corners, shape (n, 2); NaN where nothing is on the ground."""
        weight = self.grounded[..., None].astype(float)
        with np.errstate(invalid="ignore"):
            return (np.nan_to_num(self.corners) * weight).sum(axis=1) / weight.sum(axis=1)

    def functional(self, share: float = FUNCTIONAL_SHARE) -> BaseOfSupport:
        """The part that people use: every edge drawn to `share` of its distance from the centre.

        Holbein and Redfern, Int. J. Ind. Ergon. 19 (1997) 387-395: 15 men who held loads and leaned forward, backward and to
        the sides reached about 60 % of the distance to the edge.
        """
        centre = self.centre[:, None, :]
        return replace(self, corners=centre + share * (self.corners - centre))

    def reach(self, point: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """How far the base extends beyond a point in a direction, shape (n,) in metres; negative where it ends before it.

        Parameters
        ----------
        point, direction : ndarray, shape (n, 2)
            Directions of length one.
        """
        along = np.einsum("nkj,nj->nk", self.corners, direction)
        furthest = np.where(self.grounded, along, -np.inf).max(axis=1)
        return np.where(self.grounded.any(axis=1), furthest - np.einsum("nj,nj->n", point, direction), np.nan)

    def margin(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance of a point to the edge, and the direction in which the edge is nearest.

        Parameters
        ----------
        point : ndarray, shape (n, 2)

        Returns
        -------
        margin : ndarray, shape (n,)
            Metres, positive inside, negative outside; NaN where nothing is on the ground or the point is not known.
        direction : ndarray, shape (n, 2)
            Unit vector from the point over the nearest edge.
        """
        directions = self._candidates(point)
        corners = np.einsum("nkj,nmj->nkm", self.corners, directions)
        furthest = np.where(self.grounded[..., None], corners, -np.inf).max(axis=1)
        distance = furthest - np.einsum("nmj,nj->nm", directions, point)
        distance = np.where(np.isfinite(distance), distance, np.inf)
        best = distance.argmin(axis=1)
        row = np.arange(len(point))
        margin, direction = distance[row, best], directions[row, best]
        known = np.isfinite(margin)
        return np.where(known, margin, np.nan), np.where(known[:, None], direction, np.nan)

    def _candidates(self, point: np.ndarray) -> np.ndarray:
        """Directions among which the nearest edge or corner is, shape (n, m, 2): normals of all pairs, and corner to point.

        Those of pairs that are no edge only name distances that are larger than the smallest.
        """
        pairs = [
            self.corners[:, j] - self.corners[:, i] for i, j in combinations(range(self.corners.shape[1]), 2)
        ]
        normals = [
            np.stack([sign * pair[:, 1], -sign * pair[:, 0]], axis=1) for pair in pairs for sign in (1, -1)
        ]
        away = [point - self.corners[:, i] for i in range(self.corners.shape[1])]
        vectors = np.stack([*normals, *away], axis=1)
        length = np.linalg.norm(vectors, axis=2, keepdims=True)
        return vectors / np.where(length > 1e-12, length, np.nan)


def joined(*bases: BaseOfSupport) -> BaseOfSupport:
    """The hull around several bases: both feet."""
    return BaseOfSupport(
        np.concatenate([base.corners for base in bases], axis=1),
        np.concatenate([base.grounded for base in bases], axis=1),
    )


def footprint(
    heel: np.ndarray,
    toe: np.ndarray,
    heel_grounded: np.ndarray,
    toe_grounded: np.ndarray,
    length: float,
    breadth: float,
) -> BaseOfSupport:
    """Base of one foot: a rectangle from the heel along the line heel-toe, its heel and toe on the ground each by itself.

    Parameters
    ----------
    heel, toe : ndarray, shape (n, 3)
        Markers, metres. The rectangle ends at the toe, or `length` ahead of the heel where the marker lies further back
        (on the metatarsals).
    heel_grounded, toe_grounded : ndarray of bool, shape (n,)
        As of `grounded`.
    length, breadth : float
        Of the foot, metres: `FOOT_LENGTH` and `FOOT_BREADTH` of the stature where not measured.
    """
    line = (toe - heel)[:, :2]
    distance = np.linalg.norm(line, axis=1, keepdims=True)
    forward = line / np.where(distance > 0, distance, np.nan)
    aside = 0.5 * breadth * np.stack([forward[:, 1], -forward[:, 0]], axis=1)
    back, front = heel[:, :2], heel[:, :2] + np.maximum(distance, length) * forward
    corners = np.stack([back - aside, back + aside, front - aside, front + aside], axis=1)
    on_ground = np.stack([heel_grounded, heel_grounded, toe_grounded, toe_grounded], axis=1)
    return BaseOfSupport(corners, on_ground & np.isfinite(corners).all(axis=2))


def grounded(marker: np.ndarray, rate: float, height_m: float, speed_m_s: float) -> np.ndarray:
    """Whether a marker of the foot is on the ground, shape (n,): low and at rest.

    Parameters
    ----------
    marker : ndarray, shape (n, 3)
        Filtered, metres.
    rate : float
        Frames per second.
    height_m : float
        How far above its lowest level in the recording it still stands.
    speed_m_s : float
        Below which it rests.
    """
    height = marker[:, 2]
    if not np.isfinite(height).any():
        return np.zeros(len(marker), dtype=bool)
    floor = np.nanpercentile(height, FLOOR_PERCENTILE)
    speed = np.linalg.norm(derivative(marker, rate), axis=1)
    return (height < floor + height_m) & (speed < speed_m_s)
