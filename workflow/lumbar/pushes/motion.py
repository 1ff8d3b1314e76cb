"""The deposit as a motion of three links: angles, rates and lengths from the markers of a lift.

The links are straight lines between mid-ankle, mid-hip, mid-shoulder and box; their lengths are means over the deposit, so
that a knee that bends a little shortens the legs as a whole. Masses are Winter's; the trunk's centre lies where the
body's common centre with the box is, on average over the deposit, as far ahead of the ankles as the markers say.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.errors import InputError
from lumbar.lifting.carried_object import carried_object
from lumbar.lifting.trunk_points import MID_HIP
from lumbar.lifting.whole_body import whole_body_centre
from lumbar.pushes.body import LINKS, Bodies, bodies_of_links, centre_of_mass

if TYPE_CHECKING:
    from lumbar.lifting.lift import AnalysedLift

SHANK, THIGH = (0.093, 0.433, 0.302), (0.200, 0.433, 0.323)
"""Both shanks, both thighs: share of body mass; centre from the upper end and radius of gyration about it, as shares of the
segment's length (Winter, 2009, Table 4.1)."""
TRUNK = (0.578, 0.503)
"""Trunk, head and neck, between greater trochanter and shoulder: share of body mass and radius of gyration (the same
table, which has the centre at 0.66 of the way)."""
CENTRE_OF_TRUNK = (0.2, 1.0)
"""Shares of the way from hips to shoulders between which the trunk's centre must lie."""
KNOTS_S, MARGIN_S = 0.2, 0.3
"""Angles are splines of degree 5 with knots at this distance, fitted to the deposit and so much before and after: what
people do on purpose is slower, and the torques of the noise of markers are not."""
ARMS = (0.100, 0.530, 0.368)
"""Both arms, between shoulder and wrist, the centre from the shoulder (the same table)."""
THIGH_SHARE = 0.245 / (0.245 + 0.246)
"""Thigh's share of the legs' length (Drillis and Contini, 1966, in Winter, Figure 4.1)."""
SHORTEST_M = 0.05
"""A link shorter than this has no angle worth the name."""


@dataclass(frozen=True)
class DepositMotion:
    """One deposit, from its start to the release, at even instants.

    Attributes
    ----------
    subject, lift : str
    mass_kg, height_m, box_mass_kg : float
    time : numpy.ndarray, shape (n,)
        s, from the start of the deposit to the release.
    angle, rate, acceleration : numpy.ndarray, shape (3, n)
        Of legs, trunk and arms: rad from straight up, forward positive, rad/s and rad/s².
    lengths : numpy.ndarray, shape (3,)
        m; means over the deposit.
    trunk_centre : float
        Where the trunk's centre lies on the way from hips to shoulders.
    ankle_height_m, heel_m, toe_m : float
        Of the ankles above the ground; how far heels lie behind and toes ahead of the ankles.
    """

    subject: str
    lift: str
    mass_kg: float
    height_m: float
    box_mass_kg: float
    time: np.ndarray
    angle: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    lengths: np.ndarray
    trunk_centre: float
    ankle_height_m: float
    heel_m: float
    toe_m: float


def deposit_motion(
    lift: AnalysedLift, subject: str, mass_kg: float, height_m: float, box_mass_kg: float
) -> DepositMotion:
    """Return the three links' motion during the deposit of a lift.

    Raises
    ------
    InputError
        The lift has no deposit, lacks ankles, heels, toes, shoulders, hips or hands, or one of them is missing within the
        deposit.
    """
    start, stop = (lift.events[name].time_s for name in ("deposit_start", "release"))
    if start is None or stop is None:
        raise InputError(f"{lift.name}: no deposit, and so no posture to be pushed in")
    feet, joints = _points(lift)
    time = lift.recording.time
    near = (time >= start - MARGIN_S) & (time <= stop + MARGIN_S)
    if not np.isfinite(joints[:, near]).all():
        raise InputError(
            f"{lift.name}: markers of ankles, hips, shoulders or hands are missing within the deposit or {MARGIN_S:g} s of it"
        )
    # Axes: x to the right, y forward, z up.
    forward, up = np.diff(joints, axis=0)[:, near, 1], np.diff(joints, axis=0)[:, near, 2]
    within = time[near][(time[near] >= start) & (time[near] <= stop)]
    lengths = np.hypot(forward, up)[:, (time[near] >= start) & (time[near] <= stop)].mean(axis=1)
    if (lengths < SHORTEST_M).any():
        raise InputError(
            f"{lift.name}: {LINKS[int(lengths.argmin())]} of {lengths.min():.3g} m have no angle"
        )
    spline = _smooth(time[near], np.unwrap(np.arctan2(forward, up), axis=1).T)
    angle, rate, acceleration = (spline(within, order).T for order in range(3))
    here = (time >= start) & (time <= stop)
    heel, toe = (float((feet[name] - joints[0])[here, 1].mean()) for name in ("HEEL", "TOE"))
    ankle_height = float((joints[0] - np.minimum(feet["HEEL"], feet["TOE"]))[here, 2].mean())
    motion = DepositMotion(
        *(subject, lift.name, mass_kg, height_m, box_mass_kg, within, angle, rate, acceleration, lengths),
        *(0.0, max(ankle_height, 0.0), -heel, toe),
    )
    centre = mass_kg * whole_body_centre(lift.recording, lift.points, lift.table) + box_mass_kg * joints[-1]
    ahead = (centre / (mass_kg + box_mass_kg) - joints[0])[here, 1]
    return replace(motion, trunk_centre=_trunk_centre(motion, float(ahead.mean())))


