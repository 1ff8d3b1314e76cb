"""Effects of speed and acceleration: damping that depends on depth or speed, inertia."""

from __future__ import annotations

from lumbar.tissue.models.form import Effect, Form, Place
from lumbar.tissue.models.parameter import Constant, LinearParameter, NonlinearParameter

_AT_ZERO = LinearParameter("damping_at_zero", "{y} s/{x}", symbol="c")
_PER_DEPTH = ("damping_per_depth", "damping_at_depth")
_UNIT_DEPTH = Constant("z_1", 1.0, "{x}")
_UNIT_SPEED = Constant("v_0", 1.0, "{x}/s")

DEPTH_DEPENDENT_DAMPING = Effect(
    name="depth_dependent_damping",
    mechanism="Damping grows with depth, as of a contact area that grows.",
    source="Hunt and Crossley, J. Appl. Mech. 42 (1975) 440-445",
    experiment="oscillate at one frequency about several mean depths",
    forms=(
        Form(
            name="bilinear",
            essential=_PER_DEPTH,
            equation="lambda_z*z*v + c*v",
            place=Place.PARALLEL,
            linear=(LinearParameter("damping_per_depth", "{y} s/{x}^2", sign=0, symbol="lambda_z"), _AT_ZERO),
        ),
        Form(
            name="one_sided",
            essential=_PER_DEPTH,
            equation="lambda_z*max(z, 0)*v + c*v",
            place=Place.PARALLEL,
            linear=(LinearParameter("damping_per_depth", "{y} s/{x}^2", symbol="lambda_z"), _AT_ZERO),
        ),
        Form(
            name="hunt_crossley",
            essential=_PER_DEPTH,
            equation="lambda_z*max(z/z_1, 0)**n*v + c*v",
            place=Place.PARALLEL,
            linear=(LinearParameter("damping_at_depth", "{y} s/{x}", symbol="lambda_z"), _AT_ZERO),
            nonlinear=(
                NonlinearParameter("exponent", "1", "one", 0.5, 2.0, 3, reach=(0.6, 1.5), symbol="n"),
            ),
            constants=(_UNIT_DEPTH,),
        ),
    ),
)

VISCOUS_DAMPING = Effect(
    name="viscous_damping",
    mechanism="A dashpot beside the tissue: a force in proportion to the speed.",
    source="Fung, Biomechanics: Mechanical Properties of Living Tissues (1993), section 2.11",
    experiment="excite at higher frequencies: the force of a dashpot grows with them, that of a Maxwell branch does not",
    linear=True,
    forms=(
        Form(
            name="dashpot",
            equation="b*v",
            place=Place.PARALLEL,
            linear=(LinearParameter("viscosity", "{y} s/{x}", symbol="b"),),
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
            equation="c2*v*abs(v)",
            place=Place.PARALLEL,
            linear=(LinearParameter("quadratic_damping", "{y} s^2/{x}^2", symbol="c2"),),
        ),
        Form(
            name="power",
            equation="Fn*sign(v)*abs(v/v_0)**n",
            place=Place.PARALLEL,
            linear=(LinearParameter("damping_force", "{y}", symbol="Fn"),),
            nonlinear=(
                NonlinearParameter("exponent", "1", "one", 1.5, 3.0, 3, reach=(0.85, 1.3), symbol="n"),
            ),
            constants=(_UNIT_SPEED,),
        ),
        Form(
            name="sinh",
            equation="F2*sinh(v/v2)",
            place=Place.PARALLEL,
            linear=(LinearParameter("damping_force", "{y}", symbol="F2"),),
            nonlinear=(
                NonlinearParameter(
                    "speed_constant", "{x}/s", "speed", 0.2, 2.0, 4, reach=(0.4, 2.0), symbol="v2"
                ),
            ),
        ),
    ),
)

INERTIA = Effect(
    name="inertia",
    mechanism="Mass that moves with the sensor.",
    source="Newton's second law",
    experiment="excite at higher frequencies: inertia grows with their square, in anti-phase with the spring",
    linear=True,
    forms=(
        Form(
            name="mass",
            equation="m*a",
            place=Place.PARALLEL,
            linear=(LinearParameter("mass", "{y} s^2/{x}", symbol="m"),),
        ),
    ),
)

EFFECTS = (DEPTH_DEPENDENT_DAMPING, VISCOUS_DAMPING, QUADRATIC_DAMPING, INERTIA)
