"""The deposit as a motion of three links, and what the controller of a pushed body follows of it.

The links are straight lines between mid-ankle, mid-hip, mid-shoulder and box; their lengths are means over the deposit, so
that a knee that bends a little shortens the legs as a whole. Masses are Winter's; the trunk's centre lies where the
body's common centre with the box is, on average over the deposit, as far ahead of the ankles as the markers say.

Who is pushed does not put the box down in that moment: after the reaction time the posture turns, with least jerk, into the
one from which the deposit began, the box still in the hands, and stays there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.movement.centre_of_mass import SHANK, THIGH, TRUNK_HEAD, WHOLE_ARM, LimbSegment
from lumbar.lifting.movement.joint_centres import MID_HIP
from lumbar.lifting.movement.lift_tables import LOAD, WHOLE_BODY
from lumbar.lifting.pushes.body import (
    GRAVITY,
    LINKS,
    Bodies,
    bodies_of_links,
    centre_of_mass,
    inverse_dynamics,
)

if TYPE_CHECKING:
    from lumbar.lifting.measures.course import Lifter

CENTRE_OF_TRUNK = (0.2, 1.0)
"""Shares of the way from hips to shoulders between which the trunk's centre must lie."""
KNOTS_S, MARGIN_S = 0.2, 0.3
"""Angles are splines of degree 5 with knots at this distance, fitted to the deposit and so much before and after: what
people do on purpose is slower, and the torques of the noise of markers are not."""
THIGH_SHARE = 0.245 / (0.245 + 0.246)
"""Thigh's share of the legs' length (Drillis and Contini, 1966, in Winter, Figure 4.1)."""
SHORTEST_M = 0.05
"""A link shorter than this has no angle worth the name."""


@dataclass(frozen=True)
class DepositMotion:
    """One deposit, from its start to the release, at even instants."""

    subject: str
    lift: str
    mass_kg: float
    height_m: float
    box_mass_kg: float
    time: np.ndarray
    """Shape (n,): s, from the start of the deposit to the release."""
    angle: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    """`angle`, `rate`, `acceleration`: shape (3, n): of legs, trunk and arms: rad from straight up, forward positive,
    rad/s and rad/s²."""
    lengths: np.ndarray
    """Shape (3,): m; means over the deposit."""
    trunk_centre: float
    """Where the trunk's centre lies on the way from hips to shoulders."""
    ankle_height_m: float
    heel_m: float
    toe_m: float
    """`ankle_height_m`, `heel_m`, `toe_m`: of the ankles above the ground; how far heels lie behind and toes ahead of the
    ankles."""


def deposit_motion(lifter: Lifter) -> DepositMotion:
    """Return the three links' motion during the deposit of a lift.

    Raises
    ------
    InputError
        The lift has no deposit, or lacks ankles, heels, toes, shoulders, hips or load in it.
    """
    facts, time = lifter.facts, lifter.time
    if facts["no_deposit"]:
        raise InputError(f"{facts['lift']}: {facts['no_deposit']}, and so no posture to be pushed in")
    feet, joints, centre = _points(lifter)
    start, stop = facts["start_s"], facts["stop_s"]
    near = (time >= start - MARGIN_S) & (time <= stop + MARGIN_S)
    if not np.isfinite(joints[:, near]).all():
        raise InputError(
            f"{facts['lift']}: ankles, hips, shoulders or load are not seen throughout the deposit and {MARGIN_S:g} s beside it"
        )
    # Axes: x to the right, y forward, z up.
    forward, up = np.diff(joints, axis=0)[:, near, 1], np.diff(joints, axis=0)[:, near, 2]
    here = (time >= start) & (time <= stop)
    lengths = np.hypot(forward, up)[:, here[near]].mean(axis=1)
    if (lengths < SHORTEST_M).any():
        raise InputError(
            f"{facts['lift']}: {LINKS[int(lengths.argmin())]} of {lengths.min():.3g} m have no angle"
        )
    spline = _smooth(time[near], np.unwrap(np.arctan2(forward, up), axis=1).T)
    angle, rate, acceleration = (spline(time[here], order).T for order in range(3))
    heel, toe = (float((part - joints[0])[here, 1].mean()) for part in feet)
    ankle_height = float((joints[0] - np.minimum(*feet))[here, 2].mean())
    mass, box = facts["body_mass_kg"], facts["box_mass_kg"]
    motion = DepositMotion(
        *(facts["subject"], facts["lift"], mass, facts["height_m"], box),
        *(time[here], angle, rate, acceleration, lengths),
        *(0.0, max(ankle_height, 0.0), -heel, toe),
    )
    ahead = ((mass * centre + box * joints[-1]) / (mass + box) - joints[0])[here, 1]
    return replace(motion, trunk_centre=_trunk_centre(motion, float(ahead.mean())))


