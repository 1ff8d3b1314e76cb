"""Effects of stiffness and relaxation: hardening, strain softening, asymmetry, softening, a second Maxwell branch."""

from __future__ import annotations

from lumbar.tissue.models.bases import elongation
from lumbar.tissue.models.form import Effect, Form, Place
from lumbar.tissue.models.parameter import Constant, LinearParameter, NonlinearParameter

_KNEE = (0.1, 0.8, 5, (0.2, 1.2))


def _knee(symbol: str) -> NonlinearParameter:
    return NonlinearParameter("knee", "{x}", "position", *_KNEE, symbol=symbol)


HARDENING = Effect(
    name="hardening_stiffness",
    mechanism="The tissue gets stiffer with depth, alike in both directions.",
    source="Fung, Biomechanics: Mechanical Properties of Living Tissues (1993), section 7.5",
    experiment="excite with a larger amplitude: the force of a stiffening spring grows with its cube",
    forms=(
        Form(
            name="cubic",
            equation="k3*z**3",
            place=Place.PARALLEL,
            linear=(LinearParameter("cubic_stiffness", "{y}/{x}^3", symbol="k3"),),
        ),
        Form(
            name="exponential",
            equation="Fh*sign(z)*expm1(abs(z)/zh)",
            place=Place.PARALLEL,
            linear=(LinearParameter("hardening_force", "{y}", symbol="Fh"),),
            nonlinear=(
                NonlinearParameter(
                    "hardening_length", "{x}", "position", 0.15, 1.5, 6, reach=(0.7, 3.0), symbol="zh"
                ),
            ),
        ),
        Form(
            name="bilinear",
            equation="kb*sign(z)*max(abs(z) - zb, 0)",
            place=Place.PARALLEL,
            linear=(LinearParameter("added_stiffness", "{y}/{x}", symbol="kb"),),
            nonlinear=(_knee("zb"),),
        ),
        Form(
            name="power",
            equation="Fn*sign(z)*abs(z/z_1)**n",
            place=Place.PARALLEL,
            linear=(LinearParameter("hardening_force", "{y}", symbol="Fn"),),
            nonlinear=(
                NonlinearParameter("exponent", "1", "one", 2.0, 6.0, 3, reach=(0.8, 1.5), symbol="n"),
            ),
            constants=(Constant("z_1", 1.0, "{x}"),),
        ),
    ),
)

STRAIN_SOFTENING = Effect(
    name="strain_softening",
    mechanism="The tissue gets softer with depth, alike in both directions, as of fibres that buckle.",
    source="Fung, Biomechanics: Mechanical Properties of Living Tissues (1993), section 7.5",
    experiment="excite with a larger amplitude: the force of a softening spring falls behind its displacement",
    forms=(
        Form(
            name="cubic",
            equation="-k3*z**3",
            place=Place.PARALLEL,
            linear=(LinearParameter("cubic_stiffness_lost", "{y}/{x}^3", symbol="k3"),),
        ),
        Form(
            name="bilinear",
            equation="-kb*sign(z)*max(abs(z) - zb, 0)",
            place=Place.PARALLEL,
            linear=(LinearParameter("stiffness_lost", "{y}/{x}", symbol="kb"),),
            nonlinear=(_knee("zb"),),
        ),
    ),
)

_HALF_DIFFERENCE = LinearParameter(
    "half_difference_of_stiffness", "{y}/{x}", 0, symbol="k_pm", latex=r"k_\pm"
)
_ADDED = LinearParameter("added_stiffness", "{y}/{x}", sign=0, symbol="kd")

