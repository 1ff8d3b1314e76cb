"""Centres of mass, pendulum states and basin areas of the fitted body model, each with its spread.

The same functions as for the rules (`lumbar.lifting.movement`) turn its joints into centres of mass and pendulum states, once
with the most probable unknowns and once with each draw from their posterior: the spread of the results is their uncertainty,
with all that the unknowns share. What spreads: joints, landmarks and noise as far as the trial and the priors leave them
open, and of areas the instants of start and release. What does not: the segment table's shares (their spread is listed by
`lumbar.lifting.movement.model_spread`).
"""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from lumbar.lifting.body_model.build import at_nodes, build, measured_markers
from lumbar.lifting.body_model.fit import BodyFit, fit, model_points, model_recording
from lumbar.lifting.body_model.structure import Unknowns
from lumbar.lifting.movement.centre_of_mass import SegmentTable, centres_of_mass
from lumbar.lifting.movement.events import DETECTED, Event, held_frames
from lumbar.lifting.movement.lift import AnalysedLift
from lumbar.lifting.movement.pendulum_states import PendulumStates, pendulum_states, pivot_trajectory, turn
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.model.eq_4_2_regulator import close_loops
from lumbar.lifting.stability.model.failures import attempts
from lumbar.lifting.stability.model.trajectories import Trajectory, find_problems, in_unit_time
from lumbar.records.markers import read_markers
from lumbar.settings.lifting import BodyModelSettings, LiftingSettings
from lumbar.settings.stability import StabilitySettings
from lumbar.settings.subject import SubjectSettings, TrialSettings

Planar = dict[tuple[str, str], PendulumStates]
Window = tuple[float, float, int]
"""Start and stop in seconds, and number of instants."""
SEED = 0
DEPOSIT = "deposit_start", "release"
DRAWN_POINTS = 200
"""Instants, and knots, of a drawn pendulum: enough for 1e-3 of its area."""


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
    event_sd: float = 0.0
    """Error of the instants of start and release, seconds (root mean square)."""


@dataclass(frozen=True)
class ModelPendulums:
    """Pendulums of the deposit, by centre of mass and plane."""

    states: Planar
    """Of the most probable unknowns."""
    sd: Planar
    """Standard deviation of every state (of its time: 0), as the spread of the draws about the most probable."""
    draws: list[Planar]
    """Of unknowns drawn from the posterior, between events drawn too."""
    constants: np.ndarray
    """Shape (draws, constants): what in each of them stays throughout the trial, joints, landmarks and markers."""
    masses: dict[str, tuple[float, float]]
    """Of each centre of mass without and with its share of the box, kilograms."""


def model_pendulums(fit: BodyFit, conditions: Conditions, draws: Iterable[Unknowns]) -> ModelPendulums:
    """Pendulum states of a fitted body, and of draws from its posterior; the conditions have a start of deposit and a release.

    Raises
    ------
    InputError
        The model lacks the pivot's points, or the deposit is too short.
    """
    start, stop = (conditions.events[name].time_s for name in DEPOSIT)
    window = start, stop, conditions.settings.points
    (best,), masses = _states(fit, fit.best, conditions, [window])
    squares, rng, drawn, constants = dict.fromkeys(best, 0.0), np.random.default_rng(SEED), [], []
    for draw in draws:
        windows = [window, _drawn(window, conditions, fit.model.time, rng)]
        (own, timed), _ = _states(fit, draw, conditions, windows)
        for key, states in own.items():
            squares[key] += (np.array([*vars(states).values()]) - [*vars(best[key]).values()]) ** 2
        drawn.append(timed)
        constants.append(draw.constants)
    sd = {key: PendulumStates(*np.sqrt(total / len(drawn))) for key, total in squares.items() if drawn}
    return ModelPendulums(best, sd, drawn, np.array(constants), masses)


def _drawn(window: Window, conditions: Conditions, time: np.ndarray, rng: np.random.Generator) -> Window:
    """Return the window with both ends drawn, no further than a quarter of it; with few instants, for an area.

    Ends that detection found move apart alone: it sees a movement after it has begun, and sees it no more before it has ended.
    """
    start, stop, points = window
    off = np.clip(conditions.event_sd * rng.standard_normal(2), -(stop - start) / 4, (stop - start) / 4)
    found = [conditions.events[name] for name in DEPOSIT]
    at_rest = [event.method == DETECTED and event.descent_s in (None, event.time_s) for event in found]
    off = np.where(at_rest, np.abs(off) * (-1, 1), off)
    return max(time[0], start + off[0]), min(time[-1], stop + off[1]), min(points, DRAWN_POINTS)


