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

    from lumbar.lifting.movement.pendulum_states import PendulumStates
    from lumbar.settings.stability import StabilitySettings


COMS = ("thorax", "abdomen", "pelvis")
PLANES = ("lateral_bending", "flexion_extension")
SIGNS = {"hanging": 1.0, "inverted": -1.0}
"""Sign σ of the gravity term of Eq. 4.1."""
MINIMUM_SAMPLES = 20
SHORTEST_LENGTH_M = 0.1
VELOCITY_TOLERANCE = 0.1
"""Largest deviation of the integral of the angular velocity from the angle, as a share of the angle's range."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """States of the pendulum of one COM, seen in one plane, while a box is deposited; equal only to itself."""

    subject: str
    """Who lifted."""
    experience: str
    """Label of the subject."""
    box_mass_kg: float
    """Mass of the box."""
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
    """Mass of the pendulum."""
    length_m: float
    """Mean length of the pendulum."""
    mass_counted: str = "with_box"
    """``with_box`` or ``without_box``: whether `mass_kg` includes the box."""
    clock: str = "real"
    """``real``, or ``unit`` if the recorded movement is played in one second."""
    segment_ends: str = "inner"
    """As the key of `lumbar.settings.lifting`."""
    deposit_start: str = "descent"
    """As the key of `lumbar.settings.lifting`."""

    @classmethod
    def of_states(cls, states: PendulumStates, **others) -> Trajectory:
        """Return the trajectory of a pendulum's states with their mean length; `others` are its further attributes."""
        names = ("time", "angle", "angular_velocity", "angular_acceleration")
        motion = {name: getattr(states, name) for name in names}
        return cls(**others, **motion, length_m=float(states.length.mean()))

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
    """Return the name of a trajectory's pendulum in messages and in `lumbar.base.errors.NumericalError.label`."""
    return f"{trajectory.label} ({sign})"


def in_unit_time(trajectory: Trajectory) -> Trajectory:
    """Return the same path played in one second, as the thesis has it ("to non-dimensionalize time", section 4.2.3.1).

    The pendulum keeps its mass, length, damping and gravity, and the regulator its weights: this is another movement, not a
    change of units. In other units of time every area would only be multiplied by the duration.
    """
    duration = trajectory.duration
    return replace(
        trajectory,
        time=(trajectory.time - trajectory.time[0]) / duration,
        angular_velocity=trajectory.angular_velocity * duration,
        angular_acceleration=trajectory.angular_acceleration * duration**2,
        clock="unit",
    )


def at_rest(trajectory: Trajectory) -> Trajectory:
    """Return the null control: the same pendulum at rest at θ0 = 0 for the same duration."""
    return replace(trajectory, angle=np.zeros_like(trajectory.angle))


def find_problems(trajectory: Trajectory) -> Problems:
    """Return the problems that keep a trajectory from having a basin of attraction."""
    from scipy.integrate import cumulative_trapezoid

    problems = Problems(trajectory.label)
    if len(trajectory.time) < MINIMUM_SAMPLES:
        problems.add("", f"{len(trajectory.time)} samples", f"at least {MINIMUM_SAMPLES} are needed")
        return problems
    for name in ("time", "angle", "angular_velocity", "angular_acceleration"):
        values = getattr(trajectory, name)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            problems.add(f"sample {bad[0] + 1}", f"{name} is {values[bad[0]]}", "every value must be finite")
    if not (np.isfinite(trajectory.mass_kg) and trajectory.mass_kg > 0):
        problems.add("mass_kg", f"{trajectory.mass_kg:g}", "a positive mass is needed")
    if not (np.isfinite(trajectory.length_m) and trajectory.length_m >= SHORTEST_LENGTH_M):
        problems.add(
            "length_m",
            f"{trajectory.length_m:g}",
            f"a pendulum shorter than {SHORTEST_LENGTH_M} m describes no trunk segment: choose another pivot",
        )
    if problems.entries:
        return problems
    backward = np.flatnonzero(np.diff(trajectory.time) <= 0)
    if backward.size:
        row = backward[0] + 2
        found = f"time {trajectory.time[row - 1]:g} s after {trajectory.time[row - 2]:g} s"
        problems.add(f"sample {row}", found, "time must increase")
        return problems
    beyond = np.flatnonzero(np.abs(trajectory.angle) >= np.pi)
    if beyond.size:
        row = beyond[0]
        found = f"angle {trajectory.angle[row]:.3g} rad"
        problems.add(f"sample {row + 1}", found, "a COM over or under its pivot lies within ±π")
        return problems
    integral = cumulative_trapezoid(trajectory.angular_velocity, trajectory.time, initial=0.0)
    error = trajectory.angle - trajectory.angle[0] - integral
    # A hundredth of a radian is below what markers resolve: a COM that hardly moves must not fail.
    stray = float(np.ptp(error) / max(np.ptp(trajectory.angle), 0.1))
    if stray > VELOCITY_TOLERANCE:
        problems.add(
            "angular_velocity",
            f"its integral strays from the angle by {100 * stray:.0f} % of the angle's range",
            f"at most {100 * VELOCITY_TOLERANCE:.0f} %: it must be the derivative of the angle",
        )
    return problems


