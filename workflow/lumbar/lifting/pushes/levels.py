"""What each measure says of a posture before a push: one level per instant and direction, higher meaning safer.

The measures are those of the chapter on stability, each with its own model of the person; none is told how the simulated body
is built or controlled. Where a measure says which push a person can take, its level with a push is what that push leaves.
A table holds what the pushes need of a lift: the motion of its links and the levels, instant by instant.
"""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pandas as pd

from lumbar.base.yaml_file import shipped_yaml
from lumbar.lifting.measures.balance import (
    ankle_torques,
    braking_speed,
    middle_of_standing,
    pendulum_rate,
    pressure_limits,
)
from lumbar.lifting.measures.course import Lifter, base_of_support, course_of_lift
from lumbar.lifting.movement.cleaning import derivative
from lumbar.lifting.movement.lift_tables import LOAD, WHOLE_BODY
from lumbar.lifting.movement.pendulum_states import planar_states
from lumbar.lifting.pushes.body import LINKS
from lumbar.lifting.pushes.motion import DepositMotion
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.model.eq_4_1_pendulum import SIGNS
from lumbar.lifting.stability.model.eq_4_2_regulator import close_loops
from lumbar.lifting.stability.model.failures import attempts
from lumbar.lifting.stability.model.trajectories import Trajectory, find_problems
from lumbar.settings.stability import StabilitySettings

FORWARD, BACKWARD = "forward", "backward"
DIRECTIONS = {FORWARD: 1.0, BACKWARD: -1.0}
BASIN_COMS = {"abdomen": "the abdomen with its share of the box", "whole_body": "the whole body with the box"}
KNOTS = 200
"""Of basins here: with 1000 the levels change in the fourth digit."""
NOTHING, EXCESS, RATIO, SHIFT = "nothing", "excess", "ratio", "shift"
"""How a push J enters: not at all; J less the level in N·s; J over the level; J/(m·ω0) less the level in m."""


@dataclass(frozen=True)
class Predictor:
    """One measure in the contest."""

    meaning: str
    """What its level is, with the unit."""
    push: str
    """How the size of a push enters: one of the words above."""


def _predictors() -> dict[str, Predictor]:
    """The measures; those of a basin once for every centre of mass and sign."""
    said = shipped_yaml(Path(__file__).with_name("predictors.yaml"))
    basins = {name: said.pop(name) for name in list(said) if "{com}" in name}
    found = {name: Predictor(**words) for name, words in said.items()}
    for com, what in BASIN_COMS.items():
        for sign in SIGNS:
            for name, words in basins.items():
                meaning = words["meaning"].format(com=com, sign=sign, what=what)
                found[name.format(com=com, sign=sign)] = Predictor(meaning, words["push"])
    return found


PREDICTORS = _predictors()
"""All measures, in the order of the tables."""
BASELINES = ("push_alone", "push_over_mass")


@dataclass(frozen=True)
class Levels:
    """Levels of one lift during its deposit."""

    time: np.ndarray
    """Shape (n,): s."""
    values: dict[tuple[str, str], np.ndarray]
    """Dict of (str, str) to numpy.ndarray, shape (n,): by predictor and direction; NaN where there is none."""
    shift: np.ndarray
    """Shape (n,): 1/(m·ω0) in m/(N·s): how far a push moves the extrapolated centre."""
    missing: dict[str, str]
    """Predictors without a level, with the reason."""


