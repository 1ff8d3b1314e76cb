"""Dry friction: Coulomb and Stribeck, and friction with memory before sliding."""

from __future__ import annotations

import numpy as np

from lumbar.models.c_step import CStep
from lumbar.models.form import Effect, Form, LinearParameter, NonlinearParameter, Place
from lumbar.models.operators import bouc_wen, elastoplastic, presliding

_SLIDING_SPEED = NonlinearParameter("smoothing_speed", "{x}/s", "speed", 0.001, 0.3, 6, reach=(0.1, 2.0))
_STRIBECK_SPEED = NonlinearParameter("stribeck_speed", "{x}/s", "speed", 0.05, 1.0, 4, reach=(0.3, 2.0))


def _stribeck(motion, nonlinear):
    sliding = np.tanh(motion.velocity / nonlinear[0])
    return [sliding, sliding * np.exp(-((motion.velocity / nonlinear[1]) ** 2))]


COULOMB = Effect(
    name="coulomb_friction",
    mechanism="Dry friction: a force against the motion that does not depend on its speed.",
    source="Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083-1138",
    experiment="move slowly back and forth with small strokes: sliding friction is full at once, presliding is not",
    forms=(
        Form(
            name="coulomb",
            equation=r"F_c \tanh(v/v_s)",
            place=Place.PARALLEL,
            linear=(LinearParameter("coulomb_force", "{y}"),),
            nonlinear=(_SLIDING_SPEED,),
            columns=lambda motion, nonlinear: [np.tanh(motion.velocity / nonlinear[0])],
            c_step=CStep("coulomb_force * portable_tanh(velocity / smoothing_speed)"),
        ),
        Form(
            name="arctangent",
            equation=r"\frac{2}{\pi} F_c \arctan(v/v_s)",
            place=Place.PARALLEL,
            linear=(LinearParameter("coulomb_force", "{y}"),),
            nonlinear=(_SLIDING_SPEED,),
            columns=lambda motion, nonlinear: [2 / np.pi * np.arctan(motion.velocity / nonlinear[0])],
            c_step=CStep(
                "coulomb_force * (0.63661977236758134308 * portable_arctan(velocity / smoothing_speed))"
            ),
        ),
        Form(
            name="stribeck",
            equation=r"(F_c + (F_s - F_c) e^{-(v/v_{St})^2}) \tanh(v/v_s)",
            place=Place.PARALLEL,
            linear=(LinearParameter("coulomb_force", "{y}"), LinearParameter("breakaway_excess", "{y}")),
            nonlinear=(
                NonlinearParameter("smoothing_speed", "{x}/s", "speed", 0.003, 0.1, 3, reach=(0.1, 5.0)),
                _STRIBECK_SPEED,
            ),
            columns=_stribeck,
            c_step=CStep(
                "coulomb_force * sliding + breakaway_excess * (sliding * portable_decay(ratio * ratio))",
                "double sliding = portable_tanh(velocity / smoothing_speed), ratio = velocity / stribeck_speed;",
            ),
        ),
    ),
)

_DISTANCE = NonlinearParameter("presliding_distance", "{x}", "position", 0.005, 1.5, 9, reach=(0.2, 3.0))
_LIMIT = LinearParameter("friction_limit", "{y}")
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
_DAHL_STEP = """\
// Share of the limit: along one direction it approaches 1 exponentially with the distance.
double direction = sign(step);
if (direction == 0) {
    next[0] = memory[0];
} else {
    next[0] = direction + (memory[0] - direction) * portable_decay(fabs(step) / presliding_distance);
}"""
_BOUC_WEN_STEP = """\
// Share of the limit: unloading is straight; loading adds travels as tanh(a + b) does.
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

HYSTERESIS = Effect(
    name="hysteresis",
    mechanism="Friction that builds up with displacement after each reversal, whatever the speed.",
    source="Dahl (1968); Wen, J. Eng. Mech. Div. 102 (1976) 249-263; Iwan, J. Appl. Mech. 33 (1966) 893-900",
    experiment="move slowly with strokes below and above the presliding distance: the loop stays open at any speed",
    forms=(
        Form(
            name="dahl",
            equation=r"F_h r,\quad \frac{dr}{dz} = (1 - r\,\mathrm{sign}\,v)/d",
            place=Place.PARALLEL,
            linear=(_LIMIT,),
            nonlinear=(_DISTANCE,),
            columns=lambda motion, nonlinear: [presliding(motion, nonlinear[0])],
            c_step=CStep("friction_limit * next[0]", _DAHL_STEP, memory=1),
        ),
        Form(
            name="bouc_wen",
            equation=r"F_h r,\quad \frac{dr}{dz} = (1 - r^2 [r v > 0])/d",
            place=Place.PARALLEL,
            linear=(_LIMIT,),
            nonlinear=(_DISTANCE,),
            columns=lambda motion, nonlinear: [bouc_wen(motion, nonlinear[0])],
            c_step=CStep("friction_limit * next[0]", _BOUC_WEN_STEP, memory=1),
        ),
        Form(
            name="elastoplastic",
            equation=r"F_h (z - \mathrm{play}_d(z))/d",
            place=Place.PARALLEL,
            linear=(_LIMIT,),
            nonlinear=(_DISTANCE,),
            columns=lambda motion, nonlinear: [elastoplastic(motion, nonlinear[0])],
            c_step=CStep(
                "friction_limit * ((position - next[0]) / presliding_distance)",
                "next[0] = behind_gap(memory[0], position, presliding_distance, first);  // the slider",
                memory=1,
            ),
        ),
        Form(
            name="iwan",
            equation=r"\sum_{n=0}^{3} F_n\,(z - \mathrm{play}_{d_n}(z))/d_n,\quad d_n = d/2^n",
            place=Place.PARALLEL,
            linear=tuple(LinearParameter(f"friction_limit_{order}", "{y}") for order in range(_ELEMENTS)),
            nonlinear=(
                NonlinearParameter("largest_distance", "{x}", "position", 0.2, 1.5, 3, reach=(0.5, 1.5)),
            ),
            columns=lambda motion, nonlinear: [
                elastoplastic(motion, nonlinear[0] / 2**order) for order in range(_ELEMENTS)
            ],
            c_step=CStep(_IWAN_FORCE, _IWAN_STEP, memory=_ELEMENTS),
        ),
    ),
)

EFFECTS = (COULOMB, HYSTERESIS)
