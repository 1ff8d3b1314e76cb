"""Load of the back: posture of the trunk, net moment at a joint from all segments above it, and strength of the trunk.

The moment is computed top-down from movement and inertia (Winter 2009, section 5): M = Σ (c − p) × m·(a + g·ẑ) + dH/dt, over
segments with centre c, mass m, acceleration a and angular momentum H about the centre; p is the joint. It is the moment that
muscles and ligaments exert; the moment of the weight about the joint is opposite.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.movement.cleaning import derivative
from lumbar.lifting.movement.joint_centres import typical_distance, unit

UPRIGHT_SHARE = 5.0
"""Percentage of the frames, those with the straightest trunk, in which the lumbar spine counts as not bent."""
UPRIGHT_DEG = 15.0
"""Largest inclination of the trunk in upright standing."""


def inclination(line: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Return a line's angle from the vertical in degrees, shape (n,), in the plane of `towards`, positive towards it.

    Parameters
    ----------
    line, towards : numpy.ndarray, shape (n, 3)
        Line from below to above, of any length; horizontal unit vectors.
    """
    return np.degrees(np.arctan2(np.einsum("nj,nj->n", line, towards), line[:, 2]))


def subtract_upright(bend: np.ndarray, trunk: np.ndarray, forward: np.ndarray) -> np.ndarray:
    """Return an angle less its mean in upright standing, shape (n,) in degrees.

    Upright standing is the `UPRIGHT_SHARE` per cent of the frames with the straightest trunk, as in Plamondon et al. (2010).

    Parameters
    ----------
    bend : numpy.ndarray, shape (n,)
        Angle in degrees.
    trunk, forward : numpy.ndarray, shape (n, 3)
        Line from L5/S1 to C7/T1; horizontal unit vectors.

    Raises
    ------
    InputError
        If the subject never stands upright.
    """
    lean = np.abs(inclination(trunk, forward))
    known = np.isfinite(bend) & np.isfinite(lean)
    if not known.any():
        raise InputError("the segments on both sides of the joint are never seen together")
    straightest = np.percentile(lean[known], UPRIGHT_SHARE)
    if straightest > UPRIGHT_DEG:
        raise InputError(
            f"the trunk never stands upright (it leans {straightest:.0f}° at least): the angle of standing is not known"
        )
    return bend - bend[known & (lean <= straightest)].mean()


@dataclass(frozen=True)
class Link:
    """Motion and mass of one segment or load."""

    mass_kg: np.ndarray | float
    """Mass: a number, or shape (n,) for a load that is carried only in some frames."""
    centre: np.ndarray
    """Shape (n, 3): centre of mass, metres."""
    axis: np.ndarray | None = None
    """Shape (n, 3): line along the segment, in metres; None for a point mass."""
    gyration: float = 0.0
    """Radius of gyration about the centre, across the axis, as a share of the axis's length."""


def net_moment(joint: np.ndarray, links: Iterable[Link], rate: float, gravity: float) -> np.ndarray:
    """Return the moment at a joint on all links above it, shape (n, 3) in N·m.

    Accelerations are central differences of filtered positions, z up.

    Parameters
    ----------
    joint : numpy.ndarray, shape (n, 3)
        Position of the joint in m; it may move.
    links : iterable of Link
        All links that the joint carries.
    rate, gravity : float
        Frames per second; gravitational acceleration in m/s².
    """
    total = np.zeros_like(joint)
    for link in links:
        mass = np.reshape(link.mass_kg, (-1, 1))
        force = mass * (derivative(link.centre, rate, 2) + np.array([0.0, 0.0, gravity]))
        total = total + np.where(mass > 0, np.cross(link.centre - joint, force), 0.0)
        if link.axis is not None and link.gyration:
            # A slender body has no moment of inertia along its axis u, so that H = m·k²·(u × u̇) and dH/dt = m·k²·(u × ü).
            radius = link.gyration * typical_distance(np.zeros_like(link.axis), link.axis)
            direction = unit(link.axis)
            total = total + mass * radius**2 * np.cross(direction, derivative(direction, rate, 2))
    return total


TRUNK_SOURCE = (
    "Chaffin et al. 1999, Table 4.5 (men at 20, 40 and 60° of flexion), as given in J. Electromyogr. Kinesiol. 22 (2012) "
    "814-820, Table 2; women 65 % of it (60 to 70 % in Kumar et al., Spine 20 (1995) 160-168)"
)
_FLEXION_DEG, _EXTENSION_N_M = (20.0, 40.0, 60.0), (288.0, 232.0, 171.0)
_TRUNK_OF_WOMEN = 0.65


def trunk_extension_strength(inclination_deg: np.ndarray, sex: str) -> np.ndarray:
    """Return the largest extension moment of the trunk in N·m at its inclination, shape (n,): mean of `TRUNK_SOURCE`.

    The strength is interpolated linearly between the published angles and constant beyond them.

    Parameters
    ----------
    inclination_deg : numpy.ndarray, shape (n,)
        Angle of the trunk from straight up, positive forward.
    sex : str
        ``male`` or ``female``; any other value takes the mean of both.
    """
    share = {"male": 1.0, "female": _TRUNK_OF_WOMEN}.get(sex, (1 + _TRUNK_OF_WOMEN) / 2)
    return share * np.interp(inclination_deg, _FLEXION_DEG, _EXTENSION_N_M)
