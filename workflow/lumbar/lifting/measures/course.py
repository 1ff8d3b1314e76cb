"""The course of all measures over a lift, instant by instant, from the body's trajectories."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import product

import numpy as np
import pandas as pd

from lumbar.base.errors import InputError
from lumbar.lifting.measures import back_load, balance
from lumbar.lifting.measures.back_load import Link
from lumbar.lifting.movement.centre_of_mass import HEAD as WINTER_HEAD
from lumbar.lifting.movement.centre_of_mass import limb_parts
from lumbar.lifting.movement.cleaning import derivative
from lumbar.lifting.movement.joint_centres import MID_HIP, SIDES, unit
from lumbar.lifting.movement.lift_tables import HEAD, LOAD, WHOLE_BODY, com_of, points_of
from lumbar.lifting.movement.pendulum_states import PLANES
from lumbar.settings.lifting import MeasureSettings

CORNERS = 8
"""Number of corners of the base: four for each foot."""
DIRECTIONS = ("forward", "right", "backward", "left")
_TRUNK_GYRATION = {"thorax": {"male": 0.320, "female": 0.314}, "abdomen": {"male": 0.383, "female": 0.354}}
"""Radii of gyration of upper (cervicale-xiphion) and middle trunk about the transverse axis, shares of their lengths, by sex
(de Leva 1996, Table 4); Winter gives none."""


@dataclass(frozen=True)
class Course:
    """Measures of a lift at every instant."""

    frame: pd.DataFrame
    """One row per instant, one column per measure (names: `lumbar.lifting.measures.lift_values`), without those in `missing`."""
    missing: dict[str, str] = field(default_factory=dict)
    """Columns that cannot be computed from the recording, with the reason."""
    unseen: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Required points by column: they are the reason if a value is missing at an instant."""
    notes: tuple[str, ...] = ()
    """Assumptions made in place of missing markers."""


@dataclass(frozen=True)
class Lifter:
    """Trajectories of a lifter's body, with the facts and settings for its measures."""

    body: pd.DataFrame
    """Result of `lumbar.lifting.movement.lift_tables.body_frame`."""
    facts: Mapping
    """``body_mass_kg, box_mass_kg, height_m, sex, mass_kg`` (trunk segments), ``missing_points``."""
    settings: MeasureSettings
    gravity: float
    """Gravitational acceleration, m/s²."""

    @cached_property
    def time(self) -> np.ndarray:
        """Seconds, shape (n,)."""
        return self.body["time_s"].to_numpy(dtype=float)

    @cached_property
    def rate(self) -> float:
        """Frames per second."""
        return float((len(self.time) - 1) / (self.time[-1] - self.time[0]))

    @cached_property
    def points(self) -> dict[str, np.ndarray]:
        """Points by name, each of shape (n, 3)."""
        return points_of(self.body)

    @cached_property
    def load(self) -> np.ndarray:
        """Mass in the hands, kilograms, shape (n,)."""
        return self.facts["box_mass_kg"] * self.body["load_held"].to_numpy(dtype=float)

    @cached_property
    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Horizontal unit vectors to the subject's right and forward, each of shape (n, 3)."""
        across = unit(self.body[["RIGHT_x", "RIGHT_y", "RIGHT_z"]].to_numpy(dtype=float) * [1.0, 1.0, 0.0])
        return across, np.cross([0.0, 0.0, 1.0], across)

    @property
    def load_points(self) -> tuple[str, ...]:
        """Name of the load in a tuple; empty without a load."""
        return (LOAD,) if self.load.any() else ()


