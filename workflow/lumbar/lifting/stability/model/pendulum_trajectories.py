"""Reference trajectories from the pendulum states of one lift, under the choices that Eq. 4.1 and its text leave open.

A `Convention` is one set of these choices; `THESIS` has the choices of the thesis. Trajectories are checked before use. A basin
that cannot be computed is reported as a `Failure`, a row of ``stability/failures.csv``; the other basins are computed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from lumbar.base.errors import NumericalError, Problems
from lumbar.lifting.movement.pendulum_states import CHOICES, THESIS_CHOICE
from lumbar.tables.table import Table, columns_of, table_from_schema

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.lifting import StabilitySettings


COMS = ("thorax", "abdomen", "pelvis")
PLANES = ("lateral_bending", "flexion_extension")
SIGNS = {"hanging": 1.0, "inverted": -1.0}
"""Sign σ of the gravity term of Eq. 4.1."""
MIN_SAMPLES = 20
MIN_LENGTH_M = 0.1
MAX_VELOCITY_DEVIATION = 0.1
"""Largest deviation of the integral of the angular velocity from the angle, as a share of the angle's range."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """States of the pendulum of one COM in one plane during a deposit; compared by identity."""

    subject: str
    experience: str
    box_mass_kg: float
    com: str
    """Name of the centre of mass, one of `COMS`."""
    plane: str
    """Name of the plane, one of `PLANES`."""
    pivot: str
    """Point about which the pendulum rotates."""
    time: np.ndarray
    """Shape (samples,): increasing time, seconds."""
    angle: np.ndarray
    """Shape (samples,): θ0 in rad."""
    angular_velocity: np.ndarray
    """Shape (samples,): θ̇0 in rad/s."""
    angular_acceleration: np.ndarray
    """Shape (samples,): θ̈0 in rad/s²."""
    mass_kg: float
    length_m: float
    mass_counted: str = "with_box"
    """``with_box`` if `mass_kg` includes the box, or ``without_box``."""
    clock: str = "real"
    """Time scale: ``real``, or ``unit`` if the movement is scaled to one second."""
    segment_ends: str = "inner"
    """``inner`` if the trunk's segments end inside the body, ``skin`` if at the markers."""
    deposit_start: str = "descent"
    """``descent`` of the box, or ``wrist_minimum``."""

    @property
    def label(self) -> str:
        """Subject, box, COM and plane, for messages."""
        return f"{self.subject} {self.box_mass_kg:g} kg, {self.com}, {self.plane}"

    @property
    def duration(self) -> float:
        """Time from the first to the last sample in s."""
        return float(self.time[-1] - self.time[0])

    @property
    def ranges(self) -> np.ndarray:
        """Ranges of θ0 and θ̇0 in rad and rad/s, shape (2,)."""
        return np.array([np.ptp(self.angle), np.ptp(self.angular_velocity)])


def pendulum_label(trajectory: Trajectory, sign: str) -> str:
    """Return the name of a trajectory's pendulum in messages and in `lumbar.base.errors.NumericalError.label`.

    Parameters
    ----------
    trajectory : Trajectory
        Reference states of the pendulum.
    sign : {"hanging", "inverted"}
        Sign of gravity.
    """
    return f"{trajectory.label} ({sign})"


def scale_to_unit_time(trajectory: Trajectory) -> Trajectory:
    """Return the path scaled to a duration of one second, as in the thesis ("to non-dimensionalize time", section 4.2.3.1).

    Mass, length, damping, gravity and the regulator's weights are unchanged. The result is therefore another movement; a change
    of units would only multiply every area by the duration.

    Parameters
    ----------
    trajectory : Trajectory
        Trajectory in real time.
    """
    duration = trajectory.duration
    return replace(
        trajectory,
        time=(trajectory.time - trajectory.time[0]) / duration,
        angular_velocity=trajectory.angular_velocity * duration,
        angular_acceleration=trajectory.angular_acceleration * duration**2,
        clock="unit",
    )


