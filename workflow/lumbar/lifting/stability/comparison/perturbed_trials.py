"""Do perturbed movements stay inside the funnel of the unperturbed mean? A test of basins on repeated trials.

The funnel belongs to a *modelled* regulator about the mean of the unperturbed trials; a person need not behave
like it. Each trial is compared with it state by state, at equal phase: V(x − x0)/ρ, inside where at most 1. Every
unperturbed trial is compared with the mean of the *other* unperturbed ones, so that the comparison group is not
favoured. A trial that was inside and left without being pushed contradicts the funnel as a statement about this
person; one that was pushed on the way does not, as no funnel covers disturbances that come later.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from lumbar.base.errors import InputError, NumericalError
from lumbar.base.yaml_file import shipped_yaml
from lumbar.lifting.movement.cleaning import clean
from lumbar.lifting.movement.gaps import refuse_open_gaps
from lumbar.lifting.movement.pendulum_states import pendulum_states
from lumbar.lifting.stability.funnel.exact_funnel import Funnels, exact_funnels
from lumbar.lifting.stability.model.eq_4_1_pendulum import SIGNS
from lumbar.lifting.stability.model.eq_4_2_regulator import close_loops
from lumbar.lifting.stability.model.trajectories import Trajectory, find_problems
from lumbar.records.markers import MarkerRecording
from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.pushes import PerturbationsSettings
from lumbar.settings.stability import StabilitySettings
from lumbar.tables.described import columns_of, described
from lumbar.tables.table import Table

_SAID: dict[str, str] = shipped_yaml(Path(__file__).with_suffix(".yaml"))
PHASE_POINTS = 401
GROUPS = ("unperturbed", "perturbed")
FEWEST_UNPERTURBED = 3
FILL_OR_RAISE = "raise lifting.gaps.maximum_s, fill the gaps in the capture software, or leave the trial out"
"""What helps a trial with a gap: all of it is compared."""
CONTROL_WEIGHT_FACTORS = (0.01, 0.1, 1.0, 10.0, 100.0)


@dataclass(frozen=True)
class Trial:
    """Pendulum states of one recording at `PHASE_POINTS` even phases."""

    name: str
    group: str
    duration: float
    """Seconds."""
    angle: np.ndarray
    angular_velocity: np.ndarray
    """`angle`, `angular_velocity`: shape (points,): rad and rad/s (real time)."""
    length: float
    """Mean length of the pendulum in m."""


def trial_of(
    recording: MarkerRecording, group: str, settings: PerturbationsSettings, lifting: LiftingSettings
) -> Trial:
    """Return the pendulum of one recording: from the mean of some markers towards the mean of others.

    `lifting` says how gaps are filled and markers filtered.

    Raises
    ------
    InputError
        One of these markers is missing or has a gap that cannot be filled.
    """
    smooth, _, gaps = clean(recording, lifting)
    used = {*settings.pivot, *settings.top}
    refuse_open_gaps(recording, gaps, lifting.gaps.maximum_s, used, remedy=FILL_OR_RAISE)
    pivot, top = (np.mean([smooth[name] for name in end], axis=0) for end in (settings.pivot, settings.top))
    relative = settings.centre_share * (top - pivot)
    start, stop = float(smooth.time[0]), float(smooth.time[-1])
    states = pendulum_states(smooth.time, relative, start, stop, PHASE_POINTS, recording.name)
    chosen = states[settings.plane]
    return Trial(
        recording.name,
        group,
        stop - start,
        chosen.angle,
        chosen.angular_velocity,
        float(chosen.length.mean()),
    )


def mean_trajectory(trials: list[Trial], settings: PerturbationsSettings) -> Trajectory:
    """Return the mean movement of some trials: angles averaged at equal phase, mean duration.

    Its velocity is the derivative of the mean angle, so that it is a motion of the pendulum.
    """
    from scipy.interpolate import CubicSpline

    if len(trials) < FEWEST_UNPERTURBED - 1:
        raise InputError(f"{len(trials)} unperturbed trials; at least {FEWEST_UNPERTURBED} are needed")
    duration = float(np.mean([trial.duration for trial in trials]))
    time = np.linspace(0.0, duration, PHASE_POINTS)
    spline = CubicSpline(time, np.mean([trial.angle for trial in trials], axis=0))
    mean = Trajectory(
        subject=settings.subject,
        experience="unknown",
        box_mass_kg=0.0,
        com="trunk",
        plane=settings.plane,
        pivot="+".join(settings.pivot),
        time=time,
        angle=spline(time),
        angular_velocity=spline(time, 1),
        angular_acceleration=spline(time, 2),
        mass_kg=settings.mass_share * settings.body_mass_kg,
        length_m=float(np.mean([trial.length for trial in trials])),
    )
    find_problems(mean).raise_if_any()
    return mean


def funnels_of(means: list[Trajectory], sign: str, stability: StabilitySettings) -> list[Funnels]:
    """Return the exact funnels of mean movements, computed together."""
    loops = close_loops(means, sign, replace(stability, knots=PHASE_POINTS))
    found = exact_funnels(loops, stability.goal_level)
    return [found.select(np.array([index])) for index in range(len(means))]


def relative_value(trial: Trial, mean: Trajectory, funnel: Funnels) -> np.ndarray:
    """Return V/ρ of a trial's states at equal phase, shape (points,)."""
    error = trial.angle - mean.angle
    velocity = trial.angular_velocity - mean.angular_velocity
    s11, s12, s22 = funnel.cost[:, 0].T
    return (s11 * error**2 + 2 * s12 * error * velocity + s22 * velocity**2) / funnel.level[:, 0]