def course_of_lift(lifter: Lifter) -> Course:
    """Compute all measures at every instant; measures that need missing points are left out, with the reason."""
    columns: dict[str, np.ndarray] = {
        "time_s": lifter.time,
        **{name: lifter.body[name].to_numpy() for name in ("phase", "load_held")},
    }
    missing: dict[str, str] = {}
    unseen: dict[str, tuple[str, ...]] = {}
    # Balance needs the whole body, the ankles, and an end of each foot: one of both is enough.
    ends = [[f"{side}_{name}" for name in ("HEEL", "TOE")] for side in SIDES]
    feet = [name for pair in ends for name in ([name for name in pair if name in lifter.points] or pair)]
    arms = [f"{side}_{name}" for side in SIDES for name in ("SHOULDER", "WRIST")]
    trunk = (com_of("thorax"), com_of("abdomen"), "C7T1", "T12L1", "L4L5", "L5S1")
    parts: list[tuple[Callable[[Lifter], dict[str, np.ndarray]], Iterable[str], Iterable[str]]] = [
        (_balance, (WHOLE_BODY, "L_ANKLE", "R_ANKLE", *feet, *lifter.load_points), BALANCE_COLUMNS),
        (
            lambda lifter: {
                "trunk_inclination_deg": back_load.inclination(
                    lifter.points["C7T1"] - lifter.points["L5S1"], lifter.axes[1]
                )
            },
            ("L5S1", "C7T1"),
            ("trunk_inclination_deg",),
        ),
        (
            partial(_joint_angle, column="lumbar_flexion_deg", lines=LUMBAR_LINES, is_bend=True),
            # An angle about a T12 that a rule puts between thorax and pelvis shows the rule.
            ("L5S1", "C7T1", "T12L1", MID_HIP, *({"T12"} & lifter.facts["missing_points"].keys())),
            ("lumbar_flexion_deg",),
        ),
        (_moment, (*trunk, HEAD, *arms, *lifter.load_points), MOMENT_COLUMNS),
    ]
    for (joint, lines), side in product(JOINT_ANGLES.items(), SIDES):
        lines = tuple((start.format(side), end.format(side)) for start, end in lines)
        points = [end for line in lines for end in line] + (["C7T1"] if joint == "hip_flexion" else [])
        column, is_bend = f"{side.lower()}_{joint}_deg", joint == "hip_flexion"
        angle = partial(_joint_angle, column=column, lines=lines, is_bend=is_bend)
        parts.append((angle, dict.fromkeys(points), (column,)))
    for part, points, names in parts:
        unseen.update(dict.fromkeys(names, tuple(points)))
        lacking = [name for name in points if name not in lifter.points]
        reasons = dict.fromkeys(lifter.facts["missing_points"].get(name, f"no {name}") for name in lacking)
        try:
            if lacking:
                raise InputError(_join_reasons(reasons))
            columns.update(part(lifter))
        except InputError as error:
            missing.update(dict.fromkeys(names, str(error)))
    # The larger angle of both sides of every joint, or that of the known side.
    for joint in JOINT_ANGLES:
        sides = [f"{side.lower()}_{joint}_deg" for side in SIDES]
        known = [column for column in sides if column in columns]
        if known:
            columns[f"{joint}_deg"] = np.maximum.reduce([columns[column] for column in known])
            unseen[f"{joint}_deg"] = tuple(
                dict.fromkeys(point for column in known for point in unseen[column])
            )
        else:
            missing[f"{joint}_deg"] = _join_reasons(dict.fromkeys(missing[column] for column in sides))
    notes = [
        f"{name} has no marker: it is put {balance.FOOT_LENGTH:g} of the stature from the other end of the foot, in the "
        "direction that the subject faces"
        for pair in ends
        for name in pair
        if BALANCE_COLUMNS[0] not in missing and name not in lifter.points
    ]
    return Course(pd.DataFrame(columns), missing, unseen, tuple(notes))


def _join_reasons(reasons: Iterable[str]) -> str:
    """Return reasons as one text with one list of all missing points."""
    lists = {reason: re.fullmatch(r"no (?:marker )?([A-Z]\w+(?:, [A-Z]\w+)*)", reason) for reason in reasons}
    names = sorted({name for match in lists.values() if match for name in match[1].split(", ")})
    others = [reason for reason, match in lists.items() if not match]
    return "; ".join([*([f"no {', '.join(names)}"] if names else []), *others])


BALANCE_COLUMNS = (
    "margin_of_stability_m",
    "smallest_impulse_N_s",
    *(f"{stem}_{plane}_{unit}" for plane in PLANES for stem, unit in (
        ("margin_of_stability", "m"), ("smallest_impulse", "N_s"), ("capture_margin", "m"), ("viability_margin", "N_s")
    )),
)  # fmt: skip
MOMENT_COLUMNS = (
    "l5s1_moment_N_m",
    "l5s1_extension_N_m",
    "l5s1_lateral_N_m",
    "l5s1_moment_per_kg_N_m_kg",
    "l5s1_strength_share",
)