NO_TRAJECTORY = "trajectory"
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
    def of(cls, item: Trajectory, basin: str, reason: str) -> Failure:
        """Return the failure of a basin of one trajectory."""
        return cls(item.subject, item.experience, item.box_mass_kg, item.com, item.plane, basin, reason)


@dataclass(frozen=True)
class Convention:
    """Choices that make a pendulum of a recorded deposit."""

    sign: str
    """Sign of gravity in Eq. 4.1."""
    time: str
    """Whether the movement lasts as long as it was recorded or one second."""
    mass: str
    """Whether the box counts to the pendulum's mass."""
    pivot: str
    """Point about which the pendulum turns: one of `lumbar.lifting.movement.pendulum_states.PIVOTS`."""
    segment_ends: str
    """Whether the trunk's segments end inside the body or at the markers."""
    deposit_start: str
    """Rule for the start of the deposit."""

    def __str__(self) -> str:
        words = (
            f"{self.time} time",
            self.mass,
            self.pivot,
            f"{self.segment_ends} ends",
            f"from {self.deposit_start}",
        )
        return ", ".join([self.sign, *(part.replace("_", " ") for part in words)])


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
    """``thesis_pendulum.csv``, columns of `states`; None if there is no such file."""

    def trajectories(self, convention: Convention) -> tuple[list[Trajectory], list[Failure]]:
        """Return the valid trajectories of one convention, and the failures of the others.

        Pivot, segment ends and start of the deposit are the study's or the thesis's.
        """
        choice = {name: getattr(convention, name) for name in CHOICES}
        thesis, options = self.facts.get("thesis_pendulum"), (convention.mass, convention.time)
        if choice == own_choice(self.facts):
            return trajectories_of_lift(self.states, self.facts, *options)
        if self.in_thesis is None or not thesis or choice != own_choice(thesis):
            named = ", ".join(choice.values())
            reason = f"no pendulum states of {named}: 'lumbar lift' writes thesis_pendulum.csv"
            lost = {**self.facts, "missing": dict.fromkeys(COMS, reason)}
            return trajectories_of_lift(self.states, lost, *options)
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
        Whether the box counts to the pendulum's mass.
    time : {"real", "unit"}
        Whether the movement lasts as long as it was recorded or one second.
    """
    trajectories, failures, missing = [], [], facts.get("missing", {})
    parts = dict(iter(states.groupby(["com", "plane"])))
    lifted = {
        "subject": facts["subject"],
        "experience": facts.get("experience", ""),
        "box_mass_kg": float(facts["box_mass_kg"]),
    }
    for com in COMS:
        for plane in PLANES:
            if com in missing:
                lost = {"com": com, "plane": plane, "basin": NO_TRAJECTORY, "reason": missing[com]}
                failures.append(Failure(**lifted, **lost))
                continue
            rows = parts.get((com, plane), states[:0])
            trajectory = Trajectory(
                **lifted,
                com=com,
                plane=plane,
                **own_choice(facts),
                time=rows["time_s"].to_numpy(float),
                angle=rows["angle_rad"].to_numpy(float),
                angular_velocity=rows["angular_velocity_rad_s"].to_numpy(float),
                angular_acceleration=rows["angular_acceleration_rad_s2"].to_numpy(float),
                mass_kg=float(facts["mass_kg"][com][mass]),
                length_m=float(facts["length_m"][com][plane]),
                mass_counted=mass,
            )
            problems = find_problems(trajectory).entries
            if problems:
                failures.append(Failure.of(trajectory, NO_TRAJECTORY, ". ".join(problems)))
            else:
                trajectories.append(in_unit_time(trajectory) if time == "unit" else trajectory)
    return trajectories, failures


def own_choice(facts: Mapping) -> dict[str, str]:
    """Return the choices in the facts of pendulum states, attributes of `PendulumChoice`."""
    return {name: facts[name] for name in CHOICES}


def headline(settings: StabilitySettings, facts: Mapping) -> Convention:
    """Return the convention of the headline: the study's own choices, including those in a lift's facts."""
    pendulum = settings.pendulum
    return Convention(pendulum.sign, pendulum.time, pendulum.mass, **own_choice(facts))


Result = TypeVar("Result")


def compute_together(
    compute: Callable[[list[Trajectory]], Result],
    trajectories: list[Trajectory],
    basin: str,
    failures: list[Failure],
) -> list[tuple[list[Trajectory], Result]]:
    """Compute all trajectories together; if the error's label is that of one, it is tried separately and the others together
    again, else each separately.

    The integration takes the same number of steps for one basin as for a hundred.

    `basin` names the computed basin for `Failure.basin`; trajectories that fail separately are added to `failures`. Returned are
    the trajectories that were computed together, with their result.

    Examples
    --------
    >>> compute_together(len, ["thorax", "pelvis"], "exact", [])
    [(['thorax', 'pelvis'], 2)]
    """
    found = []
    left = list(trajectories)
    while left:
        try:
            return [*found, (left, compute(left))]
        except NumericalError as error:
            label = error.label
            if len(left) == 1:
                failures.append(Failure.of(left[0], basin, str(error)))
                return found
        separate = [item for item in left if label in (pendulum_label(item, sign) for sign in SIGNS)] or left
        left = [item for item in left if item not in separate]
        for item in separate:
            try:
                found.append(([item], compute([item])))
            except NumericalError as error:
                failures.append(Failure.of(item, basin, str(error)))
    return found


def failures_frame(failures: list[Failure]) -> pd.DataFrame:
    """Return failures as the rows of ``failures.csv``."""
    import pandas as pd

    return pd.DataFrame(
        [asdict(item) for item in failures], columns=columns_of("lifting/stability", "missing_basins")
    )


def join_rows(frames: list[pd.DataFrame]) -> pd.DataFrame:
    """Join the same table of several lifts; tables without rows do not affect the types."""
    import pandas as pd

    filled = [frame for frame in frames if len(frame)]
    return pd.concat(filled, ignore_index=True) if filled else frames[0]


def announcement(path: str | os.PathLike) -> str:
    """Return a message that names every basin in a ``failures.csv``; empty without any."""
    with Path(path).open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    if not rows:
        return ""
    count = f"{len(rows)} basin{'s' if len(rows) > 1 else ''} of attraction could not be computed ({path})"
    return "\n".join(
        [
            f"WARNING: {count}; the tables leave out and name:",
            *(
                f"  - {row['subject']} {float(row['box_mass_kg']):g} kg, {row['com']}, {row['plane']}: "
                f"{row['basin']}: {row['reason']}"
                for row in rows
            ),
        ]
    )


def failures_table(failures: pd.DataFrame, source_label: str) -> Table:
    """Return the basins that could not be computed as a published table; a row reports if none is missing."""
    none, no_rows = failures.empty, failures_frame([])
    if none:
        failures = no_rows.astype(object)
        failures.loc[0] = dict.fromkeys(no_rows) | {"basin": "none", "reason": "every basin was computed"}
    return table_from_schema(
        "lifting/stability",
        "missing_basins",
        failures,
        source_label,
        notes=("Every basin was computed" if none else "These basins are in no other table",),
        may_be_empty=frozenset(no_rows) - {"basin", "reason"} if none else frozenset(),
    )
