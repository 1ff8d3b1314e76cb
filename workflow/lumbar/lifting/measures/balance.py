"""Balance over the feet: base of support, extrapolated centre of mass, and capturability (coming to rest without a step).

*Base of support*: the convex hull of the grounded parts of the feet. A hull is stored as its corners, with a flag for those on
the ground. Its support function h(n) = max over corners of n·corner serves one foot, two feet and a foot on its toes: the
signed distance of a point p to the edge of a convex set is the smallest h(n) − n·p over all unit directions n, positive inside.

*Extrapolated centre of mass* (Hof, Gazendam and Sinke, The condition for dynamic stability, J. Biomech. 38 (2005) 1-8): a
person as an inverted pendulum of length l keeps balance without a step as long as x + v/ω0 with ω0 = √(g/l) stays above the
base of support.

*Capturability*, with feet of finite size and ankles of finite strength. Two models, both exact. The linear inverted pendulum
can stop without a step if and only if its instantaneous capture point x + v·√(z/g) is within the bounds of its
centre of pressure (Koolen et al., Int. J. Robotics Research 31 (2012) 1094-1113, the model with a finite foot). The
nonlinear pendulum with a limited torque, m l² θ̈ = m g l sin θ − τ, |τ| within the limits, can stop if and only if full
braking stops it before the angle θ* at which gravity wins, sin θ* = τ/(m g l): energy gives the largest speed at every angle
in closed form.
"""

from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations
from typing import Self

import numpy as np

from lumbar.lifting.movement.cleaning import derivative

FOOT_LENGTH, FOOT_BREADTH = 0.152, 0.055
"""Length and breadth of a foot, shares of stature (Drillis and Contini 1966; Winter 2009, Figure 4.1)."""
FUNCTIONAL_SHARE = 0.6
"""Share of the distance from the centre to the edge that people use when they lean with a load (Holbein and Redfern 1997)."""
FLOOR_PERCENTILE = 5.0
"""Percentile of the height of a foot's marker that is taken as the level of the floor."""


