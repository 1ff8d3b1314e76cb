"""What changes the mass, length and pivot of the pendulum of Eq. 4.1 while it moves.

Each effect has forms that take what was measured beside the angle (`CHANNELS`) and forms that need the angle alone.
Gravity acts with the sign of the base: a form is *hanging* (angle from straight down) or *inverted* (from straight up).
"""

from __future__ import annotations

import numpy as np

from lumbar.effects.windows import held_between, interval_starts, modulation_starts
from lumbar.models.form import Effect, Form, LinearParameter, NonlinearParameter, Place
from lumbar.models.motion import Motion

GRAVITY = 9.81
"""m/s²; masses come out in kg where moments are in N m and angles in rad."""
CHANNELS = {
    "box_held": "box_held",
    "length": "length_m",
    "pivot_acceleration_x": "pivot_acceleration_x_m_s2",
    "pivot_acceleration_z": "pivot_acceleration_z_m_s2",
}
"""Column of each further channel. box_held: share of the box that the hands carry, 0 to 1; length: from the pivot to the
centre of mass; pivot acceleration: x horizontal, positive where a growing angle moves the mass to, z upward."""
_SIGNS = {"hanging": 1.0, "inverted": -1.0}
_BOX = LinearParameter("box_mass", "kg")
_MASS = LinearParameter("moving_mass", "kg")


def _held(motion: Motion, distance: float, sign: float) -> np.ndarray:
    """Moment of a mass of 1 kg at `distance` from the pivot."""
    return distance**2 * motion.acceleration + sign * GRAVITY * distance * np.sin(motion.position)


_DISTANCE = NonlinearParameter("hand_distance", "m", "one", 0.25, 0.75, 2, reach=(0.2, 3.0))
_TIMES = (
    NonlinearParameter("grasp_time", "s", "duration", 0.01, 0.3, 1, reach=(0.01, 3.3)),
    NonlinearParameter("release_time", "s", "duration", 0.9, 1.2, 1, reach=(0.001, 1.0)),
)


def _grasp_and_release(motion, residual):
    times = interval_starts(motion, residual, [motion.acceleration, np.sin(motion.position)])
    return [np.array([distance, *pair]) for pair in times for distance in (0.25, 0.75)]


def _hand_load(name: str, sign: float) -> tuple[Form, Form]:
    moment = rf"m (\ell_h^2 \ddot\theta {'+' if sign > 0 else '-'} g \ell_h \sin\theta)"
    return (
        Form(
            name=f"measured_{name}",
            equation=rf"h(t)\,{moment}",
            place=Place.PARALLEL,
            linear=(_BOX,),
            nonlinear=(_DISTANCE,),
            columns=lambda motion, nonlinear: [
                motion.channels["box_held"] * _held(motion, nonlinear[0], sign)
            ],
            channels=("box_held",),
        ),
        Form(
            name=f"interval_{name}",
            equation=rf"[t_1 < t < t_2]\,{moment}",
            place=Place.PARALLEL,
            linear=(_BOX,),
            nonlinear=(_DISTANCE, *_TIMES),
            columns=lambda motion, nonlinear: [
                held_between(motion.time, nonlinear[1], nonlinear[2]) * _held(motion, nonlinear[0], sign)
            ],
            starts=_grasp_and_release,
        ),
    )


HAND_LOAD = Effect(
    name="hand_load",
    mechanism="A box in the hands for part of the time: its mass swings with the pendulum while it is held.",
    source="Winter, Biomechanics and Motor Control of Human Movement (2009), section 5.1",
    experiment="take the box and put it down in the middle of a record of steady swings",
    forms=(*_hand_load("hanging", 1.0), *_hand_load("inverted", -1.0)),
)


def _telescope(motion: Motion, sign: float) -> np.ndarray:
    """Moment of 1 kg at the measured length: d(ℓ²θ̇)/dt and gravity."""
    length = motion.channels["length"]
    coriolis = 2 * length * motion.rate_of("length") * motion.velocity
    return length**2 * motion.acceleration + coriolis + sign * GRAVITY * length * np.sin(motion.position)


def _swept(motion: Motion, power: int) -> np.ndarray:
    """d(θⁿθ̇)/dt: what a share of the inertia in proportion to the angle's power adds."""
    angle, velocity = motion.position, motion.velocity
    return angle**power * motion.acceleration + power * angle ** (power - 1) * velocity**2


def _pumped(motion, nonlinear):
    turn = 2 * np.pi * nonlinear[0]
    sine, cosine = np.sin(turn * motion.time), np.cos(turn * motion.time)
    return [
        sine * motion.acceleration + turn * cosine * motion.velocity,
        cosine * motion.acceleration - turn * sine * motion.velocity,
        sine * np.sin(motion.position),
        cosine * np.sin(motion.position),
    ]


def _frequency(lines: float = 0.7) -> NonlinearParameter:
    return NonlinearParameter("frequency", "Hz", "time", 0.01, 5.0, 1, lines=lines)