def find_problems(trajectory: Trajectory) -> Problems:
    """Return the problems that keep a trajectory from having a basin of attraction.

    Parameters
    ----------
    trajectory : Trajectory
        Trajectory to check.
    """
    problems = Problems(trajectory.label)
    if len(trajectory.time) < MIN_SAMPLES:
        problems.add("", f"{len(trajectory.time)} samples", f"at least {MIN_SAMPLES} are needed")
        return problems
    for name in ("time", "angle", "angular_velocity", "angular_acceleration"):
        values = getattr(trajectory, name)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            problems.add(f"sample {bad[0] + 1}", f"{name} is {values[bad[0]]}", "every value must be finite")
    if not 0 < trajectory.mass_kg < np.inf:
        problems.add("mass_kg", f"{trajectory.mass_kg:g}", "a positive mass is needed")
    if not MIN_LENGTH_M <= trajectory.length_m < np.inf:
        allowed = f"a pendulum shorter than {MIN_LENGTH_M} m describes no trunk segment: choose another pivot"
        problems.add("length_m", f"{trajectory.length_m:g}", allowed)
    if not problems.entries:
        _add_motion_problems(trajectory, problems)
    return problems


def _add_motion_problems(trajectory: Trajectory, problems: Problems) -> None:
    """Add problems of time, angle and velocity to a list: the three must be consistent."""
    from scipy.integrate import cumulative_trapezoid

    time, angle = trajectory.time, trajectory.angle
    backward, turned = np.flatnonzero(np.diff(time) <= 0), np.flatnonzero(np.abs(angle) >= np.pi)
    if backward.size:
        row = backward[0] + 1
        problems.add(
            f"sample {row + 1}", f"time {time[row]:g} s after {time[row - 1]:g} s", "time must increase"
        )
    elif turned.size:
        row, allowed = turned[0], "a COM over or under its pivot lies within ±π"
        problems.add(f"sample {row + 1}", f"angle {angle[row]:.3g} rad", allowed)
    if problems.entries:
        return
    error = angle - angle[0] - cumulative_trapezoid(trajectory.angular_velocity, time, initial=0.0)
    # A hundredth of a radian is below what markers resolve: a COM that hardly moves must not fail.
    deviation = float(np.ptp(error) / max(np.ptp(angle), 0.1))
    if deviation > MAX_VELOCITY_DEVIATION:
        problems.add(
            "angular_velocity",
            f"its integral strays from the angle by {100 * deviation:.0f} % of the angle's range",
            f"at most {100 * MAX_VELOCITY_DEVIATION:.0f} %: it must be the derivative of the angle",
        )


INVALID_TRAJECTORY = "trajectory"
"""Name of the missing basin in a `Failure` if the trajectory is invalid: all its basins are missing."""


@dataclass(frozen=True)
class Failure:
    """One basin that could not be computed; the attributes are the columns of ``failures.csv``."""

    subject: str
    experience: str
    box_mass_kg: float
    com: str
    plane: str
    basin: str
    reason: str

    @classmethod
    def from_trajectory(cls, item: Trajectory, basin: str, reason: str) -> Failure:
        """Return the failure for a basin of one trajectory.

        Parameters
        ----------
        item : Trajectory
            Trajectory without this basin.
        basin : str
            Name of the basin: method and sign, or table.
        reason : str
            Reason of the failure, one sentence; the label of the pendulum at its beginning is removed.
        """
        for sign in SIGNS:
            reason = reason.removeprefix(f"{pendulum_label(item, sign)}: ")
        return cls(item.subject, item.experience, item.box_mass_kg, item.com, item.plane, basin, reason)


@dataclass(frozen=True)
class Convention:
    """Choices that define the pendulum of a recorded deposit."""

    sign: str
    """Sign of gravity: a key of `SIGNS`."""
    time: str
    """Time scale: ``real`` for the recorded duration, ``unit`` for one second."""
    mass: str
    """Mass of the pendulum: ``with_box`` or ``without_box``."""
    pivot: str
    """Point about which the pendulum rotates: one of `lumbar.lifting.movement.pendulum_states.PIVOTS`."""
    segment_ends: str
    """``inner`` if the trunk's segments end inside the body, ``skin`` if at the markers."""
    deposit_start: str
    """``descent`` of the box, or ``wrist_minimum``."""

    def __str__(self) -> str:
        ends, start = f"{self.segment_ends} ends", f"from {self.deposit_start}"
        parts = (f"{self.time} time", self.mass, self.pivot, ends, start)
        return ", ".join([self.sign, *(part.replace("_", " ") for part in parts)])


THESIS = Convention("hanging", "unit", "without_box", **vars(THESIS_CHOICE))
"""The thesis's convention: + in Eq. 4.1, trajectories interpolated "to non-dimensionalize time", "subject mass", and
`THESIS_CHOICE`."""


