"""What changes the mass, length and pivot of the pendulum of Eq. 4.1 while it moves.

Each effect has forms that take what was measured beside the angle (`CHANNELS`) and forms that need the angle alone.
Gravity acts with the sign of the base: a form is *hanging* (angle from straight down) or *inverted* (from straight up).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lumbar.base.errors import InputError
from lumbar.settings.stability import PendulumSettings
from lumbar.tissue.effects.windows import TAKE_OVER, interval_starts, modulation_starts
from lumbar.tissue.models.form import Effect, Form, Place
from lumbar.tissue.models.parameter import Constant, LinearParameter, NonlinearParameter

GRAVITY = PendulumSettings().gravity_m_s2
"""The default, m/s² (`under_gravity` takes another); masses come out in kg where moments are in N m and angles in rad."""
CHANNELS = {
    "box_held": "box_held",
    "length": "length_m",
    "pivot_acceleration_x": "pivot_acceleration_x_m_s2",
    "pivot_acceleration_z": "pivot_acceleration_z_m_s2",
}
"""Column of each further channel. box_held: share of the box that the hands carry, 0 to 1; length: from the pivot to the
centre of mass; pivot acceleration: x horizontal, positive where a growing angle moves the mass to, z upward."""
_GRAVITY = Constant("g", GRAVITY, "m/s^2")
_SIGNS = (("hanging", "+"), ("inverted", "-"))
_BOX = LinearParameter("box_mass", "kg", symbol="m")
_MASS = LinearParameter("moving_mass", "kg", symbol="m")
_DISTANCE = NonlinearParameter(
    "hand_distance", "m", "one", 0.25, 0.75, 2, reach=(0.2, 3.0), symbol="l_h", latex=r"\ell_h"
)
_TIMES = (
    NonlinearParameter("grasp_time", "s", "duration", 0.01, 0.3, 1, reach=(0.01, 3.3), symbol="t1"),
    NonlinearParameter("release_time", "s", "duration", 0.9, 1.2, 1, reach=(0.001, 1.0), symbol="t2"),
)
_HELD_BETWEEN = "(smoothstep((t - t1)/T + 0.5) - smoothstep((t - t2)/T + 0.5))"
"""1 between two instants, 0 elsewhere, with cubic transitions about them."""


def _grasp_and_release(motion, residual):
    times = interval_starts(motion, residual, [motion.acceleration, np.sin(motion.position)])
    return [np.array([distance, *pair]) for pair in times for distance in (0.25, 0.75)]


def _hand_load(name: str, sign: str) -> tuple[Form, Form]:
    moment = f"(l_h**2*theta_ddot {sign} g*l_h*sin(theta))"
    return (
        Form(
            name=f"measured_{name}",
            equation=f"m*box_held*{moment}",
            place=Place.PARALLEL,
            linear=(_BOX,),
            nonlinear=(_DISTANCE,),
            constants=(_GRAVITY,),
        ),
        Form(
            name=f"interval_{name}",
            equation=f"m*{_HELD_BETWEEN}*{moment}",
            place=Place.PARALLEL,
            linear=(_BOX,),
            nonlinear=(_DISTANCE, *_TIMES),
            constants=(_GRAVITY, Constant("T", TAKE_OVER, "s")),
            starts=_grasp_and_release,
        ),
    )


HAND_LOAD = Effect(
    name="hand_load",
    mechanism="A box in the hands for part of the time: its mass swings with the pendulum while it is held.",
    source="Winter, Biomechanics and Motor Control of Human Movement (2009), section 5.1",
    experiment="take the box and put it down in the middle of a record of steady swings",
    forms=tuple(form for name, sign in _SIGNS for form in _hand_load(name, sign)),
)

_FREQUENCY = NonlinearParameter("frequency", "Hz", "time", 0.01, 5.0, 1, lines=0.7, symbol="f")
_PER_SQUARED_ANGLE = "(theta**2*theta_ddot + 2*theta*theta_dot**2)"
"""d(θ²θ̇)/dt: what a share of the inertia in proportion to the squared angle adds."""

VARIABLE_LENGTH = Effect(
    name="variable_length",
    mechanism="The distance from the pivot to the centre of mass changes: inertia, Coriolis term and gravity follow.",
    source="Goldstein, Classical Mechanics (2002), section 1.6; thesis, Eq. 4.1 with ℓ(t): the term 2mℓℓ̇θ̇",
    experiment="stretch and crouch at a frequency of its own while swinging, and record the length",
    forms=(
        *(
            Form(
                name=f"measured_{name}",
                equation=f"m*(length**2*theta_ddot + 2*length*length_dot*theta_dot {sign} g*length*sin(theta))",
                place=Place.PARALLEL,
                linear=(_MASS,),
                constants=(_GRAVITY,),
            )
            for name, sign in _SIGNS
        ),
        Form(
            name="linear_in_angle",
            equation=f"a1*(theta*theta_ddot + theta_dot**2) + a2*{_PER_SQUARED_ANGLE} + a_g*theta*sin(theta)",
            place=Place.PARALLEL,
            linear=(
                LinearParameter("inertia_per_angle", "{y} s^2/{x}^2", sign=0, symbol="a1"),
                LinearParameter("inertia_per_squared_angle", "{y} s^2/{x}^3", symbol="a2"),
                LinearParameter("gravity_moment_per_angle", "{y}/{x}", sign=0, symbol="a_g"),
            ),
        ),
        Form(
            name="quadratic_in_angle",
            equation=f"a2*{_PER_SQUARED_ANGLE} + a_g*theta**2*sin(theta)",
            place=Place.PARALLEL,
            linear=(
                LinearParameter("inertia_per_squared_angle", "{y} s^2/{x}^3", sign=0, symbol="a2"),
                LinearParameter("gravity_moment_per_squared_angle", "{y}/{x}^2", sign=0, symbol="a_g"),
            ),
        ),
        Form(
            # d(I(t)θ̇)/dt + G(t) sin θ, with I and G that swell at a frequency of their own.
            name="oscillating",
            equation="I_s*(sin(2*pi*f*t)*theta_ddot + 2*pi*f*cos(2*pi*f*t)*theta_dot)"
            " + I_c*(cos(2*pi*f*t)*theta_ddot - 2*pi*f*sin(2*pi*f*t)*theta_dot)"
            " + (G_s*sin(2*pi*f*t) + G_c*cos(2*pi*f*t))*sin(theta)",
            place=Place.PARALLEL,
            linear=(
                LinearParameter("inertia_sine", "{y} s^2/{x}", sign=0, symbol="I_s"),
                LinearParameter("inertia_cosine", "{y} s^2/{x}", sign=0, symbol="I_c"),
                LinearParameter("gravity_moment_sine", "{y}", sign=0, symbol="G_s"),
                LinearParameter("gravity_moment_cosine", "{y}", sign=0, symbol="G_c"),
            ),
            nonlinear=(_FREQUENCY,),
            starts=lambda motion, residual: modulation_starts(
                motion, residual, [np.sin(motion.position), motion.acceleration]
            ),
        ),
    ),
)


def _pivot_oscillates(name: str, wave: str, carrier: Callable[[np.ndarray], np.ndarray]) -> Form:
    return Form(
        name=name,
        equation=f"(A*sin(2*pi*f*t) + B*cos(2*pi*f*t))*{wave}(theta)",
        place=Place.PARALLEL,
        linear=(
            LinearParameter("sine_moment", "{y}", sign=0, symbol="A"),
            LinearParameter("cosine_moment", "{y}", sign=0, symbol="B"),
        ),
        nonlinear=(_FREQUENCY,),
        starts=lambda motion, residual: modulation_starts(motion, residual, [carrier(motion.position)]),
    )


_FIRST_MOMENT = LinearParameter("mass_times_length", "kg m", sign=0, symbol="S", latex=r"m \ell")


def _pivot_measured(name: str, accelerated: str) -> Form:
    return Form(
        name=f"measured_{name}", equation=f"S*{accelerated}", place=Place.PARALLEL, linear=(_FIRST_MOMENT,)
    )


_ALONG, _UPWARDS = "pivot_acceleration_x*cos(theta)", "pivot_acceleration_z*sin(theta)"

MOVING_PIVOT = Effect(
    name="moving_pivot",
    mechanism="The pivot accelerates: the mass resists it with a moment about the pivot.",
    source="Goldstein, Classical Mechanics (2002), section 1.4; Winter (2009), section 5.1",
    experiment="hold the pivot still, or record its acceleration",
    forms=(
        _pivot_measured("horizontal", _ALONG),
        _pivot_measured("vertical", _UPWARDS),
        *(_pivot_measured(name, f"({_ALONG} {sign} {_UPWARDS})") for name, sign in _SIGNS),
        _pivot_oscillates("swaying", "cos", np.cos),
        _pivot_oscillates("heaving", "sin", np.sin),
    ),
)

EFFECTS = (HAND_LOAD, VARIABLE_LENGTH, MOVING_PIVOT)


def under_gravity(effect: Effect, gravity_m_s2: float) -> Effect:
    """The effect where masses weigh otherwise than on the ground here.

    Raises
    ------
    InputError
        If gravity is not above 0: without weight no record tells a mass from its distance.
    """
    if not 0 < gravity_m_s2 < np.inf:
        raise InputError(f"gravity_m_s2 is {gravity_m_s2:g}: the effects on a pendulum need m/s² above 0")
    values = {_GRAVITY.symbol: float(gravity_m_s2)}
    return replace(effect, forms=tuple(form.with_constants(values) for form in effect.forms))
