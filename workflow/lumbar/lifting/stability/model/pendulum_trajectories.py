"""From the pendulum states of one lift to its reference trajectories, under the choices that Eq. 4.1 and its text leave open.

A `Convention` is one such set of choices, `THESIS` the thesis's. Trajectories are checked before they are used. A basin that
cannot be computed is a `Failure`, a row of ``stability/failures.csv``: it drops out with its reason, and the others stay.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
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
    """States of the pendulum of one COM, seen in one plane, while a box is deposited; equal only to itself."""

    subject: str
    experience: str
    box_mass_kg: float
    com: str
    """One of `COMS`."""
    plane: str
    """One of `PLANES`."""
    pivot: str
    """Point about which the pendulum turns."""
    time: np.ndarray
    """Shape (samples,): seconds, increasing."""
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
    """``real``, or ``unit`` if the recorded movement is played in one second."""
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
        """Seconds from the first to the last sample."""
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
    """Return the same path played in one second, as the thesis has it ("to non-dimensionalize time", section 4.2.3.1).

    Mass, length, damping, gravity and the regulator's weights stay: this is another movement, not a change of units, which would
    only multiply every area by the duration.

    Parameters
    ----------
    trajectory : Trajectory
        Path as long as it was recorded.
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
    """Add problems of time, angle and velocity, which must belong to one motion."""
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
"""Missing basin if the trajectory itself is invalid: all its basins."""


@dataclass(frozen=True)
class Failure:
    """One basin that could not be computed; attributes as the columns of ``failures.csv``."""

    subject: str
    experience: str
    box_mass_kg: float
    com: str
    plane: str
    basin: str
    reason: str

    @classmethod
    def from_trajectory(cls, item: Trajectory, basin: str, reason: str) -> Failure:
        """Return the failure of a basin of one trajectory.

        Parameters
        ----------
        item : Trajectory
            Trajectory without this basin.
        basin : str
            Name of the basin: method and sign, or table.
        reason : str
            Reason of the failure, one sentence.
        """
        return cls(item.subject, item.experience, item.box_mass_kg, item.com, item.plane, basin, reason)


@dataclass(frozen=True)
class Convention:
    """Choices that make a pendulum of a recorded deposit."""

    sign: str
    """Sign of gravity: a key of `SIGNS`."""
    time: str
    """``real`` if the movement lasts as long as it was recorded, ``unit`` if one second."""
    mass: str
    """``with_box`` if the box counts to the pendulum's mass, or ``without_box``."""
    pivot: str
    """Point about which the pendulum turns: one of `lumbar.lifting.movement.pendulum_states.PIVOTS`."""
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
    """Pendulum states of one lift by the study's choice and by the thesis's."""

    states: pd.DataFrame
    """``pendulum.csv``: by the study's choice."""
    facts: Mapping
    """``pendulum.json``; ``thesis_pendulum`` has ``length_m`` and ``missing`` of the thesis's choice, if that is another."""
    in_thesis: pd.DataFrame | None = None
    """``thesis_pendulum.csv``, columns of `states`; None without such a file."""

    def trajectories(self, convention: Convention) -> tuple[list[Trajectory], list[Failure]]:
        """Return the valid trajectories of one convention, and the failures of the others.

        Parameters
        ----------
        convention : Convention
            Choices; every trajectory fails unless pivot, segment ends and start of the deposit are the study's or the thesis's.
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
    """Return the valid ones of a lift's six trajectories, by `COMS`, then `PLANES`, and the failures of the others.

    Parameters
    ----------
    states : pandas.DataFrame
        Columns ``com, plane, time_s, angle_rad, angular_velocity_rad_s, angular_acceleration_rad_s2``.
    facts : mapping
        ``subject, box_mass_kg, pivot, segment_ends, deposit_start``, ``mass_kg`` (per COM ``with_box`` and
        ``without_box``) and ``length_m`` (per COM and plane); ``experience`` if known, and ``missing``, the reasons of COMs
        without a pendulum.
    mass : {"with_box", "without_box"}
        With or without the box in the pendulum's mass.
    time : {"real", "unit"}, default "real"
        As long as it was recorded, or one second.
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
    """Return the choices in the facts of pendulum states, attributes of `PendulumChoice`.

    Parameters
    ----------
    facts : mapping
        ``pendulum.json``.
    """
    return {name: facts[name] for name in CHOICES}


def headline(settings: StabilitySettings, facts: Mapping) -> Convention:
    """Return the convention of the headline: the study's own choices, including those in a lift's facts.

    Parameters
    ----------
    settings : StabilitySettings
        Settings of the study.
    facts : mapping
        ``pendulum.json`` of any lift of the study.
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
    """Compute all trajectories together: the integration takes the same number of steps for one basin as for a hundred.

    If the label of an error is that of a trajectory, it is computed separately and the others together again; otherwise each is
    computed separately. Returned are the trajectories that were computed together, with their result.

    Parameters
    ----------
    compute : callable
        Returns the result of some trajectories.
    trajectories : list of Trajectory
        All trajectories.
    basin : str
        Name for `Failure.basin`.
    failures : list of Failure
        Gets the trajectories that fail separately.

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
    """Return failures as the rows of ``failures.csv``.

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
    """Join the same table of several lifts; tables without rows do not affect the types.

    Parameters
    ----------
    frames : list of pandas.DataFrame
        At least one table, all with the same columns.
    """
    import pandas as pd

    filled = [frame for frame in frames if len(frame)]
    return pd.concat(filled, ignore_index=True) if filled else frames[0]


def announcement(path: str | os.PathLike) -> str:
    """Return a message that names every basin in a ``failures.csv``; empty without any.

    Parameters
    ----------
    path : str or os.PathLike
        The ``failures.csv``.
    """
    with Path(path).open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    if not rows:
        return ""
    count = f"{len(rows)} basin{'s' if len(rows) > 1 else ''} of attraction could not be computed ({path})"
    lines = [
        f"  - {row['subject']} {float(row['box_mass_kg']):g} kg, {row['com']}, {row['plane']}: {row['basin']}: {row['reason']}"
        for row in rows
    ]
    return "\n".join([f"WARNING: {count}; the tables leave out and name:", *lines])


def failures_table(failures: pd.DataFrame, source_label: str) -> Table:
    """Return the basins that could not be computed as a published table; a row reports if none is missing.

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