@dataclass(frozen=True)
class LiftStates:
    """Pendulum states of one lift by the choices of the study and of the thesis."""

    states: pd.DataFrame
    """Rows of ``pendulum.csv``, states by the study's choice."""
    facts: Mapping
    """Content of ``pendulum.json``; if the thesis's choice differs, ``thesis_pendulum`` has its ``length_m`` and ``missing``."""
    in_thesis: pd.DataFrame | None = None
    """Rows of ``thesis_pendulum.csv``, columns of `states`; None if there is no such file."""

    def trajectories(self, convention: Convention) -> tuple[list[Trajectory], list[Failure]]:
        """Return the valid trajectories under a convention, and a failure for every invalid one.

        Parameters
        ----------
        convention : Convention
            Choices; all trajectories fail if pivot, segment ends and start of the deposit are not those of study or thesis.
        """
        choice = {name: getattr(convention, name) for name in CHOICES}
        thesis, options = self.facts.get("thesis_pendulum"), (convention.mass, convention.time)
        if choice == pendulum_choice(self.facts):
            return trajectories_of_lift(self.states, self.facts, *options)
        if self.in_thesis is None or not thesis or choice != pendulum_choice(thesis):
            named = ", ".join(choice.values())
            reason = f"no pendulum states of {named}: 'lumbar lift' writes thesis_pendulum.csv"
            facts = {**self.facts, "missing": dict.fromkeys(COMS, reason)}
            return trajectories_of_lift(self.states, facts, *options)
        return trajectories_of_lift(self.in_thesis, {**self.facts, **thesis}, *options)


def trajectories_of_lift(
    states: pd.DataFrame, facts: Mapping, mass: str, time: str = "real"
) -> tuple[list[Trajectory], list[Failure]]:
    """Return the valid trajectories of a lift's six, ordered by `COMS`, then `PLANES`, and the failures of the others.

    Parameters
    ----------
    states : pandas.DataFrame
        Columns ``com, plane, time_s, angle_rad, angular_velocity_rad_s, angular_acceleration_rad_s2``.
    facts : mapping
        ``subject, box_mass_kg, pivot, segment_ends, deposit_start``, ``mass_kg`` (per COM ``with_box`` and
        ``without_box``) and ``length_m`` (per COM and plane); ``experience`` if known, and ``missing``, the reasons of COMs
        without a pendulum.
    mass : {"with_box", "without_box"}
        Mass of the pendulum, with or without the box.
    time : {"real", "unit"}, default "real"
        Recorded duration, or one second.
    """
    trajectories, failures, missing = [], [], facts.get("missing", {})
    parts = dict(iter(states.groupby(["com", "plane"])))
    lifted = {"subject": facts["subject"], "experience": facts.get("experience", "")}
    lifted["box_mass_kg"] = float(facts["box_mass_kg"])
    motion = ("time_s", "angle_rad", "angular_velocity_rad_s", "angular_acceleration_rad_s2")
    for com in COMS:
        for plane in PLANES:
            if com in missing:
                failures.append(
                    Failure(**lifted, com=com, plane=plane, basin=INVALID_TRAJECTORY, reason=missing[com])
                )
                continue
            rows = parts.get((com, plane), states[:0])
            time_s, angle, velocity, acceleration = (rows[name].to_numpy(float) for name in motion)
            trajectory = Trajectory(
                **lifted,
                com=com,
                plane=plane,
                **pendulum_choice(facts),
                time=time_s,
                angle=angle,
                angular_velocity=velocity,
                angular_acceleration=acceleration,
                mass_kg=float(facts["mass_kg"][com][mass]),
                length_m=float(facts["length_m"][com][plane]),
                mass_counted=mass,
            )
            problems = find_problems(trajectory).entries
            if problems:
                failures.append(Failure.from_trajectory(trajectory, INVALID_TRAJECTORY, ". ".join(problems)))
            else:
                trajectories.append(scale_to_unit_time(trajectory) if time == "unit" else trajectory)
    return trajectories, failures


def pendulum_choice(facts: Mapping) -> dict[str, str]:
    """Return the attributes of `PendulumChoice` from the facts of pendulum states.

    Parameters
    ----------
    facts : mapping
        Content of ``pendulum.json``.
    """
    return {name: facts[name] for name in CHOICES}