VARIABLE_LENGTH = Effect(
    name="variable_length",
    mechanism="The distance from the pivot to the centre of mass changes: inertia, Coriolis term and gravity follow.",
    source="Goldstein, Classical Mechanics (2002), section 1.6; thesis, Eq. 4.1 with ℓ(t): the term 2mℓℓ̇θ̇",
    experiment="stretch and crouch at a frequency of its own while swinging, and record the length",
    forms=(
        *(
            Form(
                name=f"measured_{name}",
                equation=rf"m (\ell^2 \ddot\theta + 2 \ell \dot\ell \dot\theta {mark} g \ell \sin\theta)",
                place=Place.PARALLEL,
                linear=(_MASS,),
                columns=lambda motion, _, sign=_SIGNS[name]: [_telescope(motion, sign)],
                channels=("length",),
            )
            for name, mark in (("hanging", "+"), ("inverted", "-"))
        ),
        Form(
            name="linear_in_angle",
            equation=r"\frac{d}{dt}[(a_1\theta + a_2\theta^2)\dot\theta] + a_g\theta\sin\theta",
            place=Place.PARALLEL,
            linear=(
                LinearParameter("inertia_per_angle", "{y} s^2/{x}^2", sign=0),
                LinearParameter("inertia_per_squared_angle", "{y} s^2/{x}^3"),
                LinearParameter("gravity_moment_per_angle", "{y}/{x}", sign=0),
            ),
            columns=lambda motion, _: [
                _swept(motion, 1),
                _swept(motion, 2),
                motion.position * np.sin(motion.position),
            ],
        ),
        Form(
            name="quadratic_in_angle",
            equation=r"\frac{d}{dt}[a_2\theta^2\dot\theta] + a_g\theta^2\sin\theta",
            place=Place.PARALLEL,
            linear=(
                LinearParameter("inertia_per_squared_angle", "{y} s^2/{x}^3", sign=0),
                LinearParameter("gravity_moment_per_squared_angle", "{y}/{x}^2", sign=0),
            ),
            columns=lambda motion, _: [_swept(motion, 2), motion.position**2 * np.sin(motion.position)],
        ),
        Form(
            name="oscillating",
            equation=r"\frac{d}{dt}[I(t)\dot\theta] + G(t)\sin\theta,"
            r"\quad I, G = (\cdot)_s \sin 2\pi f t + (\cdot)_c \cos 2\pi f t",
            place=Place.PARALLEL,
            linear=(
                LinearParameter("inertia_sine", "{y} s^2/{x}", sign=0),
                LinearParameter("inertia_cosine", "{y} s^2/{x}", sign=0),
                LinearParameter("gravity_moment_sine", "{y}", sign=0),
                LinearParameter("gravity_moment_cosine", "{y}", sign=0),
            ),
            nonlinear=(_frequency(),),
            columns=_pumped,
            starts=lambda motion, residual: modulation_starts(
                motion, residual, [np.sin(motion.position), motion.acceleration]
            ),
        ),
    ),
)


def _oscillating(carrier):
    """Columns sine and cosine of a frequency of their own, times a function of the angle."""

    def columns(motion, nonlinear):
        turn = 2 * np.pi * nonlinear[0] * motion.time
        return [np.sin(turn) * carrier(motion.position), np.cos(turn) * carrier(motion.position)]

    return columns


def _pivot_oscillates(name: str, equation: str, carrier) -> Form:
    return Form(
        name=name,
        equation=equation,
        place=Place.PARALLEL,
        linear=(
            LinearParameter("sine_moment", "{y}", sign=0),
            LinearParameter("cosine_moment", "{y}", sign=0),
        ),
        nonlinear=(_frequency(),),
        columns=_oscillating(carrier),
        starts=lambda motion, residual: modulation_starts(motion, residual, [carrier(motion.position)]),
    )


_FIRST_MOMENT = LinearParameter("mass_times_length", "kg m", sign=0)


def _pivot(motion: Motion, axis: str) -> np.ndarray:
    carrier = np.cos if axis == "x" else np.sin
    return motion.channels[f"pivot_acceleration_{axis}"] * carrier(motion.position)


MOVING_PIVOT = Effect(
    name="moving_pivot",
    mechanism="The pivot accelerates: the mass resists it with a moment about the pivot.",
    source="Goldstein, Classical Mechanics (2002), section 1.4; Winter (2009), section 5.1",
    experiment="hold the pivot still, or record its acceleration",
    forms=(
        Form(
            name="measured_horizontal",
            equation=r"m\ell\,\ddot x_p \cos\theta",
            place=Place.PARALLEL,
            linear=(_FIRST_MOMENT,),
            columns=lambda motion, _: [_pivot(motion, "x")],
            channels=("pivot_acceleration_x",),
        ),
        Form(
            name="measured_vertical",
            equation=r"m\ell\,\ddot z_p \sin\theta",
            place=Place.PARALLEL,
            linear=(_FIRST_MOMENT,),
            columns=lambda motion, _: [_pivot(motion, "z")],
            channels=("pivot_acceleration_z",),
        ),
        *(
            Form(
                name=f"measured_{name}",
                equation=rf"m\ell (\ddot x_p \cos\theta {mark} \ddot z_p \sin\theta)",
                place=Place.PARALLEL,
                linear=(_FIRST_MOMENT,),
                columns=lambda motion, _, sign=_SIGNS[name]: [
                    _pivot(motion, "x") + sign * _pivot(motion, "z")
                ],
                channels=("pivot_acceleration_x", "pivot_acceleration_z"),
            )
            for name, mark in (("hanging", "+"), ("inverted", "-"))
        ),
        _pivot_oscillates("swaying", r"(A \sin 2\pi f t + B \cos 2\pi f t)\cos\theta", np.cos),
        _pivot_oscillates("heaving", r"(A \sin 2\pi f t + B \cos 2\pi f t)\sin\theta", np.sin),
    ),
)

EFFECTS = (HAND_LOAD, VARIABLE_LENGTH, MOVING_PIVOT)