def _states(
    fit: BodyFit, unknowns: Unknowns, conditions: Conditions, windows: list[Window]
) -> tuple[list[Planar], dict[str, tuple[float, float]]]:
    recording, points = model_recording(fit, unknowns), model_points(fit, unknowns)
    events, settings = dict(conditions.events), conditions.settings
    masses = conditions.body_mass, conditions.box_mass
    centres = centres_of_mass(recording, points, conditions.table, *masses, settings.box.share, events)
    pivot = pivot_trajectory(replace(recording, source="body model"), points, settings.pivot)
    found: list[Planar] = [{} for _ in windows]
    for com, centre in centres.items():
        position = centre.position_with_box if settings.box.in_position else centre.position
        relative = turn(position - pivot, conditions.heading)
        for states, window in zip(found, windows, strict=True):
            planar = pendulum_states(recording.time, relative, *window, f"body model, {com}")
            states |= {(com, plane): values for plane, values in planar.items()}
    return found, {com: (centre.mass_kg, centre.mass_with_box_kg) for com, centre in centres.items()}


COLUMNS = (
    *("com", "plane", "sign", "mean_area", "mean_area_low", "mean_area_high", "mean_area_sd"),
    *("draws", "draws_without_basin", "no_basin_share", "lasting_share"),
)
COVERAGE = 0.95
"""Share of the draws that an interval holds."""
TOGETHER = 200
"""Basins computed at once."""


def basin_intervals(
    pendulums: ModelPendulums, settings: StabilitySettings, sign: str, pivot: str
) -> pd.DataFrame:
    """Mean basin area of each pendulum with the interval that the body model leaves it: columns `COLUMNS`.

    A draw's pendulum may have no basin (too short, or one that reaches beyond any body): ``no_basin_share`` is how probable that
    is. The interval is one of the area where there is a basin; area and interval are NaN where the most probable pendulum has
    none. ``lasting_share`` of its variance comes from what stays throughout the trial, and so in all lifts of a person. `sign` is
    that of gravity, hanging or inverted.
    """
    masses, how = pendulums.masses, settings.pendulum

    def trajectory(name: str, states: Planar, key: tuple[str, str]) -> Trajectory:
        values, mass = states[key], masses[key[0]][how.mass == "with_box"]
        motion = values.time, values.angle, values.angular_velocity, values.angular_acceleration
        found = Trajectory(name, "", 0.0, *key, pivot, *motion, mass, float(values.length.mean()))
        return in_unit_time(found) if how.time == "unit" else found

    best = {key: trajectory("body model", pendulums.states, key) for key in pendulums.states}
    drawn = {
        key: [trajectory(f"draw {i}", draw, key) for i, draw in enumerate(pendulums.draws)] for key in best
    }
    areas = _areas([*best.values()], settings, sign)
    coarse = replace(settings, knots=min(settings.knots, DRAWN_POINTS))
    areas |= _areas([one for many in drawn.values() for one in many], coarse, sign)
    rows = []
    for key, own in best.items():
        sound = [id(one) in areas for one in drawn[key]]
        found = [areas[id(one)] for one in drawn[key] if id(one) in areas]
        low, high, sd, lasting = (np.nan,) * 4
        if id(own) in areas and len(found) > 1:
            # The truth is as one draw more: between ranks of count + 1.
            low, high = np.percentile(found, [50 * (1 - COVERAGE), 50 * (1 + COVERAGE)], method="weibull")
            sd = np.std(found, ddof=1)
            lasting = explained_share(np.log(found), pendulums.constants[sound])
        interval, lost = (areas.get(id(own), np.nan), low, high, sd), len(sound) - len(found)
        rows.append((*key, sign, *interval, len(found), lost, lost / max(1, len(sound)), lasting))
    return pd.DataFrame(rows, columns=list(COLUMNS))


def explained_share(values: np.ndarray, causes: np.ndarray) -> float:
    """Share of the variance of values that a line in causes, shape (values, causes), explains: adjusted R²; NaN of too few."""
    line = np.column_stack([np.ones(len(causes)), causes])
    found, _, rank, _ = np.linalg.lstsq(line, values, rcond=None)
    left = np.sum((values - line @ found) ** 2) / max(1, len(values) - rank)
    return float(max(0.0, 1 - left / np.var(values, ddof=1))) if len(values) > 2 * rank else np.nan


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
            sd = self.pendulums.sd[com, plane]
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
        recording = recording.at(inside)
    time, nodes = at_nodes(recording, how.rate_Hz)
    found = fit(build(time, nodes, subject.height_m, subject.sex, held_frames(time, lift.events)))
    conditions = Conditions(
        lift.table, subject.mass_kg, trial.box_mass_kg, lift.heading, lift.events, settings, how.event_sd_s
    )
    return ModelledLift(found, model_pendulums(found, conditions, found.draws(how.draws, SEED)))