def _points(lifter: Lifter) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Middles of heels and toes; those of ankles, hips and shoulders with the load, shape (4, n, 3); centre of the body."""
    pairs = {name: [f"{side}_{name}" for side in "LR"] for name in ("ANKLE", "SHOULDER", "HEEL", "TOE")}
    lifter.need([*(name for pair in pairs.values() for name in pair), MID_HIP, LOAD, WHOLE_BODY])
    points = lifter.points
    middle = {name: (points[left] + points[right]) / 2 for name, (left, right) in pairs.items()}
    joints = np.stack([middle["ANKLE"], points[MID_HIP], middle["SHOULDER"], points[LOAD]])
    return [middle["HEEL"], middle["TOE"]], joints, points[WHOLE_BODY]


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
        _pair(SHANK, mass, shank, (1 - SHANK.centre) * shank),
        _pair(THIGH, mass, thigh, shank + (1 - THIGH.centre) * thigh),
    )
    centre = np.array([item.trunk_centre for item in motions])
    trunk_mass = TRUNK_HEAD.mass * mass
    trunk = (trunk_mass, centre * lengths[1], trunk_mass * (TRUNK_HEAD.gyration * lengths[1]) ** 2)
    arms = _joined(
        _pair(WHOLE_ARM, mass, lengths[2], WHOLE_ARM.centre * lengths[2]), (box, lengths[2], 0 * box)
    )
    masses, centres, inertias = (np.stack(parts) for parts in zip(legs, trunk, arms, strict=True))
    height = np.array([item.ankle_height_m for item in motions])
    return bodies_of_links(masses, centres, lengths, inertias, height)


def _pair(segment: LimbSegment, mass: np.ndarray, length: np.ndarray, centre: np.ndarray) -> tuple:
    """Mass, centre and inertia about it of the segments of both sides."""
    both = 2 * segment.mass * mass
    return both, centre, both * (segment.gyration * length) ** 2


def _joined(*parts: tuple) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, centre and inertia about it of parts on one line (Huygens and Steiner)."""
    mass = sum(part[0] for part in parts)
    centre = sum(part[0] * part[1] for part in parts) / mass
    return mass, centre, sum(own + m * (place - centre) ** 2 for m, place, own in parts)


@dataclass(frozen=True)
class References:
    """Motions of several lifts on one grid, one after the other."""

    step: float
    """s between instants."""
    first: np.ndarray
    last: np.ndarray
    """`first`, `last`: shape (lifts,): column of each lift's first and last instant."""
    angle: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    """`angle`, `rate`, `acceleration`: shape (3, columns): of the links, rad, rad/s and rad/s²; at rest in each lift's
    last column."""

    def moment(self, lift: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, ...]:
        """Angle, rate and acceleration at some columns, the last of a lift from its end on; shape (3, n) each."""
        at = np.minimum(column, self.last[lift])
        return self.angle[:, at], self.rate[:, at], self.acceleration[:, at]


def references_of(motions: list[DepositMotion], step: float) -> References:
    """Put motions on a grid of `step` seconds."""
    from scipy.interpolate import CubicHermiteSpline

    parts = []
    for motion in motions:
        time = np.arange(motion.time[0], motion.time[-1], step)
        place = CubicHermiteSpline(motion.time, motion.angle, motion.rate, axis=1)
        speed = CubicHermiteSpline(motion.time, motion.rate, motion.acceleration, axis=1)
        moving = place(time), speed(time), speed(time, 1)
        parts.append([np.hstack([item, item[:, -1:] * (kind == 0)]) for kind, item in enumerate(moving)])
    sizes = np.array([part[0].shape[1] for part in parts])
    last = np.cumsum(sizes) - 1
    return References(
        step, last - sizes + 1, last, *(np.hstack(columns) for columns in zip(*parts, strict=True))
    )


def return_motion(phase: float, moving: tuple, start: np.ndarray, duration: float) -> tuple[np.ndarray, ...]:
    """Angle, rate and acceleration on the way from a moving posture to one at rest, shape (3, n) each.

    The way back begins at phase 0, ends at 1 and takes `duration` seconds; `moving` are angle, rate and acceleration of the
    deposit at that time, `start` the angles to go back to.
    """
    s = min(max(phase, 0.0), 1.0)
    share = s**3 * (10 - 15 * s + 6 * s**2)
    speed = 30 * s**2 * (1 - s) ** 2 / duration
    growth = 60 * s * (1 - s) * (1 - 2 * s) / duration**2
    angle, rate, acceleration = moving
    away = start - angle
    return (
        angle + share * away,
        (1 - share) * rate + speed * away,
        (1 - share) * acceleration - 2 * speed * rate + growth * away,
    )


def target(
    bodies: Bodies, references: References, lift, instant, halves: int, reaction: float, duration: float
) -> tuple:
    """Angle, rate and joint torques that the controller follows `halves` grid steps after the push, shape (3, n) each."""
    moving = references.moment(lift, instant + halves)
    start = references.angle[:, references.first[lift]]
    phase = (halves * references.step - reaction) / duration
    wanted = return_motion(phase, moving, start, duration) if phase > 0 else moving
    return wanted[0], wanted[1], inverse_dynamics(bodies, *wanted)


def toppling_stiffness(bodies: Bodies) -> np.ndarray:
    """Return the stiffness in N·m/rad that just keeps all above a joint upright, shape (3, bodies): Σ m·g·height."""
    return GRAVITY * np.cumsum(bodies.first_moment[::-1], axis=0)[::-1]


def joint(values: np.ndarray) -> np.ndarray:
    """Return joint angles (or rates) of links' angles, shape (3, ...)."""
    return np.concatenate([values[:1], values[1:] - values[:-1]])