@dataclass(frozen=True)
class BaseOfSupport:
    """Convex base of support at n instants."""

    corners: np.ndarray
    """Shape (n, k, 2): corners in the plane of the ground, metres, in any order; inner points are allowed."""
    grounded: np.ndarray
    """Shape (n, k): True if the corner is on the ground."""

    @property
    def centre(self) -> np.ndarray:
        """Mean of the grounded corners, shape (n, 2); NaN if none is on the ground."""
        return mean_of_grounded(self.corners, self.grounded)

    def functional(self, share: float = FUNCTIONAL_SHARE) -> Self:
        """Return the part of the base that people use: every edge is moved towards the centre.

        Holbein and Redfern, Int. J. Ind. Ergon. 19 (1997) 387-395: 15 men who held loads and leaned forward, backward and to
        the sides reached about 60 % of the distance to the edge.

        Parameters
        ----------
        share : float, default `FUNCTIONAL_SHARE`
            Share of an edge's distance from the centre that remains.
        """
        centre = self.centre[:, None, :]
        return type(self)(centre + share * (self.corners - centre), self.grounded)

    def reach(self, point: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Return the distance from a point to the edge of the base in a direction, shape (n,) in m; negative beyond the edge.

        Parameters
        ----------
        point, direction : numpy.ndarray, shape (n, 2)
            Horizontal position in m; unit vectors.
        """
        along = np.einsum("nkj,nj->nk", self.corners, direction)
        furthest = np.where(self.grounded, along, -np.inf).max(axis=1)
        return np.where(self.grounded.any(axis=1), furthest - np.einsum("nj,nj->n", point, direction), np.nan)

    def margin(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the signed distance of a point to the edge in m, shape (n,), and the unit vector of the nearest edge, (n, 2).

        The distance is positive inside; both are NaN if nothing is on the ground or the point is unknown.

        Parameters
        ----------
        point : numpy.ndarray, shape (n, 2)
            Horizontal position in m.
        """
        # Directions that include the nearest edge or corner: normals of all pairs, corner to point. Pairs that are not edges only
        # give larger distances than the smallest.
        corners = range(self.corners.shape[1])
        pairs = [self.corners[:, j] - self.corners[:, i] for i, j in combinations(corners, 2)]
        normals = [
            np.stack([sign * pair[:, 1], -sign * pair[:, 0]], axis=1) for pair in pairs for sign in (1, -1)
        ]
        vectors = np.stack([*normals, *(point - self.corners[:, i] for i in corners)], axis=1)
        length = np.linalg.norm(vectors, axis=2, keepdims=True)
        directions = vectors / np.where(length > 1e-12, length, np.nan)
        # The direction of the smallest distance.
        along = np.einsum("nkj,nmj->nkm", self.corners, directions)
        furthest = np.where(self.grounded[..., None], along, -np.inf).max(axis=1)
        distance = furthest - np.einsum("nmj,nj->nm", directions, point)
        distance = np.where(np.isfinite(distance), distance, np.inf)
        best = distance.argmin(axis=1)
        row = np.arange(len(point))
        margin, direction = distance[row, best], directions[row, best]
        known = np.isfinite(margin)
        return np.where(known, margin, np.nan), np.where(known[:, None], direction, np.nan)


def corners_around(points: np.ndarray) -> np.ndarray:
    """Return the corners of the hull of known points, in order; the points themselves if fewer than three or on a line."""
    from scipy.spatial import ConvexHull, QhullError

    points = points[np.isfinite(points).all(axis=1)]
    with suppress(QhullError, ValueError):
        return points[ConvexHull(points).vertices]
    return points


def footprint(
    heel: np.ndarray,
    toe: np.ndarray,
    heel_grounded: np.ndarray,
    toe_grounded: np.ndarray,
    length: float,
    breadth: float,
) -> BaseOfSupport:
    """Return the base of one foot: a rectangle from the heel along the line heel-toe, with separate contact of heel and toe.

    Parameters
    ----------
    heel, toe : numpy.ndarray, shape (n, 3)
        Markers, metres. The rectangle ends at the toe, or `length` ahead of the heel if the marker is further back
        (on the metatarsals).
    heel_grounded, toe_grounded : numpy.ndarray of bool, shape (n,)
        Results of `ground_contact`.
    length, breadth : float
        Size of the foot, metres: `FOOT_LENGTH` and `FOOT_BREADTH` of the stature if not measured.
    """
    line = (toe - heel)[:, :2]
    distance = np.linalg.norm(line, axis=1, keepdims=True)
    forward = line / np.where(distance > 0, distance, np.nan)
    aside = 0.5 * breadth * np.stack([forward[:, 1], -forward[:, 0]], axis=1)
    back, front = heel[:, :2], heel[:, :2] + np.maximum(distance, length) * forward
    corners = np.stack([back - aside, back + aside, front - aside, front + aside], axis=1)
    on_ground = np.stack([heel_grounded, heel_grounded, toe_grounded, toe_grounded], axis=1)
    return BaseOfSupport(corners, on_ground & np.isfinite(corners).all(axis=2))


def ground_contact(marker: np.ndarray, rate: float, height_m: float, speed_m_s: float) -> np.ndarray:
    """Return whether a filtered marker of the foot is on the ground, shape (n,): near its lowest level and slow.

    Parameters
    ----------
    marker : numpy.ndarray, shape (n, 3)
        Positions in m.
    rate, height_m, speed_m_s : float
        Frames per second; largest height above the lowest level; largest speed.
    """
    height = marker[:, 2]
    if not np.isfinite(height).any():
        return np.zeros(len(marker), dtype=bool)
    floor = np.nanpercentile(height, FLOOR_PERCENTILE)
    speed = np.linalg.norm(derivative(marker, rate), axis=1)
    return (height < floor + height_m) & (speed < speed_m_s)


def pendulum_rate(length: np.ndarray | float, gravity: float) -> np.ndarray | float:
    """Return ω0 = √(g/l) of a pendulum in 1/s, shape of `length`.

    Parameters
    ----------
    length : numpy.ndarray or float
        l in m.
    gravity : float
        g in m/s².
    """
    return np.sqrt(gravity / length)


def smallest_impulse(mass: np.ndarray | float, rate: np.ndarray | float, margin: np.ndarray) -> np.ndarray:
    """Return the horizontal impulse in N·s that just moves the extrapolated centre over the edge: m·ω0·b (Hof et al. 2005).

    A push J changes v by J/m, and so the extrapolated centre by J/(m·ω0). If the centre is over the edge already, the impulse is
    negative: it would bring the centre back.

    Parameters
    ----------
    mass, rate : numpy.ndarray, shape (n,), or float
        Mass of body and load in kg; ω0 in 1/s.
    margin : numpy.ndarray, shape (n,)
        Signed distance of the extrapolated centre to the edge in m.
    """
    return mass * rate * margin


def capture_margin(
    offset: np.ndarray,
    velocity: np.ndarray,
    height: np.ndarray,
    limits: tuple[np.ndarray, np.ndarray],
    gravity: float,
) -> np.ndarray:
    """Return the distance in metres from the capture point to the nearer limit of the centre of pressure; positive if capturable.

    Parameters
    ----------
    offset, velocity : numpy.ndarray, shape (n,)
        Position of the centre of mass relative to the pivot along one horizontal axis in m; its velocity in m/s.
    height : numpy.ndarray, shape (n,)
        Height of the centre of mass above the pivot in m.
    limits : tuple of numpy.ndarray, shape (n,)
        How far the centre of pressure can go from the pivot along the axis and against it, in m.
    gravity : float
        g in m/s².
    """
    point = offset + velocity / pendulum_rate(height, gravity)
    return np.minimum(limits[0] - point, limits[1] + point)


def braking_speed(angle: np.ndarray, length: np.ndarray, reach: np.ndarray, gravity: float) -> np.ndarray:
    """Return the largest angular velocity in rad/s towards positive angles at which full braking still stops the pendulum.

    The stable manifold of the saddle θ* = asin(r/l) of θ̈ = (g/l)·(sin θ − r/l): with the potential
    V(θ) = cos θ + (r/l)·θ, θ̇ = sign(θ* − θ)·√(2(g/l)(V(θ*) − V(θ))). Beyond θ*, θ̇ is negative: the pendulum must swing back.

    Parameters
    ----------
    angle, length : numpy.ndarray, shape (n,)
        θ from straight up in rad; l in m.
    reach : numpy.ndarray, shape (n,)
        r in m, the largest braking torque over the weight: how far the centre of pressure can go ahead of the pivot.
    gravity : float
        g in m/s².
    """
    share = np.clip(reach / length, -1.0, 1.0)
    saddle = np.arcsin(share)
    height = np.cos(saddle) + share * saddle - np.cos(angle) - share * angle
    return np.sign(saddle - angle) * np.sqrt(2 * gravity / length * np.maximum(height, 0.0))


def viability_margin(
    angle: np.ndarray,
    angular_velocity: np.ndarray,
    length: np.ndarray,
    mass: np.ndarray | float,
    limits: tuple[np.ndarray, np.ndarray],
    gravity: float,
) -> np.ndarray:
    """Return the impulse across the pendulum in N·s that its torque can just stop; positive if no step is needed.

    The impulse is m·l·(θ̇_braking − θ̇); for small angles it is m·ω0 times the `capture_margin`.

    Parameters
    ----------
    angle, angular_velocity, length : numpy.ndarray, shape (n,)
        θ from straight up in rad; θ̇ in rad/s; l in m.
    mass : numpy.ndarray, shape (n,), or float
        m in kg.
    limits : tuple of numpy.ndarray, shape (n,)
        How far the centre of pressure can go from the pivot towards positive angles and against them, in m.
    gravity : float
        g in m/s².
    """
    forward = braking_speed(angle, length, limits[0], gravity) - angular_velocity
    backward = braking_speed(-angle, length, limits[1], gravity) + angular_velocity
    return mass * length * np.minimum(forward, backward)


@dataclass(frozen=True)
class AnkleTorques:
    """Largest torques of one ankle, N·m."""

    plantar_flexion: float
    """Largest plantar flexion: limits the centre of pressure ahead of the ankle."""
    dorsiflexion: float
    """Largest dorsiflexion: limits the centre of pressure behind the ankle."""
    inversion: float
    """Largest inversion: limits the centre of pressure outward."""
    eversion: float
    """Largest eversion: limits the centre of pressure inward."""


ANKLE_SOURCE = "da Fonseca et al., World J. Orthop. 16 (2025) 108858: mean isokinetic peak torques of 69 men and 31 women"
_MALE, _FEMALE = (158.1, 53.6, 37.0, 33.4), (100.4, 37.4, 30.1, 22.3)
ANKLE_TORQUES = {"male": AnkleTorques(*_MALE), "female": AnkleTorques(*_FEMALE)}
"""Mean torques of one ankle by sex (`ANKLE_SOURCE`)."""
MEAN_ANKLE_TORQUES = AnkleTorques(*np.mean([_MALE, _FEMALE], axis=0).tolist())
"""Torques of one ankle for any other sex: the mean of both."""


def pressure_limits(
    base: BaseOfSupport,
    ankles: np.ndarray,
    standing: np.ndarray,
    right: np.ndarray,
    weight: np.ndarray | float,
    torques: AnkleTorques,
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return by plane the limits of the centre of pressure from the middle of the standing ankles, by foot size and ankle torque.

    Each limit is a distance in m, shape (n,): along the axis (right, forward) and against it. Fore and aft, the torques of all
    standing ankles are added and divided by the weight. Sideways, the weight shifts from foot to foot, and beyond the outer ankle
    only that ankle's torque counts: inversion outward, and eversion inward if only one foot stands.

    Parameters
    ----------
    base : BaseOfSupport
        Base of both feet at n instants.
    ankles : numpy.ndarray, shape (n, 2, 2)
        Left and right ankle, horizontal coordinates in m.
    standing : numpy.ndarray of bool, shape (n, 2)
        Which of them stand.
    right : numpy.ndarray, shape (n, 2)
        Unit vector to the subject's right; forward is a quarter turn to the left of it.
    weight : numpy.ndarray, shape (n,), or float
        m·g of body and load in N.
    torques : AnkleTorques
        Limits of one ankle.
    """
    forward = np.stack([-right[:, 1], right[:, 0]], axis=1)
    pivot = mean_of_grounded(ankles, standing)
    feet = standing.sum(axis=1)
    across = np.einsum("nfj,nj->nf", ankles - pivot[:, None, :], right)
    # To the right of a standing right foot is outward, of a lone left foot inward.
    sides = ((1, standing[:, 1]), (-1, standing[:, 0]))
    lateral = []
    for sign, outward in sides:
        outer = np.where(feet > 0, np.where(standing, sign * across, -np.inf).max(axis=1), np.nan)
        torque = np.where(outward, torques.inversion, torques.eversion)
        lateral.append(np.minimum(base.reach(pivot, sign * right), outer + torque / weight))
    sagittal = [
        np.minimum(base.reach(pivot, sign * forward), feet * torque / weight)
        for sign, torque in ((1, torques.plantar_flexion), (-1, torques.dorsiflexion))
    ]
    return {"lateral_bending": tuple(lateral), "flexion_extension": tuple(sagittal)}


def mean_of_grounded(ankles: np.ndarray, standing: np.ndarray) -> np.ndarray:
    """Return the mean of the ankles (or corners) on the ground, shape (n, d): the pivot; NaN if none is on the ground.

    Parameters
    ----------
    ankles : numpy.ndarray, shape (n, k, d)
        Positions in m.
    standing : numpy.ndarray of bool, shape (n, k)
        Which of them stand.
    """
    weight = standing[..., None].astype(float)
    with np.errstate(invalid="ignore"):
        return (np.nan_to_num(ankles) * weight).sum(axis=1) / weight.sum(axis=1)
