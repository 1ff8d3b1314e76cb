"""Reference trajectories: the pendulum states of one COM in one plane, checked before they are used."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lumbar.base.errors import Problems

COMS = ("thorax", "abdomen", "pelvis")
PLANES = ("lateral_bending", "flexion_extension")
MINIMUM_SAMPLES = 20
SHORTEST_LENGTH_M = 0.1
VELOCITY_TOLERANCE = 0.1
"""How far the integral of the angular velocity may stray from the angle, as a share of the angle's range."""


@dataclass(frozen=True)
class Trajectory:
    """States of the pendulum of one COM, seen in one plane, while a box is deposited."""

    subject: str
    experience: str
    """`subject`, `experience`: who lifted, and how experienced the person is."""
    box_mass_kg: float
    """Mass of the box."""
    com: str
    plane: str
    """`com`, `plane`: one of `COMS` and one of `PLANES`."""
    pivot: str
    """Point about which the pendulum turns."""
    time: np.ndarray
    """Shape (samples,): seconds, increasing."""
    angle: np.ndarray
    angular_velocity: np.ndarray
    angular_acceleration: np.ndarray
    """`angle`, `angular_velocity`, `angular_acceleration`: shape (samples,): θ0, θ̇0 and θ̈0 in rad, rad/s and rad/s²."""
    mass_kg: float
    length_m: float
    """`mass_kg`, `length_m`: mass and (mean) length of the pendulum."""
    mass_counted: str = "with_box"
    """``with_box`` or ``without_box``: what `mass_kg` holds."""
    clock: str = "real"
    """``real``, or ``unit`` where the recorded movement is played in one second."""

    @property
    def label(self) -> str:
        """Subject, box, COM and plane, for messages."""
        return f"{self.subject} {self.box_mass_kg:g} kg, {self.com}, {self.plane}"

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.time[-1] - self.time[0])


def in_unit_time(trajectory: Trajectory) -> Trajectory:
    """Return the same path played in one second, as the thesis has it ("to non-dimensionalize time", section 4.2.3.1).

    The pendulum keeps its mass, length, damping and gravity, and the regulator its weights: this is another movement and
    no change of units. In other units of time every area would only be multiplied by the duration.
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
    """Collect what keeps a trajectory from having a basin of attraction."""
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
    elif (stray := _velocity_error(trajectory)) > VELOCITY_TOLERANCE:
        problems.add(
            "angular_velocity",
            f"its integral strays from the angle by {100 * stray:.0f} % of the angle's range",
            f"at most {100 * VELOCITY_TOLERANCE:.0f} %: it must be the derivative of the angle",
        )
    return problems


def _velocity_error(trajectory: Trajectory) -> float:
    from scipy.integrate import cumulative_trapezoid

    integral = cumulative_trapezoid(trajectory.angular_velocity, trajectory.time, initial=0.0)
    error = trajectory.angle - trajectory.angle[0] - integral
    # A hundredth of a radian is below what markers resolve: a COM that stays put must not fail.
    return float(np.ptp(error) / max(np.ptp(trajectory.angle), 0.1))