def base_of_support(lifter: Lifter) -> tuple[balance.BaseOfSupport, np.ndarray]:
    """Return the base of both feet, and whether each foot is on the ground, shape (n, 2): left, right."""
    stature, settings = lifter.facts["height_m"], lifter.settings
    size = balance.FOOT_LENGTH * stature, balance.FOOT_BREADTH * stature
    limits = settings.contact_height_m, settings.contact_speed_m_s
    foot, feet = size[0] * lifter.axes[1], []
    for side in "LR":
        # An end of the foot without a marker is a foot's length from the other end.
        heel, toe = (lifter.points.get(f"{side}_{name}") for name in ("HEEL", "TOE"))
        heel, toe = toe - foot if heel is None else heel, heel + foot if toe is None else toe
        on_ground = (balance.ground_contact(marker, lifter.rate, *limits) for marker in (heel, toe))
        feet.append(balance.footprint(heel, toe, *on_ground, *size))
    parts = (
        np.concatenate([getattr(foot, name) for foot in feet], axis=1) for name in ("corners", "grounded")
    )
    standing = np.stack([foot.grounded.any(axis=1) for foot in feet], axis=1)
    return balance.BaseOfSupport(*parts), standing


def base_from_course(course: pd.DataFrame) -> balance.BaseOfSupport:
    """Return the base of support at the instants of some rows of a course."""
    columns = [[f"base_{corner}_{axis}_m" for axis in "xy"] for corner in range(1, CORNERS + 1)]
    corners = np.stack([course[pair].to_numpy(float) for pair in columns], axis=1)
    return balance.BaseOfSupport(corners, np.isfinite(corners).all(axis=2))


def _balance(lifter: Lifter) -> dict[str, np.ndarray]:
    base, standing = base_of_support(lifter)
    functional = base.functional(lifter.settings.functional_share)
    ankles = np.stack([lifter.points["L_ANKLE"], lifter.points["R_ANKLE"]], axis=1)
    # Centre of mass of the body and, while it is held, of the load, and its velocity.
    body, body_mass = lifter.points[WHOLE_BODY], lifter.facts["body_mass_kg"]
    centre, velocity = body_mass * body, body_mass * derivative(body, lifter.rate)
    if lifter.load_points:
        held, load = lifter.load[:, None], lifter.points[LOAD]
        centre = centre + np.where(held > 0, held * load, 0.0)
        velocity = velocity + np.where(held > 0, held * derivative(load, lifter.rate), 0.0)
    mass = body_mass + lifter.load
    centre, velocity = centre / mass[:, None], velocity / mass[:, None]
    # Extrapolated centre of mass x + v/ω0 (Hof et al. 2005, Eq. 5) against the functional base, as a whole and by direction.
    relative = centre - balance.mean_of_grounded(ankles, standing)
    omega = balance.pendulum_rate(np.linalg.norm(relative, axis=1), lifter.gravity)
    point = centre[:, :2] + velocity[:, :2] / omega[:, None]
    margin, direction = functional.margin(point)
    right, forward = (axis[:, :2] for axis in lifter.axes)
    axes = dict(zip(DIRECTIONS, (forward, right, -forward, -right), strict=True))
    reaches = {name: functional.reach(point, axis) for name, axis in axes.items()}
    # The nearest of the subject's four directions; empty if unknown.
    along = np.stack([np.einsum("nj,nj->n", direction, axis) for axis in axes.values()])
    nearest = np.array(DIRECTIONS)[np.nan_to_num(along).argmax(axis=0)]
    columns = {
        "com_x_m": centre[:, 0],
        "com_y_m": centre[:, 1],
        "com_z_m": centre[:, 2],
        "xcom_x_m": point[:, 0],
        "xcom_y_m": point[:, 1],
        **{f"margin_{name}_m": values for name, values in reaches.items()},
        "margin_of_stability_m": margin,
        "margin_direction": np.where(np.isfinite(along[0]), nearest, ""),
        "smallest_impulse_N_s": balance.smallest_impulse(mass, omega, margin),
    }
    # Capture point and pendulum against the limits of the centre of pressure, by plane.
    weight = mass * lifter.gravity
    torques = balance.ANKLE_TORQUES.get(lifter.facts["sex"], balance.MEAN_ANKLE_TORQUES)
    limits = balance.pressure_limits(base, ankles[..., :2], standing, right, weight, torques)
    for plane, axis, pair in (
        ("flexion_extension", forward, ("forward", "backward")),
        ("lateral_bending", right, ("right", "left")),
    ):
        smaller = np.minimum(reaches[pair[0]], reaches[pair[1]])
        columns[f"margin_of_stability_{plane}_m"] = smaller
        columns[f"smallest_impulse_{plane}_N_s"] = balance.smallest_impulse(mass, omega, smaller)
        # Motion in the plane, about the middle of the standing ankles.
        offset, height = np.einsum("nj,nj->n", relative[:, :2], axis), relative[:, 2]
        speed, rise = np.einsum("nj,nj->n", velocity[:, :2], axis), velocity[:, 2]
        length, angle = np.hypot(offset, height), np.arctan2(offset, height)
        rate = (speed * height - offset * rise) / length**2
        capture = balance.capture_margin(offset, speed, height, limits[plane], lifter.gravity)
        columns[f"capture_margin_{plane}_m"] = capture
        viability = balance.viability_margin(angle, rate, length, mass, limits[plane], lifter.gravity)
        columns[f"viability_margin_{plane}_N_s"] = viability
    drawn = np.where(base.grounded[..., None], base.corners, np.nan)
    for corner in range(CORNERS):
        columns[f"base_{corner + 1}_x_m"], columns[f"base_{corner + 1}_y_m"] = drawn[:, corner].T
    return columns


