"""States of a planar pendulum from a centre of mass (thesis, section 4.2.3.1 and Eq. 4.1), and the choices behind them.

The angle is zero if the centre of mass is straight above the pivot and grows to the right (lateral
bending, xz plane) or forward (flexion/extension, yz plane): θ = atan2(r, z) with r the horizontal coordinate
relative to the pivot. The angular velocity is θ̇ = (ṙ z − r ż)/L² with L² = r² + z², never the derivative of an
interpolated angle.
"""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from lumbar.base.errors import InputError, NumericalError, Problems
from lumbar.lifting.movement.joint_centres import MID_HIP, TrunkPoints
from lumbar.records.markers import MarkerRecording
from lumbar.records.sampling import runs
from lumbar.settings.lifting import LiftingSettings


@dataclass(frozen=True)
class PendulumChoice:
    """Choices that lead from the markers to the pendulums of a deposit."""

    pivot: str
    """Point about which the pendulum rotates: one of `PIVOTS`."""
    segment_ends: str
    """Ends of the trunk's segments: ``inner`` for joint centres, ``skin`` for markers."""
    deposit_start: str
    """Rule for the start of the deposit: ``descent`` of the box, or ``wrist_minimum``."""

    @classmethod
    def from_settings(cls, settings: LiftingSettings) -> Self:
        """Return the choice of a study."""
        return cls(settings.pivot, settings.segment_ends, settings.events.deposit_start)


CHOICES = tuple(field.name for field in fields(PendulumChoice))
"""Names of the attributes of `PendulumChoice`."""
THESIS_CHOICE = PendulumChoice("mid_ankle", "skin", "wrist_minimum")
"""Choice of the thesis: pivot at the feet (shown only in Figure 4.1), segments between markers, and a deposit that starts at the
least speed of the wrists (section 4.2.3.1)."""
PLANES = {"lateral_bending": 0, "flexion_extension": 1}
"""Horizontal axis of each plane: x (to the right) or y (forward)."""
PIVOTS = {"mid_ankle": ("L_ANKLE", "R_ANKLE"), "hip": (MID_HIP,), "L5": ("L5S1",)}
"""Pivots by name: each moves with the mean of these markers or ends of the trunk's segments."""
MIN_LENGTH_M = 0.01
"""Least distance of a centre of mass from its pivot for a useful angle."""


class MissingSamplesError(InputError):
    """A centre of mass is not known at all instants of the deposit.

    Parameters
    ----------
    text : str
        Message of the error.
    frames : numpy.ndarray of int
        Frames without the centre of mass.
    """

    def __init__(self, text: str, frames: np.ndarray):
        super().__init__(text)
        self.frames = frames


@dataclass(frozen=True)
class PendulumStates:
    """States of one pendulum during the deposit; every array has shape (points,)."""

    time: np.ndarray
    """Time on the recording's clock, seconds."""
    angle: np.ndarray
    """Angle from straight up, radians, unwrapped."""
    angular_velocity: np.ndarray
    """Angular velocity, rad/s."""
    angular_acceleration: np.ndarray
    """Angular acceleration, rad/s²."""
    length: np.ndarray
    """Distance of the centre of mass from the pivot in the plane, metres."""
    length_rate: np.ndarray
    """Rate of change of `length`, m/s."""


def pivot_trajectory(recording: MarkerRecording, points: TrunkPoints, pivot: str) -> np.ndarray:
    """Return the trajectory of a pivot, shape (n, 3) in metres; hips and L5 are ends of the trunk's segments.

    Parameters
    ----------
    recording : MarkerRecording
        Filtered recording.
    points : TrunkPoints
        Ends of the trunk's segments.
    pivot : str
        One of `PIVOTS`.

    Raises
    ------
    InputError
        If the recording lacks a marker.
    """

    def is_known(name: str) -> bool:
        return name in points or name in recording

    problems = Problems(recording.source or recording.name)
    for name in PIVOTS[pivot]:
        if not is_known(name):
            others = ", ".join(other for other, parts in PIVOTS.items() if all(map(is_known, parts)))
            problems.add(
                f"marker {name}",
                points.missing.get(name, recording.absent.get(name, "not in the recording")),
                f"lifting.pivot {pivot} needs it; pivots possible with this recording: {others or 'none'}",
            )
    problems.raise_if_any()
    return np.mean([points[name] if name in points else recording[name] for name in PIVOTS[pivot]], axis=0)