def _points(lift: AnalysedLift) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Middles of heels and toes, and those of ankles, hips and shoulders with box or hands, shape (4, n, 3)."""
    recording, points = lift.recording, lift.points
    needed = [f"{side}_{name}" for side in "LR" for name in ("ANKLE", "HEEL", "TOE", "SHOULDER")]
    lacking = [name for name in needed if name not in recording]
    lacking += [] if MID_HIP in points else [f"{MID_HIP} ({points.missing[MID_HIP]})"]
    hands, _ = carried_object(recording)
    lacking += ["box or wrists"] if hands is None else []
    if lacking:
        raise InputError(f"{lift.name}: a body of three links needs {', '.join(lacking)}")
    middle = {
        name: (recording[f"L_{name}"] + recording[f"R_{name}"]) / 2
        for name in ("ANKLE", "HEEL", "TOE", "SHOULDER")
    }
    return middle, np.stack([middle["ANKLE"], points[MID_HIP], middle["SHOULDER"], hands])


def _smooth(time: np.ndarray, values: np.ndarray):
    """Least-squares spline of degree 5, knots `KNOTS_S` apart."""
    from scipy.interpolate import make_lsq_spline

    pieces = max(1, round((time[-1] - time[0]) / KNOTS_S))
    knots = np.r_[[time[0]] * 5, np.linspace(time[0], time[-1], pieces + 1), [time[-1]] * 5]
    return make_lsq_spline(time, values, knots, k=5)


def _trunk_centre(motion: DepositMotion, ahead: float) -> float:
    """Place of the trunk's centre for which the common centre lies `ahead` of the ankles on average (it is linear in it)."""
    count = len(motion.time)
    low, high = (
        centre_of_mass(
            bodies_of([replace(motion, trunk_centre=share)]).take(np.zeros(count, dtype=int)),
            motion.angle,
            motion.rate,
        )[0].mean()
        for share in (0.0, 1.0)
    )
    share = (ahead - low) / (high - low)
    lowest, highest = CENTRE_OF_TRUNK
    if not lowest <= share <= highest:
        raise InputError(
            f"{motion.lift}: the trunk's centre would lie at {share:.2f} of the way from hips to shoulders for the centre of "
            f"mass that the markers give; allowed: {lowest:g} to {highest:g}: check body mass and box mass"
        )
    return float(share)


def bodies_of(motions: list[DepositMotion]) -> Bodies:
    """Return the body of each motion, the box at the end of its arms."""
    mass, box = (np.array([getattr(item, name) for item in motions]) for name in ("mass_kg", "box_mass_kg"))
    lengths = np.stack([item.lengths for item in motions], axis=1)
    thigh, shank = THIGH_SHARE * lengths[0], (1 - THIGH_SHARE) * lengths[0]
    legs = _joined(
        (SHANK[0] * mass, (1 - SHANK[1]) * shank, SHANK[0] * mass * (SHANK[2] * shank) ** 2),
        (THIGH[0] * mass, shank + (1 - THIGH[1]) * thigh, THIGH[0] * mass * (THIGH[2] * thigh) ** 2),
    )
    centre = np.array([item.trunk_centre for item in motions])
    trunk = (TRUNK[0] * mass, centre * lengths[1], TRUNK[0] * mass * (TRUNK[1] * lengths[1]) ** 2)
    arms = _joined(
        (ARMS[0] * mass, ARMS[1] * lengths[2], ARMS[0] * mass * (ARMS[2] * lengths[2]) ** 2),
        (box, lengths[2], 0 * box),
    )
    masses, centres, inertias = (np.stack(parts) for parts in zip(legs, trunk, arms, strict=True))
    height = np.array([item.ankle_height_m for item in motions])
    return bodies_of_links(masses, centres, lengths, inertias, height)


def _joined(*parts: tuple) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, centre and inertia about it of parts on one line (Huygens and Steiner)."""
    mass = sum(part[0] for part in parts)
    centre = sum(part[0] * part[1] for part in parts) / mass
    return mass, centre, sum(own + m * (place - centre) ** 2 for m, place, own in parts)