LUMBAR_LINES = (("T12L1", "C7T1"), (MID_HIP, "L5S1"))
JOINT_ANGLES = {
    "hip_flexion": ((MID_HIP, "L5S1"), ("{}_KNEE", "{}_HIP")),
    "knee_flexion": (("{}_KNEE", "{}_HIP"), ("{}_ANKLE", "{}_KNEE")),
    "shoulder_elevation": (("{}_SHOULDER", "{}_ELBOW"), ("C7T1", "L5S1")),
}
"""Two lines by angle, each line from one point to another, of a side (``{}``) or of the trunk.

The angle of the hip is in the sagittal plane, less its mean in upright standing; the other angles are 0 for parallel lines.
"""


def _joint_angle(
    lifter: Lifter, column: str, lines: tuple[tuple[str, str], ...], is_bend: bool
) -> dict[str, np.ndarray]:
    """Return the angle between two lines, 0 to 180 degrees; for a sagittal angle, less its mean in upright standing."""
    points, forward = lifter.points, lifter.axes[1]
    one, other = (points[end] - points[start] for start, end in lines)
    if is_bend:
        bend = back_load.inclination(one, forward) - back_load.inclination(other, forward)
        return {column: back_load.subtract_upright(bend, points["C7T1"] - points["L5S1"], forward)}
    across, along = np.linalg.norm(np.cross(one, other), axis=1), np.sum(one * other, axis=1)
    return {column: np.degrees(np.arctan2(across, along))}


def links_above_l5s1(lifter: Lifter) -> list[Link]:
    """Return the links that L5/S1 carries: thorax, abdomen, head, arms and load. The box is a point mass at its centre."""
    points, mass, sex = lifter.points, lifter.facts["body_mass_kg"], lifter.facts["sex"]
    links = []
    for segment, top, bottom in (("thorax", "C7T1", "T12L1"), ("abdomen", "T12L1", "L4L5")):
        shares, own_mass = _TRUNK_GYRATION[segment], lifter.facts["mass_kg"][segment]["without_box"]
        gyration = shares.get(sex, float(np.mean(list(shares.values()))))
        links.append(Link(own_mass, points[com_of(segment)], points[top] - points[bottom], gyration))
    head, neck = points[HEAD], points[HEAD] - points["C7T1"]
    links.append(Link(WINTER_HEAD.mass * mass, head, neck, WINTER_HEAD.gyration))
    for segment, first, last in (part for side in SIDES for part in limb_parts(points, side, "ARM")):
        centre, gyration = first + segment.centre * (last - first), np.nan_to_num(segment.gyration)
        links.append(Link(segment.mass * mass, centre, last - first, gyration))
    return [*links, Link(lifter.load, points[LOAD])] if lifter.load_points else links


def _moment(lifter: Lifter) -> dict[str, np.ndarray]:
    joint, mass = lifter.points["L5S1"], lifter.facts["body_mass_kg"]
    moment = back_load.net_moment(joint, links_above_l5s1(lifter), lifter.rate, lifter.gravity)
    right, forward = lifter.axes
    resultant = np.linalg.norm(moment, axis=1)
    extension = np.einsum("nj,nj->n", moment, right)
    lean = back_load.inclination(lifter.points["C7T1"] - joint, forward)
    strength = back_load.trunk_extension_strength(lean, lifter.facts["sex"])
    return {
        "l5s1_moment_N_m": resultant,
        "l5s1_extension_N_m": extension,
        "l5s1_lateral_N_m": np.einsum("nj,nj->n", moment, forward),
        "l5s1_twist_N_m": moment[:, 2],
        "l5s1_moment_per_kg_N_m_kg": resultant / mass,
        "l5s1_strength_share": extension / strength,
    }
