"""Dry friction: Coulomb and Stribeck, and friction with memory before sliding."""

from __future__ import annotations

from lumbar.tissue.models.c_step import CStep
from lumbar.tissue.models.form import Effect, Form, HandWritten, Place
from lumbar.tissue.models.operators import bouc_wen, bouc_wen_general, elastoplastic, presliding
from lumbar.tissue.models.parameter import LinearParameter, NonlinearParameter

_FORCE = LinearParameter("coulomb_force", "{y}", symbol="Fc")
_SLIDING_SPEED = NonlinearParameter(
    "smoothing_speed", "{x}/s", "speed", 0.001, 0.3, 6, reach=(0.1, 2.0), symbol="vs"
)

COULOMB = Effect(
    name="coulomb_friction",
    mechanism="Dry friction: a force against the motion that does not depend on its speed.",
    source="Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083-1138",
    experiment="move slowly back and forth with small strokes: sliding friction is full at once, presliding is not",
    forms=(
        Form(
            name="coulomb",
            equation="Fc*tanh(v/vs)",
            place=Place.PARALLEL,
            linear=(_FORCE,),
            nonlinear=(_SLIDING_SPEED,),
        ),
        Form(
            name="arctangent",
            equation="2/pi*Fc*arctan(v/vs)",
            place=Place.PARALLEL,
            linear=(_FORCE,),
            nonlinear=(_SLIDING_SPEED,),
        ),
        Form(
            name="stribeck",
            general=True,
            equation="(Fc + Fb*exp(-(v/v_St)**2))*tanh(v/vs)",
            place=Place.PARALLEL,
            linear=(_FORCE, LinearParameter("breakaway_excess", "{y}", symbol="Fb")),
            nonlinear=(
                NonlinearParameter(
                    "smoothing_speed", "{x}/s", "speed", 0.003, 0.1, 3, reach=(0.1, 5.0), symbol="vs"
                ),
                NonlinearParameter(
                    "stribeck_speed", "{x}/s", "speed", 0.05, 1.0, 4, reach=(0.3, 2.0), symbol="v_St"
                ),
            ),
        ),
    ),
)

_DISTANCE = NonlinearParameter(
    "presliding_distance", "{x}", "position", 0.005, 1.5, 9, reach=(0.2, 3.0), symbol="d"
)
_LIMIT = LinearParameter("friction_limit", "{y}", symbol="Fh")
_ELEMENTS = 4
"""Jenkins elements of an Iwan model; each slides at half the distance of the one before."""
_IWAN_STEP = "\n".join(
    f"next[{order}] = behind_gap(memory[{order}], position, largest_distance / {2**order}, first);"
    for order in range(_ELEMENTS)
)
_IWAN_FORCE = " + ".join(
    f"friction_limit_{order} * ((position - next[{order}]) / (largest_distance / {2**order}))"
    for order in range(_ELEMENTS)
)
_BOUC_WEN_STEP = """\
// Exact along one direction: unloading is straight; loading adds travels as tanh(a + b) does.
double direction = sign(step), share = direction * memory[0], travel = fabs(step) / presliding_distance;
if (direction == 0) {
    next[0] = memory[0];
} else if (share + travel < 0) {
    next[0] = direction * (share + travel);
} else {
    if (share < 0) {
        travel += share;
        share = 0;
    }
    double added = portable_tanh(travel);
    next[0] = direction * ((share + added) / (1.0 + share * added));
}"""
_BOUC_WEN_GENERAL_STEP = """\
// Exact along one direction: 1 + w|r| decays at the rate w against the force, 1 - (1 - w)|r| at 1 - w with it.
const double direction = sign(step), share = direction * memory[0], travel = fabs(step) / presliding_distance;
const double opposing = larger(-share, 0.0), aiding = larger(share, 0.0);
const double until_zero = portable_log(1.0 + unloading_share * opposing) / unloading_share;
const double left = larger(until_zero - travel, 0.0), beyond = larger(travel - until_zero, 0.0);
const double exponent = (unloading_share - 1.0) * beyond;
const double passed = beyond * phi1(exponent) - left * phi1(unloading_share * left);
next[0] = direction == 0 ? memory[0] : direction * (aiding * (1.0 + portable_expm1(exponent)) + passed);"""