def headline(settings: StabilitySettings, facts: Mapping) -> Convention:
    """Return the convention of the headline: the study's choices, from its settings and a lift's facts.

    Parameters
    ----------
    settings : StabilitySettings
        Settings of the study.
    facts : mapping
        Content of ``pendulum.json`` of any lift of the study.
    """
    pendulum = settings.pendulum
    return Convention(pendulum.sign, pendulum.time, pendulum.mass, **pendulum_choice(facts))


Result = TypeVar("Result")


def compute_together(
    compute: Callable[[list[Trajectory]], Result],
    trajectories: list[Trajectory],
    basin: str,
    failures: list[Failure],
) -> list[tuple[list[Trajectory], Result]]:
    """Compute all trajectories together, because the integration takes equally many steps for one basin and for a hundred.

    If an error has the label of a trajectory, this trajectory is computed separately and the others together again; otherwise
    each is computed separately. The result lists the trajectories that were computed together, with their result.

    Parameters
    ----------
    compute : callable
        Returns the result of some trajectories.
    trajectories : list of Trajectory
        All trajectories.
    basin : str
        Name for `Failure.basin`.
    failures : list of Failure
        List to which trajectories that fail separately are added.

    Examples
    --------
    >>> compute_together(len, ["thorax", "pelvis"], "exact", [])
    [(['thorax', 'pelvis'], 2)]
    """
    results = []
    remaining = list(trajectories)
    while remaining:
        try:
            return [*results, (remaining, compute(remaining))]
        except NumericalError as error:
            label = error.label
            if len(remaining) == 1:
                failures.append(Failure.from_trajectory(remaining[0], basin, str(error)))
                return results
        labelled = [item for item in remaining if label in (pendulum_label(item, sign) for sign in SIGNS)]
        separate = labelled or remaining
        remaining = [item for item in remaining if item not in separate]
        for item in separate:
            try:
                results.append(([item], compute([item])))
            except NumericalError as error:
                failures.append(Failure.from_trajectory(item, basin, str(error)))
    return results


def failures_frame(failures: list[Failure]) -> pd.DataFrame:
    """Return failures as rows of ``failures.csv``.

    Parameters
    ----------
    failures : list of Failure
        Basins that could not be computed.
    """
    import pandas as pd

    return pd.DataFrame(
        [asdict(item) for item in failures], columns=columns_of("lifting/stability", "missing_basins")
    )


def join_rows(frames: list[pd.DataFrame]) -> pd.DataFrame:
    """Join one table of several lifts; tables without rows do not affect the types.

    Parameters
    ----------
    frames : list of pandas.DataFrame
        At least one table, all with the same columns.
    """
    import pandas as pd

    filled = [frame for frame in frames if len(frame)]
    return pd.concat(filled, ignore_index=True) if filled else frames[0]


def announcement(failures: pd.DataFrame, computed: int, path: str | os.PathLike) -> str:
    """Return one sentence on all missing basins: their number, their common segment, their most frequent reason.

    Parameters
    ----------
    failures : pandas.DataFrame
        Rows of ``failures.csv``, at least one.
    computed : int
        Number of basins that were computed.
    path : str or os.PathLike
        Path of the ``failures.csv``, named if there are other reasons.
    """
    coms = list(dict.fromkeys(failures["com"]))
    # Reasons that differ only in numbers and segments are one kind.
    kinds = failures["reason"].str.replace(rf"[\d.]+|{'|'.join(COMS)}", "", regex=True)
    reason = failures["reason"][kinds == kinds.mode()[0]].iloc[0]
    others = kinds.nunique() - 1
    return (
        f"{len(failures)} of {len(failures) + computed} basins not computed"
        + (f", all of the {coms[0]}: {reason}" if len(coms) == 1 else f": {reason}")
        + (f" ({others} other reason{'s' * (others > 1)}: {path})" if others else "")
    )


def failures_table(failures: pd.DataFrame, source_label: str) -> Table:
    """Return the missing basins as a published table; if none is missing, a row states this.

    Parameters
    ----------
    failures : pandas.DataFrame
        Rows of ``failures.csv`` of all lifts.
    source_label : str
        Source of the recordings, for the table's caption.
    """
    none = failures.empty
    if none:
        failures = failures_frame([]).astype(object)
        failures.loc[0] = dict.fromkeys(failures) | {"basin": "none", "reason": "every basin was computed"}
    return table_from_schema(
        "lifting/stability",
        "missing_basins",
        failures,
        source_label,
        notes=("Every basin was computed" if none else "These basins are in no other table",),
        may_be_empty=frozenset(failures) - {"basin", "reason"} if none else frozenset(),
    )
