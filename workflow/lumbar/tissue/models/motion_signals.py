"""Signals that equations know by symbol: what of the motion they are, in NumPy and in C."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lumbar.tissue.models.motion import Motion


@dataclass(frozen=True)
class MotionSignal:
    """A signal."""

    meaning: str
    """For reports and messages."""
    of: Callable[[Motion], np.ndarray]
    """From a motion to the signal, shape (samples,)."""
    c_name: str = ""
    """Its name in the C code of a form; empty where a running loop does not know it."""
    latex: str = ""
    """Empty where it is the symbol."""
    channel: str = ""
    """Role of the channel beside input and output that it needs; empty without."""


def _channel(role: str, latex: str, meaning: str) -> MotionSignal:
    return MotionSignal(meaning, lambda motion: motion.channels[role], latex=latex, channel=role)


FORCE = "F"
"""The force that an output form transforms."""
SIGNALS = {
    "z": MotionSignal("position", lambda motion: motion.position, "position"),
    "v": MotionSignal("velocity", lambda motion: motion.velocity, "velocity"),
    "a": MotionSignal("acceleration", lambda motion: motion.acceleration, "acceleration"),
    "dz": MotionSignal(
        "change of position since the sample before", lambda motion: motion.increments, "step", r"\Delta z"
    ),
    "s": MotionSignal("path travelled", lambda motion: motion.path, "path"),
    "t": MotionSignal("time since the record's start", lambda motion: motion.time, "time"),
    "theta": MotionSignal("angle from the vertical", lambda motion: motion.position, "position", r"\theta"),
    "theta_dot": MotionSignal("angular velocity", lambda motion: motion.velocity, "velocity", r"\dot \theta"),
    "theta_ddot": MotionSignal(
        "angular acceleration", lambda motion: motion.acceleration, "acceleration", r"\ddot \theta"
    ),
    "box_held": _channel("box_held", "h", "share of the box that the hands carry"),
    "length": _channel("length", r"\ell", "distance from the pivot to the centre of mass"),
    "length_dot": MotionSignal(
        "rate of the length", lambda motion: motion.rate_of("length"), latex=r"\dot \ell", channel="length"
    ),
    "pivot_acceleration_x": _channel("pivot_acceleration_x", r"\ddot x_p", "the pivot's to the front"),
    "pivot_acceleration_z": _channel("pivot_acceleration_z", r"\ddot z_p", "the pivot's upwards"),
}
"""By symbol. The pendulum's angle has names of its own for what a tissue knows as position."""
NEVER_NEGATIVE = {"s", "t"}
STEADY = {"v", "dz", "theta_dot"}
"""Signals that stay the same between two samples where the position is linear in between."""
LINEAR = {"z", "theta", "s", "t"}
"""Signals that are then linear in time."""