HYSTERESIS = Effect(
    name="hysteresis",
    mechanism="Friction that builds up with displacement after each reversal, whatever the speed.",
    source="Dahl (1968); Wen, J. Eng. Mech. Div. 102 (1976) 249-263; Iwan, J. Appl. Mech. 33 (1966) 893-900; Ismail, Ikhouane "
    "and Rodellar, Arch. Comput. Methods Eng. 16 (2009) 161-188",
    experiment="move slowly with strokes below and above the presliding distance: the loop stays open at any speed",
    forms=(
        Form(
            name="dahl",
            equation="Fh*r",
            place=Place.PARALLEL,
            linear=(_LIMIT,),
            nonlinear=(_DISTANCE,),
            state=(("r", "v/d*(1 - r*sign(v))"),),
            solution=lambda motion, nonlinear: (presliding(motion, nonlinear[0]),),
        ),
        Form(
            name="bouc_wen",
            equation="Fh*r",
            place=Place.PARALLEL,
            linear=(_LIMIT,),
            nonlinear=(_DISTANCE,),
            state=(("r", "v/d*(1 - max(r*sign(v), 0)**2)"),),
            solution=lambda motion, nonlinear: (bouc_wen(motion, nonlinear[0]),),
            c_solution=_BOUC_WEN_STEP,
        ),
        # In Bouc and Wen's letters w = (γ − δ)/2γ, d = 1/2βγ, with γ > 0. A quadratic energy of the spring admits w ≤ 1
        # (−γ ≤ δ ≤ γ: Erlicher and Point, C. R. Mécanique 332 (2004) 51-57); unloading is steeper than loading for every
        # w, so that each loop takes energy also beyond: the benchmark of Noël and Schoukens (2016) has w = 1.19.
        Form(
            name="bouc_wen_general",
            equation="Fr*r",
            place=Place.PARALLEL,
            linear=(LinearParameter("hysteretic_force", "{y}", symbol="Fr"),),
            nonlinear=(
                NonlinearParameter(
                    "presliding_distance", "{x}", "position", 0.05, 1.0, 5, reach=(0.1, 4.0), symbol="d"
                ),
                NonlinearParameter("unloading_share", "1", "one", 0.2, 1.2, 2, reach=(0.05, 3.0), symbol="w"),
            ),
            state=(("r", "v/d*(1 + w*abs(r) - max(r*sign(v), 0))"),),
            solution=lambda motion, nonlinear: (bouc_wen_general(motion, *nonlinear),),
            c_solution=_BOUC_WEN_GENERAL_STEP,
            general=True,
        ),
        Form(
            name="elastoplastic",
            equation=r"F_h (z - \mathrm{play}_d(z))/d",
            place=Place.PARALLEL,
            linear=(_LIMIT,),
            nonlinear=(_DISTANCE,),
            hand_written=HandWritten(
                columns=lambda motion, nonlinear: [elastoplastic(motion, nonlinear[0])],
                c_step=CStep(
                    "friction_limit * ((position - next[0]) / presliding_distance)",
                    "next[0] = behind_gap(memory[0], position, presliding_distance, first);  // the slider",
                    memory=1,
                ),
            ),
        ),
        Form(
            name="iwan",
            equation=r"\sum_{n=0}^{3} F_n\,(z - \mathrm{play}_{d_n}(z))/d_n,\quad d_n = d/2^n",
            place=Place.PARALLEL,
            linear=tuple(
                LinearParameter(f"friction_limit_{order}", "{y}", symbol=f"F{order}")
                for order in range(_ELEMENTS)
            ),
            nonlinear=(
                NonlinearParameter(
                    "largest_distance", "{x}", "position", 0.2, 1.5, 3, reach=(0.5, 1.5), symbol="d"
                ),
            ),
            hand_written=HandWritten(
                columns=lambda motion, nonlinear: [
                    elastoplastic(motion, nonlinear[0] / 2**order) for order in range(_ELEMENTS)
                ],
                c_step=CStep(_IWAN_FORCE, _IWAN_STEP, memory=_ELEMENTS),
            ),
        ),
    ),
)

EFFECTS = (COULOMB, HYSTERESIS)