QUADRATIC = Effect(
    name="quadratic_stiffness",
    mechanism="The stiffness differs between pushing and pulling.",
    source="Brown, Rosen and Sinanan, Biomechanical properties of abdominal organs, MICCAI (2003)",
    experiment="move about two different mean depths: an even force changes the apparent stiffness",
    forms=(
        Form(
            name="quadratic",
            equation="k2*z**2",
            place=Place.PARALLEL,
            linear=(LinearParameter("quadratic_stiffness", "{y}/{x}^2", sign=0, symbol="k2"),),
        ),
        Form(
            name="two_sided",
            equation="k_pm*abs(z)",
            place=Place.PARALLEL,
            linear=(_HALF_DIFFERENCE,),
        ),
        Form(
            name="rounded",
            equation="k_pm*(hypot(z, r) - r)",
            place=Place.PARALLEL,
            linear=(_HALF_DIFFERENCE,),
            nonlinear=(
                NonlinearParameter(
                    "corner_radius", "{x}", "position", 0.05, 0.8, 4, reach=(0.2, 3.0), symbol="r"
                ),
            ),
        ),
        Form(
            name="deep",
            equation="kd*max(z - zd, 0)",
            place=Place.PARALLEL,
            linear=(_ADDED,),
            nonlinear=(_knee("zd"),),
        ),
        Form(
            name="shallow",
            equation="kd*min(z + zd, 0)",
            place=Place.PARALLEL,
            linear=(_ADDED,),
            nonlinear=(_knee("zd"),),
        ),
    ),
)

_LOST = LinearParameter("stiffness_lost", "{y}/{x}", symbol="ks")

SOFTENING = Effect(
    name="softening",
    mechanism="The tissue softens with the path travelled or with time (preconditioning, damage).",
    source="Mullins, Rubber Chem. Technol. 42 (1969) 339-362; Fung (1993), section 7.5",
    experiment="repeat the same short record several times after another without rest",
    accumulates=True,
    forms=(
        Form(
            name="path",
            equation="ks*z*expm1(-s/s0)",
            place=Place.PARALLEL,
            linear=(_LOST,),
            nonlinear=(
                NonlinearParameter("path_constant", "{x}", "path", 0.02, 3.0, 6, symbol="s0", decisive=True),
            ),
        ),
        Form(
            name="time",
            equation="ks*z*expm1(-t/Ts)",
            place=Place.PARALLEL,
            linear=(_LOST,),
            nonlinear=(
                NonlinearParameter(
                    "time_constant", "s", "duration", 0.02, 3.0, 6, symbol="Ts", decisive=True
                ),
            ),
        ),
        Form(
            name="path_to_floor",
            equation="-ks*z*min(s/s0, 1)",
            place=Place.PARALLEL,
            linear=(_LOST,),
            nonlinear=(
                NonlinearParameter(
                    "path_constant", "{x}", "path", 0.05, 1.0, 5, reach=(0.2, 1.5), symbol="s0", decisive=True
                ),
            ),
        ),
        Form(
            name="whole_force",
            equation="F*(1 + a_s*expm1(-s/s0))",
            place=Place.OUTPUT,
            nonlinear=(
                NonlinearParameter(
                    "share_lost", "1", "one", 0.05, 0.6, 3, reach=(0.02, 1.6), symbol="a_s", decisive=True
                ),
                NonlinearParameter("path_constant", "{x}", "path", 0.05, 1.0, 3, symbol="s0", decisive=True),
            ),
        ),
    ),
)

SECOND_RELAXATION = Effect(
    name="second_relaxation",
    mechanism="The tissue relaxes on a second time scale: another Maxwell branch.",
    source="Wiechert (1893); Fung (1993), section 2.11",
    experiment="hold a step for several of the new time constants, or excite well above 1/(2πτ) if it is fast",
    linear=True,
    forms=(
        Form(
            name="maxwell_branch",
            equation="k3*q",
            place=Place.PARALLEL,
            linear=(LinearParameter("branch_stiffness", "{y}/{x}", symbol="k3"),),
            nonlinear=(
                NonlinearParameter(
                    "relaxation_time",
                    "s",
                    "time",
                    0.008,
                    20.0,
                    12,
                    reach=(0.4, 5.0),
                    symbol="tau_2",
                    follows_record=True,
                    decisive=True,
                ),
            ),
            state=(("q", "v - q/tau_2"),),
            solution=elongation,
        ),
    ),
)

EFFECTS = (HARDENING, STRAIN_SOFTENING, QUADRATIC, SOFTENING, SECOND_RELAXATION)
