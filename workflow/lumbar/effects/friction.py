"""Dry friction: Coulomb and Stribeck, and friction with memory before sliding."""

from __future__ import annotations

import numpy as np

from lumbar.effects.effect import Amplitude, Effect, Form, Place, Shape
from lumbar.effects.operators import bouc_wen, elastoplastic, presliding

_SLIDING_SPEED = Shape("smoothing_speed", "{x}/s", "speed", 0.001, 0.3, 6, reach=(0.1, 2.0))
_STRIBECK_SPEED = Shape("stribeck_speed", "{x}/s", "speed", 0.05, 1.0, 4, reach=(0.3, 2.0))


def _stribeck(motion, shapes):
    sliding = np.tanh(motion.velocity / shapes[0])
    return [sliding, sliding * np.exp(-((motion.velocity / shapes[1]) ** 2))]


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
            amplitudes=(Amplitude("coulomb_force", "{y}"),),
            shapes=(_SLIDING_SPEED,),
            columns=lambda motion, shapes: [np.tanh(motion.velocity / shapes[0])],
        ),
        Form(
            name="arctangent",
            equation=r"\frac{2}{\pi} F_c \arctan(v/v_s)",
            place=Place.PARALLEL,
            amplitudes=(Amplitude("coulomb_force", "{y}"),),
            shapes=(_SLIDING_SPEED,),
            columns=lambda motion, shapes: [2 / np.pi * np.arctan(motion.velocity / shapes[0])],
        ),
        Form(
            name="stribeck",
            equation=r"(F_c + (F_s - F_c) e^{-(v/v_{St})^2}) \tanh(v/v_s)",
            place=Place.PARALLEL,
            amplitudes=(Amplitude("coulomb_force", "{y}"), Amplitude("breakaway_excess", "{y}")),
            shapes=(
                Shape("smoothing_speed", "{x}/s", "speed", 0.003, 0.1, 3, reach=(0.1, 5.0)),
                _STRIBECK_SPEED,
            ),
            columns=_stribeck,
        ),
    ),
)

_DISTANCE = Shape("presliding_distance", "{x}", "position", 0.005, 1.5, 9, reach=(0.2, 3.0))
_LIMIT = Amplitude("friction_limit", "{y}")

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
            amplitudes=(_LIMIT,),
            shapes=(_DISTANCE,),
            columns=lambda motion, shapes: [presliding(motion, shapes[0])],
        ),
        Form(
            name="bouc_wen",
            equation=r"F_h r,\quad \frac{dr}{dz} = (1 - r^2 [r v > 0])/d",
            place=Place.PARALLEL,
            amplitudes=(_LIMIT,),
            shapes=(_DISTANCE,),
            columns=lambda motion, shapes: [bouc_wen(motion, shapes[0])],
        ),
        Form(
            name="elastoplastic",
            equation=r"F_h (z - \mathrm{play}_d(z))/d",
            place=Place.PARALLEL,
            amplitudes=(_LIMIT,),
            shapes=(_DISTANCE,),
            columns=lambda motion, shapes: [elastoplastic(motion, shapes[0])],
        ),
        Form(
            name="iwan",
            equation=r"\sum_{n=0}^{3} F_n\,(z - \mathrm{play}_{d_n}(z))/d_n,\quad d_n = d/2^n",
            place=Place.PARALLEL,
            amplitudes=tuple(Amplitude(f"friction_limit_{order}", "{y}") for order in range(4)),
            shapes=(Shape("largest_distance", "{x}", "position", 0.2, 1.5, 3, reach=(0.5, 1.5)),),
            columns=lambda motion, shapes: [
                elastoplastic(motion, shapes[0] / 2**order) for order in range(4)
            ],
        ),
    ),
)

EFFECTS = (COULOMB, HYSTERESIS)
