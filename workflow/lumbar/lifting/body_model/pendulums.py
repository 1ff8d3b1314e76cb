"""Centres of mass, pendulum states and basin areas of the fitted body model, each with its spread.

The same functions as for the rules (`lumbar.lifting.movement`) turn its joints into centres of mass and pendulum states, once
with the most probable unknowns and once with each draw from their posterior: the spread of the results is their uncertainty,
with all that the unknowns share. What spreads: joints, landmarks and noise as far as the trial and the priors leave them
open. What does not: the segment table's shares (their spread is listed by `lumbar.lifting.movement.model_spread`) and the
instants of the events.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import pandas as pd

from lumbar.lifting.body_model.build import at_nodes, build, measured_markers
from lumbar.lifting.body_model.fit import BodyFit, fit, model_points, model_recording
from lumbar.lifting.body_model.structure import Unknowns
from lumbar.lifting.movement.centre_of_mass import SegmentTable, centres_of_mass
from lumbar.lifting.movement.events import Event, held_frames
from lumbar.lifting.movement.lift import AnalysedLift
from lumbar.lifting.movement.pendulum_states import PendulumStates, pendulum_states, pivot_trajectory, turn
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.model.eq_4_2_regulator import close_loops
from lumbar.lifting.stability.model.failures import attempts
from lumbar.lifting.stability.model.trajectories import Trajectory, find_problems
from lumbar.records.markers import read_markers
from lumbar.settings.lifting import BodyModelSettings, LiftingSettings
from lumbar.settings.stability import StabilitySettings
from lumbar.settings.subject import SubjectSettings, TrialSettings

Planar = dict[tuple[str, str], PendulumStates]


@dataclass(frozen=True)
class Conditions:
    """What turns a moving body into pendulums: as of the rules' result for the same lift."""

    table: SegmentTable
    body_mass: float
    box_mass: float
    """`body_mass`, `box_mass`: kilograms."""
    heading: float
    """Radians by which the axes are turned."""
    events: Mapping[str, Event]
    settings: LiftingSettings
    """Pivot, how the box counts, and length of the states."""


@dataclass(frozen=True)
class ModelPendulums:
    """Pendulums of the deposit, by centre of mass and plane."""

    states: Planar
    """Of the most probable unknowns."""
    draws: list[Planar]
    """Of unknowns drawn from the posterior."""
    masses: dict[str, tuple[float, float]]
    """Of each centre of mass without and with its share of the box, kilograms."""

    def sd(self, com: str, plane: str) -> PendulumStates:
        """Standard deviation of every state (of its time: 0), as the spread of the draws about the most probable."""
        best = self.states[com, plane]
        drawn = [draw[com, plane] for draw in self.draws]

        def spread(name: str) -> np.ndarray:
            off = [getattr(states, name) - getattr(best, name) for states in drawn]
            return np.sqrt(np.mean(np.square(off), axis=0))

        return PendulumStates(*(spread(field.name) for field in fields(PendulumStates)))


def model_pendulums(fit: BodyFit, conditions: Conditions, draws: Sequence[Unknowns]) -> ModelPendulums:
    """Pendulum states of a fitted body, and of draws from its posterior; the conditions have a start of deposit and a release.

    Raises
    ------
    InputError
        The model lacks the pivot's points, or the deposit is too short.
    """
    best, masses = _states(fit, fit.best, conditions)
    return ModelPendulums(best, [_states(fit, draw, conditions)[0] for draw in draws], masses)


def _states(
    fit: BodyFit, unknowns: Unknowns, conditions: Conditions
) -> tuple[Planar, dict[str, tuple[float, float]]]:
    recording, points = model_recording(fit, unknowns), model_points(fit, unknowns)
    events, settings = dict(conditions.events), conditions.settings
    masses = conditions.body_mass, conditions.box_mass
    centres = centres_of_mass(recording, points, conditions.table, *masses, settings.box.share, events)
    pivot = pivot_trajectory(replace(recording, source="body model"), points, settings.pivot)
    start, stop = events["deposit_start"].time_s, events["release"].time_s
    states: Planar = {}
    for com, centre in centres.items():
        position = centre.position_with_box if settings.box.in_position else centre.position
        relative = turn(position - pivot, conditions.heading)
        name = f"body model, {com}"
        planar = pendulum_states(recording.time, relative, start, stop, settings.points, name)
        states |= {(com, plane): values for plane, values in planar.items()}
    return states, {com: (centre.mass_kg, centre.mass_with_box_kg) for com, centre in centres.items()}


COLUMNS = (
    *("com", "plane", "sign", "mean_area", "mean_area_low", "mean_area_high", "mean_area_sd"),
    *("draws", "draws_without_basin", "no_basin_share"),
)
COVERAGE = 0.95
"""Share of the draws that an interval holds."""
TOGETHER = 50
"""Basins computed at once; where one fails, these are computed one by one."""