def references(trials: list[Trial], settings: PerturbationsSettings) -> list[Trajectory]:
    """Return for every trial the mean of the unperturbed ones but itself.

    Raises
    ------
    InputError
        Too few unperturbed trials, or a mean movement that is no sound trajectory.
    """
    unperturbed = [trial for trial in trials if trial.group == "unperturbed"]
    if len(unperturbed) < FEWEST_UNPERTURBED:
        raise InputError(f"{len(unperturbed)} unperturbed trials; at least {FEWEST_UNPERTURBED} are needed")
    return [
        mean_trajectory([item for item in unperturbed if item is not trial], settings) for trial in trials
    ]


def values_of(
    trials: list[Trial], means: list[Trajectory], sign: str, stability: StabilitySettings
) -> list[np.ndarray]:
    """Return V/ρ of every trial in the funnel about its mean, with one sign of gravity; shape (points,) each."""
    # The perturbed trials share one mean, and its funnel.
    own = {mean.angle.tobytes(): mean for mean in means}
    funnels = dict(zip(own, funnels_of(list(own.values()), sign, stability), strict=True))
    return [
        relative_value(trial, mean, funnels[mean.angle.tobytes()])
        for trial, mean in zip(trials, means, strict=True)
    ]


def compare_trials(
    trials: list[Trial], settings: PerturbationsSettings, stability: StabilitySettings
) -> pd.DataFrame:
    """Compare every trial with the funnel of the unperturbed mean, with both signs of gravity.

    The table has one row per sign (the study's first) and trial, columns of the table.
    """
    means = references(trials, settings)
    rows = []
    for sign in signs_of(stability):
        values = values_of(trials, means, sign, stability)
        rows += [_row(sign, *one) for one in zip(trials, means, values, strict=True)]
    return pd.DataFrame(rows, columns=columns_of(__file__, "perturbed_trials"))


def signs_of(stability: StabilitySettings) -> list[str]:
    """Both signs of gravity, the study's first."""
    return sorted(SIGNS, key=lambda name: name != stability.pendulum.sign)


def _row(sign: str, trial: Trial, mean: Trajectory, value: np.ndarray) -> dict:
    inside = value <= 1
    return {
        "sign": sign,
        "trial": trial.name,
        "group": trial.group,
        "duration_s": trial.duration,
        "start_value": float(value[0]),
        "largest_value": float(value.max()),
        "end_value": float(value[-1]),
        "share_inside": float(inside.mean()),
        "departures": int((inside[:-1] & ~inside[1:]).sum()),
        "largest_error_rad": float(np.abs(trial.angle - mean.angle).max()),
        "whole_inside": "yes" if inside.all() else "no",
    }


def inside_by_weight(
    trials: list[Trial], settings: PerturbationsSettings, stability: StabilitySettings
) -> pd.DataFrame:
    """Count the trials that lie inside throughout, by sign and control weight: the regulator is an assumption.

    The table has columns ``sign, control_weight, group, inside``; `inside` is NaN where there is no basin.
    """
    means, rows = references(trials, settings), []
    for sign in signs_of(stability):
        for factor in CONTROL_WEIGHT_FACTORS:
            weight = factor * stability.regulator.control_weight
            changed = replace(stability, regulator=replace(stability.regulator, control_weight=weight))
            try:
                values = values_of(trials, means, sign, changed)
            except NumericalError:
                values = [np.full(1, np.nan)] * len(trials)
            for group in GROUPS:
                own = [value for trial, value in zip(trials, values, strict=True) if trial.group == group]
                known = all(np.isfinite(value).all() for value in own)
                inside = sum(bool((value <= 1).all()) for value in own) if known else np.nan
                rows.append({"sign": sign, "control_weight": weight, "group": group, "inside": inside})
    return pd.DataFrame(rows)


def trials_table(
    frame: pd.DataFrame,
    by_weight: pd.DataFrame,
    feedback: str,
    settings: PerturbationsSettings,
    stability: StabilitySettings,
    data: str,
) -> Table:
    """Return the comparison as a published table, with what is seen, how it hangs on the control weight, and on the feedback."""
    weight = stability.regulator.control_weight
    notes = [
        f"{sign.capitalize()}, R = {weight:g}. {_finding(frame[frame['sign'] == sign], group)}"
        for sign in signs_of(stability)
        for group in GROUPS
    ]
    notes += [_by_weight(by_weight, sign) for sign in signs_of(stability)]
    ends = {name: " + ".join(getattr(settings, name)) for name in ("pivot", "top")}
    notes += [feedback, _SAID["pendulum"].format(settings=settings, **ends)]
    return described(__file__, "perturbed_trials", frame, data, notes=tuple(notes))


def _by_weight(frame: pd.DataFrame, sign: str) -> str:
    """Say how many trials lie inside with other control weights."""
    rows = frame[frame["sign"] == sign]
    words = []
    for weight, own in rows.groupby("control_weight"):
        inside = own.set_index("group")["inside"]
        counts = " and ".join(f"{inside[group]:.0f} {group}" for group in GROUPS)
        words.append(f"R = {weight:g}: " + ("no basin" if inside.isna().any() else counts))
    return f"{sign.capitalize()}, trials that lie inside throughout: {'; '.join(words)}"


def _finding(frame: pd.DataFrame, group: str) -> str:
    rows = frame[frame["group"] == group]
    counts = {
        "whole": int((rows["whole_inside"] == "yes").sum()),
        "start": int((rows["start_value"] <= 1).sum()),
        "left": int((rows["departures"] > 0).sum()),
    }
    share = 100 * rows["share_inside"].mean()
    return _SAID["finding"].format(group=group.capitalize(), trials=len(rows), share=share, **counts)