def score(predictor: str, level: np.ndarray, impulse: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Return what one of `PREDICTORS` makes of pushes, higher meaning that a step is more likely.

    Level and shift are as of `Levels`; the impulse is without its sign, in N·s.
    """
    rules = {
        NOTHING: lambda: -level,
        EXCESS: lambda: impulse - level,
        # A person beyond the level already steps at any push: the ratio would change its sign.
        RATIO: lambda: impulse / np.maximum(level, 1e-9),
        SHIFT: lambda: impulse * shift - level,
    }
    return rules[PREDICTORS[predictor].push]()


def levels_of(
    lifters: list[Lifter],
    motions: list[DepositMotion],
    trajectories: list[Trajectory | None],
    settings: StabilitySettings,
    push_share: float,
) -> list[Levels]:
    """Return the levels of several lifts, of which the trunk is pushed at a share of the way from hips to shoulders.

    The trajectories are those of the abdomen in the sagittal plane, with the box; None where there is none.
    """
    found = [_balance(lifter, motion) for lifter, motion in zip(lifters, motions, strict=True)]
    whole = [_whole_body(lifter, motion) for lifter, motion in zip(lifters, motions, strict=True)]
    for com, items in (("abdomen", trajectories), ("whole_body", whole)):
        for sign in SIGNS:
            _add_basins(found, com, sign, items, motions, settings, push_share)
    return found


def _balance(lifter: Lifter, motion: DepositMotion) -> Levels:
    """Levels from the movement's measures at the instants of a deposit."""
    here = np.isin(lifter.time, motion.time)
    course, points = course_of_lift(lifter), lifter.points
    body, box = lifter.facts["body_mass_kg"], lifter.facts["box_mass_kg"]
    mass = body + box
    ankles = np.stack([points["L_ANKLE"], points["R_ANKLE"]], axis=1)
    base, standing = base_of_support(lifter)
    centre = (body * points[WHOLE_BODY] + box * points[LOAD]) / mass
    relative = centre - middle_of_standing(ankles, standing)
    speed = derivative(centre, lifter.rate)
    omega = pendulum_rate(np.linalg.norm(relative, axis=1), lifter.gravity)
    right, forward = (axis[:, :2] for axis in lifter.axes)
    limits = pressure_limits(
        base, ankles[..., :2], standing, right, mass * lifter.gravity, ankle_torques(lifter.facts["sex"])
    )["flexion_extension"]
    functional = base.functional(lifter.settings.functional_share)
    offset, rise = np.einsum("nj,nj->n", relative[:, :2], forward), relative[:, 2]
    along = np.einsum("nj,nj->n", speed[:, :2], forward)
    length = np.hypot(offset, rise)
    angle, turning = np.arctan2(offset, rise), (along * rise - offset * speed[:, 2]) / length**2
    values: dict[tuple[str, str], np.ndarray] = {}
    for (name, sign), limit in zip(DIRECTIONS.items(), limits, strict=True):
        margin = course.frame[f"margin_{name}_m"].to_numpy()
        lean = course.frame["trunk_inclination_deg"].to_numpy()
        braking = braking_speed(sign * angle, length, limit, lifter.gravity)
        values |= {
            ("push_alone", name): np.zeros_like(omega),
            ("push_over_mass", name): np.full_like(omega, mass),
            ("margin_of_stability", name): margin,
            ("smallest_impulse", name): mass * omega * margin,
            ("static_margin", name): functional.reach(centre[:, :2], sign * forward),
            ("capture_margin", name): limit - sign * (offset + along / pendulum_rate(rise, lifter.gravity)),
            ("viability_margin", name): mass * length * (braking - sign * turning),
            ("trunk_inclination", name): -lean,
            ("trunk_inclination_towards_push", name): -sign * lean,
            ("l5s1_moment", name): -course.frame["l5s1_moment_N_m"].to_numpy(),
        }
    return Levels(
        motion.time, {key: item[here] for key, item in values.items()}, 1 / (mass * omega[here]), {}
    )


def _whole_body(lifter: Lifter, motion: DepositMotion) -> Trajectory | None:
    """The pendulum of body and box about the middle of the ankles, in the sagittal plane."""
    here = np.isin(lifter.time, motion.time)
    body, box, points = lifter.facts["body_mass_kg"], lifter.facts["box_mass_kg"], lifter.points
    centre = (body * points[WHOLE_BODY] + box * points[LOAD]) / (body + box)
    relative = centre - (points["L_ANKLE"] + points["R_ANKLE"]) / 2
    moving = relative, *(derivative(relative, lifter.rate, order) for order in (1, 2))
    states = planar_states(motion.time, *(part[here, 1:] for part in moving), lifter.facts["lift"])
    trajectory = Trajectory.of_states(
        states,
        subject=lifter.facts["subject"],
        experience=lifter.facts.get("experience", ""),
        box_mass_kg=float(box),
        com="whole body",
        plane="flexion_extension",
        pivot="mid_ankle",
        mass_kg=float(body + box),
    )
    return None if find_problems(trajectory).entries else trajectory


def _add_basins(found, com, sign, trajectories, motions, settings, push_share) -> None:
    """Add impulses and areas of exact basins to the levels."""
    name, area = f"basin_{com}_{sign}", f"basin_area_{com}_{sign}"
    there = [index for index, item in enumerate(trajectories) if item is not None]
    index_of = {id(trajectories[index]): index for index in there}
    settings = replace(settings, knots=KNOTS)
    results, failures = [], []
    for attempt in attempts([trajectories[i] for i in there], name, failures):
        with attempt as items:
            loops = close_loops(items, sign, settings)
            results.append((items, loops, exact_funnels(loops, settings.goal_level)))
    reasons = "; ".join({failure.basin: failure.reason for failure in failures}.values())
    for level in found:
        nowhere = np.full(len(level.time), np.nan)
        level.values.update({(key, direction): nowhere for key in (name, area) for direction in DIRECTIONS})
        level.missing[name] = reasons or "no sound pendulum"
    for items, loops, funnels in results:
        for column, item in enumerate(items):
            index = index_of[id(item)]
            level, motion = found[index], motions[index]
            turn = np.sqrt(funnels.level[:, column] / funnels.cost[:, column, 2])
            phase = (level.time - item.time[0]) / item.duration
            largest = np.interp(phase, np.linspace(0, 1, len(turn)), turn)
            cosines = np.cos(motion.angle[:2])
            lever = motion.lengths[0] * cosines[0] + push_share * motion.lengths[1] * cosines[1]
            inertia = loops.pendulums.inertia[column]
            for direction in DIRECTIONS:
                level.values[name, direction] = inertia * largest / lever
                level.values[area, direction] = np.full(len(level.time), funnels.mean_area[column])
            level.missing.pop(name)


_MOTION = {"angle": "rad", "rate": "rad_s", "acceleration": "rad_s2"}
_ONE_EACH = tuple(item.name for item in fields(DepositMotion) if item.type in ("str", "float"))
"""Values that are the same at all instants of a lift."""


def states_frame(motions: Iterable[DepositMotion], levels: Iterable[Levels]) -> pd.DataFrame:
    """Return motions and levels of several lifts, one row per instant."""
    frames = []
    for motion, level in zip(motions, levels, strict=True):
        columns = {"time_s": motion.time}
        for name, unit in _MOTION.items():
            columns |= {f"{link}_{unit}": row for link, row in zip(LINKS, getattr(motion, name), strict=True)}
        columns["shift_m_per_N_s"] = level.shift
        columns |= {f"{name}_{direction}": item for (name, direction), item in level.values.items()}
        frame = pd.DataFrame(columns)
        for name in _ONE_EACH:
            frame[name] = getattr(motion, name)
        for link, length in zip(LINKS, motion.lengths, strict=True):
            frame[f"{link}_m"] = length
        frames.append(frame)
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def from_states(frame: pd.DataFrame) -> tuple[list[DepositMotion], list[Levels]]:
    """Return the motions and levels of a table of `states_frame`."""
    motions, levels = [], []
    if frame.empty:
        return motions, levels
    for _, part in frame.groupby("lift", sort=False):
        first = part.iloc[0]
        moving = {
            name: np.stack([part[f"{link}_{unit}"].to_numpy(float) for link in LINKS])
            for name, unit in _MOTION.items()
        }
        one = {name: first[name] if name in ("subject", "lift") else float(first[name]) for name in _ONE_EACH}
        time = part["time_s"].to_numpy(float)
        lengths = np.array([first[f"{link}_m"] for link in LINKS], dtype=float)
        motions.append(DepositMotion(time=time, lengths=lengths, **moving, **one))
        values = {
            (name, direction): part[f"{name}_{direction}"].to_numpy(float)
            for name in PREDICTORS
            for direction in DIRECTIONS
        }
        levels.append(Levels(time, values, part["shift_m_per_N_s"].to_numpy(float), {}))
    return motions, levels