def basin_intervals(
    pendulums: ModelPendulums, settings: StabilitySettings, sign: str, pivot: str
) -> pd.DataFrame:
    """Mean basin area of each pendulum with the interval that the body model leaves it: columns `COLUMNS`.

    A draw's pendulum may have no basin (too short, or one that reaches beyond any body): ``no_basin_share`` is how probable that
    is. The interval is one of the area where there is a basin; area and interval are NaN where the most probable pendulum has
    none. `sign` is that of gravity, hanging or inverted.
    """
    best = {
        key: _trajectory(pendulums.states, pendulums, key, settings.pendulum.mass, pivot)
        for key in pendulums.states
    }
    drawn = {
        key: [_trajectory(draw, pendulums, key, settings.pendulum.mass, pivot) for draw in pendulums.draws]
        for key in best
    }
    areas = _areas([*best.values(), *(one for many in drawn.values() for one in many)], settings, sign)
    rows = []
    for key, trajectory in best.items():
        found = [areas[id(one)] for one in drawn[key] if id(one) in areas]
        low, high, sd = np.nan, np.nan, np.nan
        if id(trajectory) in areas and len(found) > 1:
            low, high = np.percentile(found, [50 * (1 - COVERAGE), 50 * (1 + COVERAGE)])
            sd = np.std(found, ddof=1)
        area = areas.get(id(trajectory), np.nan)
        lost = len(drawn[key]) - len(found)
        rows.append((*key, sign, area, low, high, sd, len(found), lost, lost / max(1, len(drawn[key]))))
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _areas(trajectories: list[Trajectory], settings: StabilitySettings, sign: str) -> dict[int, float]:
    """Mean area of every trajectory that has a basin, by its identity."""
    sound = [one for one in trajectories if not find_problems(one).entries]
    areas: dict[int, float] = {}
    for at in range(0, len(sound), TOGETHER):
        for attempt in attempts(sound[at : at + TOGETHER], "body model", []):
            with attempt as some:
                funnels = exact_funnels(close_loops(some, sign, settings), settings.goal_level)
                areas |= zip(map(id, some), funnels.mean_area, strict=True)
    return areas


def _trajectory(
    states: Planar, pendulums: ModelPendulums, key: tuple[str, str], mass: str, pivot: str
) -> Trajectory:
    com, plane = key
    values = states[key]
    return Trajectory(
        "body model", "", 0.0, com, plane, pivot,
        values.time, values.angle, values.angular_velocity, values.angular_acceleration,
        pendulums.masses[com][mass == "with_box"], float(values.length.mean()),
    )  # fmt: skip


SEED = 0
STATE_COLUMNS = (
    *("com", "plane", "time_s", "angle_rad", "angle_sd_rad"),
    *("angular_velocity_rad_s", "angular_velocity_sd_rad_s", "angular_acceleration_rad_s2"),
    *("length_m", "length_sd_m", "length_rate_m_s"),
)
"""Of the model's pendulum states."""
MARKERS = ("marker", "part", "sd_mm", "correlation", "share_left_out", "remark")
"""Of what the model made of every marker."""


@dataclass(frozen=True)
class ModelledLift:
    """A lift by the body model."""

    fit: BodyFit
    pendulums: ModelPendulums

    def states_frame(self) -> pd.DataFrame:
        """Pendulum states with standard deviations, one row per centre of mass, plane and instant."""
        frames = [pd.DataFrame(columns=list(STATE_COLUMNS))]
        for (com, plane), states in self.pendulums.states.items():
            sd = self.pendulums.sd(com, plane)
            values = (
                *(com, plane, states.time, states.angle, sd.angle),
                *(states.angular_velocity, sd.angular_velocity, states.angular_acceleration),
                *(states.length, sd.length, states.length_rate),
            )
            frames.append(pd.DataFrame(dict(zip(STATE_COLUMNS, values, strict=True))))
        return pd.concat(frames[1:] or frames, ignore_index=True)

    def markers_frame(self) -> pd.DataFrame:
        """What the model made of every marker: its noise, how long it stays, and the share of its frames left out."""
        rows = []
        for measurement in self.fit.model.measurements:
            if measurement.observed is None:
                continue
            noise, kept = self.fit.noise[measurement.name], self.fit.kept[measurement.name]
            seen = measurement.seen.sum()
            part = measurement.first[0] or "limb"
            rows.append((measurement.name, part, 1e3 * noise.sd, noise.phi, 1 - kept.sum() / seen, ""))
        rows += [(name, "", np.nan, np.nan, 1.0, reason) for name, reason in self.fit.model.unused.items()]
        return pd.DataFrame(rows, columns=list(MARKERS))


def model_of_lift(
    markers: str | os.PathLike,
    lift: AnalysedLift,
    subject: SubjectSettings,
    trial: TrialSettings,
    settings: LiftingSettings,
    how: BodyModelSettings,
) -> ModelledLift:
    """Fit the body model to the file of a lift that the rules have analysed.

    Events, axes and pivot are those of the rules; markers are taken from the file as measured, neither screened nor
    filled nor filtered.
    The lift has a start of deposit and a release.
    """
    bare = replace(settings.markers, aliases={}, required=None, check_axes=False)
    recording = measured_markers(read_markers(markers, bare), settings.markers.aliases)
    if trial.window_s is not None:
        inside = (recording.time >= trial.window_s[0]) & (recording.time <= trial.window_s[1])
        positions = {name: points[inside] for name, points in recording.positions.items()}
        recording = replace(recording, time=recording.time[inside], positions=positions)
    time, nodes = at_nodes(recording, how.rate_Hz)
    found = fit(build(time, nodes, subject.height_m, subject.sex, held_frames(time, lift.events)))
    conditions = Conditions(
        lift.table, subject.mass_kg, trial.box_mass_kg, lift.heading, lift.events, settings
    )
    return ModelledLift(found, model_pendulums(found, conditions, found.draws(how.draws, SEED)))