def heading(recording: MarkerRecording, time: float) -> float:
    """Return the angle of the line of the hips, or of both ASIS, from the x axis, radians counterclockwise from above.

    Parameters
    ----------
    recording : MarkerRecording
        Filtered recording.
    time : float
        Time in s on the recording's clock; the nearest frame is used.

    Raises
    ------
    InputError
        If a hip is not seen at this time.
    """
    at = int(np.abs(recording.time - time).argmin())
    part = "ASIS" if "L_ASIS" in recording and "L_HIP" not in recording else "HIP"
    across = recording[f"R_{part}"][at] - recording[f"L_{part}"][at]
    if not np.isfinite(across).all():
        raise InputError(
            f"{recording.source}: a hip is not seen at {time:.2f} s, so lifting.frame pelvis is unknown"
        )
    return float(np.arctan2(across[1], across[0]))


def pendulum_states(
    time: np.ndarray, relative: np.ndarray, start: float, stop: float, points: int
) -> dict[str, PendulumStates]:
    """Return the states in both planes on an even grid of `points` instants from `start` to `stop`.

    A cubic spline through the filtered samples of the *whole* recording gives position, velocity and acceleration at the same
    instants on the real clock, so that the spline continues beyond the ends of the deposit.

    Parameters
    ----------
    time : numpy.ndarray, shape (n,)
        Time in s.
    relative : numpy.ndarray, shape (n, 3)
        Position of the centre of mass relative to the pivot in m.
    start, stop : float
        Start of the deposit in s; end of the deposit in s.
    points : int
        Number of instants of the grid.

    Raises
    ------
    MissingSamplesError
        If samples are missing within the deposit.
    InputError
        If the deposit has fewer than 4 samples.
    NumericalError
        If the centre of mass comes closer to the pivot than `MIN_LENGTH_M`.
    """
    from scipy.interpolate import CubicSpline

    visible = np.isfinite(relative).all(axis=1)
    step = (time[-1] - time[0]) / (len(time) - 1)
    within = (time >= start - step) & (time <= stop + step)
    if not visible[within].all():
        gone = np.flatnonzero(within & ~visible)
        raise MissingSamplesError(
            f"{len(gone)} samples missing within the deposit, the first at {time[gone[0]]:.2f} s",
            gone,
        )
    if within.sum() < 4:
        raise InputError(f"the deposit from {start:g} to {stop:g} s has {within.sum()} samples; 4 are needed")
    # The longest interval without a missing sample that contains the deposit.
    samples = next(run for run in runs(visible) if run.start <= within.argmax() < run.stop)
    spline = CubicSpline(time[samples], relative[samples])
    grid = np.linspace(start, stop, points)
    motion = [spline(grid, order) for order in range(3)]
    planes = {}
    for plane, axis in PLANES.items():
        (r, r1, r2), (z, z1, z2) = ([values[:, index] for values in motion] for index in (axis, 2))
        length = np.hypot(r, z)
        if length.min() < MIN_LENGTH_M:
            raise NumericalError(
                f"it comes within {length.min() * 1e3:.1f} mm of the pivot, where the angle is not defined; use another "
                "lifting.pivot"
            )
        length_rate = (r * r1 + z * z1) / length
        velocity = (r1 * z - r * z1) / length**2
        acceleration = (r2 * z - r * z2) / length**2 - 2 * length_rate * velocity / length
        angle = np.unwrap(np.arctan2(r, z))
        planes[plane] = PendulumStates(grid, angle, velocity, acceleration, length, length_rate)
    return planes
