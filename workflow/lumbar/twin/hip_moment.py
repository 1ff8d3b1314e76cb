"""Moment at the hip of a lifter, with effects that Eq. 4.1 does not contain.

Head, arms and trunk swing about the hip like a pendulum; its angle counts forward from straight up. The box in the hands and the
stiffness of passive tissues at the end of the range are not in Eq. 4.1; `hidden` in the configuration selects them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from lumbar.settings.twin import SyntheticLift, SyntheticLiftingSettings, TrueEvents
from lumbar.twin.lifter import Movement

GRAVITY = 9.81
"""Default gravity in m/s²."""
STEP = 1e-3
"""Step of the central differences for velocities and accelerations, in seconds."""

Signal = Callable[[np.ndarray], np.ndarray]


def constant(value: float) -> Signal:
    """Return a signal that does not change."""
    return lambda time: np.full(np.shape(time), float(value))


def rate(signal: Signal, time: np.ndarray) -> np.ndarray:
    """Return the first derivative by a central difference of the fourth order."""
    ahead = signal(time + STEP) - signal(time - STEP)
    return (8 * ahead - signal(time + 2 * STEP) + signal(time - 2 * STEP)) / (12 * STEP)


def acceleration(signal: Signal, time: np.ndarray) -> np.ndarray:
    """Return the second derivative by a central difference of the fourth order."""
    near = signal(time + STEP) + signal(time - STEP)
    far = signal(time + 2 * STEP) + signal(time - 2 * STEP)
    return (16 * near - far - 30 * signal(time)) / (12 * STEP**2)


ALWAYS = constant(1.0)
AT_REST = constant(0.0)


@dataclass(frozen=True)
class Mass:
    """A point mass on the line through the pivot."""

    kg: float
    distance: Signal
    """Distance from the pivot in metres, over time."""
    carried: Signal = ALWAYS
    """Share of the mass's weight and inertia that the pendulum carries, over time."""


@dataclass(frozen=True)
class Swing:
    """A swinging body."""

    angle: Signal
    """Angle from the vertical in rad, over time."""
    masses: tuple[Mass, ...]
    central_inertia: float = 0.0
    """Inertia of the body about its centre of mass, kg·m²."""
    hanging: bool = True
    """True if the angle counts from straight down, false if from straight up."""
    pivot_x: Signal = AT_REST
    """Horizontal position of the pivot in metres; positive in the direction of a growing angle."""
    pivot_z: Signal = AT_REST
    """Height of the pivot in metres."""
    gravity: float = GRAVITY
    """Gravity in m/s²."""

    def moment(self, time: np.ndarray) -> np.ndarray:
        """Return the moment in N·m that causes the swing, positive in the direction of the angle; shape (samples,)."""
        up = -1.0 if self.hanging else 1.0
        total = self.central_inertia * acceleration(self.angle, time)
        for mass in self.masses:

            def x(instant, mass=mass):
                return self.pivot_x(instant) + mass.distance(instant) * np.sin(self.angle(instant))

            def z(instant, mass=mass):
                return self.pivot_z(instant) + up * mass.distance(instant) * np.cos(self.angle(instant))

            force_x = mass.kg * acceleration(x, time)
            force_z = mass.kg * (acceleration(z, time) + self.gravity)
            arm_x, arm_z = x(time) - self.pivot_x(time), z(time) - self.pivot_z(time)
            total = total + mass.carried(time) * -up * (arm_x * force_z - arm_z * force_x)
        return total


HAT_MASS, HAT_COM, HAT_GYRATION = 0.678, 0.626, 0.496
"""Head, arms and trunk (Winter 2009, Table 4.1): share of body mass; distance of the centre of mass from the greater
trochanter, and radius of gyration about the centre of mass, as shares of the distance from there to the glenohumeral joint."""
TROCHANTER_TO_SHOULDER = 0.288
"""Distance from greater trochanter to shoulder as a share of stature (Drillis and Contini, 1966)."""
_DECIMALS = {"time_s": 6, "angle_rad": 9, "moment_Nm": 3, "box_held": 9}
"""Number of recorded decimals by column."""
_LOADING_S = 0.1
"""Time in seconds in which the hands take over the whole box."""


def hip_moment(
    time: np.ndarray,
    signals: tuple[Signal, Signal],
    lift: SyntheticLift,
    settings: SyntheticLiftingSettings,
    gravity_m_s2: float,
    rng: np.random.Generator,
):
    """Record the hip moment of one movement: columns ``time_s``, ``angle_rad``, ``moment_Nm``, ``box_held``.

    `time` in seconds has shape (samples,). `signals` are the angle of the trunk in rad and the share of the box in the hands.
    """
    import pandas as pd

    (angle, held), person, options = signals, settings.people[lift.person], settings.hip_moment
    hidden, segment = options.hidden, TROCHANTER_TO_SHOULDER * person.height_m
    mass = HAT_MASS * person.mass_kg
    masses = [Mass(mass, constant(HAT_COM * segment))]
    if hidden.hand_distance_m:
        masses.append(Mass(lift.box_mass_kg, constant(hidden.hand_distance_m), held))
    inertia = mass * (HAT_GYRATION * segment) ** 2
    trunk = Swing(angle, tuple(masses), inertia, hanging=False, gravity=gravity_m_s2)
    moment = trunk.moment(time) + options.damping_N_m_s * rate(angle, time)
    moment += hidden.stiffening_N_m * np.expm1(angle(time) / hidden.stiffening_angle_rad)
    moment += rng.normal(0, options.noise_N_m, len(time))
    columns = {"time_s": time, "angle_rad": angle(time), "moment_Nm": moment, "box_held": held(time)}
    # Rounded like an instrument's: further digits differ between processors, and at rest, where they are all there is, a
    # diagnosis would treat them as motion. Adding zero turns −0 into 0.
    return pd.DataFrame({name: np.round(column, _DECIMALS[name]) + 0.0 for name, column in columns.items()})


def trunk_angle(movement: Movement) -> Signal:
    """Return the inclination of the trunk between the movement's frames, at rest before and after it."""
    spline = scipy.interpolate.make_interp_spline(movement.time, movement.hip_angle, k=5)
    return lambda time: spline(np.clip(time, movement.time[0], movement.time[-1]))


def box_held(events: TrueEvents) -> Signal:
    """Return the share of the box that the hands carry: from lift-off to release."""

    def share(time):
        loaded, released = (
            np.sin(0.5 * np.pi * np.clip((time - start) / _LOADING_S, 0, 1)) ** 2
            for start in (events.lift_off, events.release)
        )
        return loaded - released

    return share
