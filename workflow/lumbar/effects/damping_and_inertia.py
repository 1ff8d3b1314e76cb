"""Effects of speed and acceleration: damping that depends on depth or speed, inertia."""

from __future__ import annotations

import numpy as np

from lumbar.models.c_step import CStep
from lumbar.models.form import Effect, Form, LinearParameter, NonlinearParameter, Place


def _hunt_crossley(motion, exponent):
    depth = np.maximum(motion.position, 0.0) ** exponent
    return [depth * motion.velocity, motion.velocity]


DEPTH_DEPENDENT_DAMPING = Effect(
    name="depth_dependent_damping",
    mechanism="Damping grows with depth, as of a contact area that grows.",
    source="Hunt and Crossley, J. Appl. Mech. 42 (1975) 440-445",
    experiment="oscillate at one frequency about several mean depths",
    forms=(
        Form(
            name="bilinear",
            equation=r"\lambda (z + z_0) v",
            place=Place.PARALLEL,
            linear=(
                LinearParameter("damping_per_depth", "{y} s/{x}^2", sign=0),
                LinearParameter("damping_at_zero", "{y} s/{x}"),
            ),
            columns=lambda motion, _: [motion.position * motion.velocity, motion.velocity],
            c_step=CStep("damping_per_depth * (position * velocity) + damping_at_zero * velocity"),
        ),
        Form(
            name="one_sided",
            equation=r"\lambda \max(z, 0) v + c v",
            place=Place.PARALLEL,
            linear=(
                LinearParameter("damping_per_depth", "{y} s/{x}^2"),
                LinearParameter("damping_at_zero", "{y} s/{x}"),
            ),
            columns=lambda motion, _: _hunt_crossley(motion, 1.0),
            c_step=CStep(
                "damping_per_depth * (depth * velocity) + damping_at_zero * velocity",
                "double depth = position > 0 ? position : 0.0;",
            ),
        ),
        Form(
            name="hunt_crossley",
            equation=r"\lambda \max(z/z_1, 0)^n v + c v,\quad z_1 = \text{1 unit}",
            place=Place.PARALLEL,
            linear=(
                LinearParameter("damping_at_depth", "{y} s/{x}"),
                LinearParameter("damping_at_zero", "{y} s/{x}"),
            ),
            nonlinear=(NonlinearParameter("exponent", "1", "one", 0.5, 2.0, 3, reach=(0.6, 1.5)),),
            columns=lambda motion, nonlinear: _hunt_crossley(motion, nonlinear[0]),
            c_step=CStep(
                "damping_at_depth * (depth * velocity) + damping_at_zero * velocity",
                "double depth = portable_power(position > 0 ? position : 0.0, exponent);",
            ),
        ),
    ),
)

QUADRATIC_DAMPING = Effect(
    name="quadratic_damping",
    mechanism="Damping grows with speed, as of fluid pushed through the tissue.",
    source="Thornton and Marion, Classical Dynamics (2004), section 2.4",
    experiment="sweep the amplitude at one high frequency: the force in phase with speed grows with its square",
    forms=(
        Form(
            name="quadratic",
            equation=r"c_2 v|v|",
            place=Place.PARALLEL,
            linear=(LinearParameter("quadratic_damping", "{y} s^2/{x}^2"),),
            columns=lambda motion, _: [motion.velocity * np.abs(motion.velocity)],
            c_step=CStep("quadratic_damping * (velocity * fabs(velocity))"),
        ),
        Form(
            name="power",
            equation=r"c_n\,\mathrm{sign}(v)\,|v/v_0|^n,\quad v_0 = \text{1 unit per s}",
            place=Place.PARALLEL,
            linear=(LinearParameter("damping_force", "{y}"),),
            nonlinear=(NonlinearParameter("exponent", "1", "one", 1.5, 3.0, 3, reach=(0.85, 1.3)),),
            columns=lambda motion, nonlinear: [
                np.sign(motion.velocity) * np.abs(motion.velocity) ** nonlinear[0]
            ],
            c_step=CStep("damping_force * (sign(velocity) * portable_power(fabs(velocity), exponent))"),
        ),
        Form(
            name="sinh",
            equation=r"F_2 \sinh(v/v_2)",
            place=Place.PARALLEL,
            linear=(LinearParameter("damping_force", "{y}"),),
            nonlinear=(
                NonlinearParameter("speed_constant", "{x}/s", "speed", 0.2, 2.0, 4, reach=(0.4, 2.0)),
            ),
            columns=lambda motion, nonlinear: [np.sinh(motion.velocity / nonlinear[0])],
            c_step=CStep("damping_force * portable_sinh(velocity / speed_constant)"),
        ),
    ),
)

INERTIA = Effect(
    name="inertia",
    mechanism="Mass that moves with the sensor.",
    source="Newton's second law",
    experiment="excite at higher frequencies: inertia grows with their square, in anti-phase with the spring",
    forms=(
        Form(
            name="mass",
            equation=r"m \ddot z",
            place=Place.PARALLEL,
            linear=(LinearParameter("mass", "{y} s^2/{x}"),),
            columns=lambda motion, _: [motion.acceleration],
            c_step=CStep("mass * acceleration"),
        ),
    ),
)

EFFECTS = (DEPTH_DEPENDENT_DAMPING, QUADRATIC_DAMPING, INERTIA)
