"""What no equation of the catalogue says, by the names under which its YAML files call it.

Closed forms of states, simulation and C code by hand, where a search begins, and what of a record contradicts an effect. A
user's YAML names none of them: it is data and runs nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from lumbar.tissue.effects.starts import interval_starts, modulation_starts, strongest_lines
from lumbar.tissue.models.bases import elongation
from lumbar.tissue.models.equation import CStep
from lumbar.tissue.models.form import HandWritten
from lumbar.tissue.models.operators import bouc_wen, bouc_wen_general, elastoplastic, play, presliding

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
_SOLUTIONS = {
    "maxwell_branch": (elongation, ""),
    "dahl": (lambda motion, nonlinear: (presliding(motion, nonlinear[0]),), ""),
    "bouc_wen": (lambda motion, nonlinear: (bouc_wen(motion, nonlinear[0]),), _BOUC_WEN_STEP),
    "bouc_wen_general": (
        lambda motion, nonlinear: (bouc_wen_general(motion, *nonlinear),),
        _BOUC_WEN_GENERAL_STEP,
    ),
}
"""States in closed form, and in C where the solver's step is less exact."""

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


def _samples_late(parameters, sampling_time):
    """Whole samples and the share of one that is left over."""
    samples = parameters["delay"] / sampling_time
    whole = math.floor(samples)
    return {"whole": float(whole), "share": samples - whole}


_BY_HAND = {
    "elastoplastic": HandWritten(
        columns=lambda motion, nonlinear: [elastoplastic(motion, nonlinear[0])],
        c_step=CStep(
            "friction_limit * ((position - next[0]) / presliding_distance)",
            "next[0] = behind_gap(memory[0], position, presliding_distance, first);  // the slider",
            memory=1,
        ),
    ),
    "iwan": HandWritten(
        columns=lambda motion, nonlinear: [
            elastoplastic(motion, nonlinear[0] / 2**order) for order in range(_ELEMENTS)
        ],
        c_step=CStep(_IWAN_FORCE, _IWAN_STEP, memory=_ELEMENTS),
    ),
    "play": HandWritten(
        input_transform=lambda motion, nonlinear: motion.through(partial(play, gap=nonlinear[0])),
        c_step=CStep("next[0]", "next[0] = behind_gap(memory[0], position, half_gap, first);", memory=1),
    ),
    "delay": HandWritten(
        input_transform=lambda motion, nonlinear: motion.delayed(nonlinear[0]),
        c_step=CStep(
            "newer + share * (older - newer)",
            "double newer = earlier(now, ring, (int)whole), older = earlier(now, ring, (int)whole + 1);",
            constants=_samples_late,
            history=lambda numbers: int(numbers["whole"]) + 1,
        ),
    ),
}


def _grasp_and_release(motion, residual):
    times = interval_starts(motion, residual, [motion.acceleration, np.sin(motion.position)])
    return [np.array([distance, *pair]) for pair in times for distance in (0.25, 0.75)]


_STARTS = {
    "strongest_lines": strongest_lines,
    "grasp_and_release": _grasp_and_release,
    "oscillating_length": lambda motion, residual: modulation_starts(
        motion, residual, [np.sin(motion.position), motion.acceleration]
    ),
    "swaying_pivot": lambda motion, residual: modulation_starts(motion, residual, [np.cos(motion.position)]),
    "heaving_pivot": lambda motion, residual: modulation_starts(motion, residual, [np.sin(motion.position)]),
}

_BEYOND = 0.01
"""Share of the samples that may lie beyond a limit."""
_FEWEST_CYCLES = 2.0
_APART = 0.5
"""Lines (1/duration) by which a disturbance must keep away from the excitation's own."""


def _above_limit(values, motion, force, noise, period) -> str:
    share = float(np.mean(np.abs(force) > 1.02 * values["limit"] + 3 * noise))
    return f"{100 * share:.1f} % of the samples lie above its limit" if share > _BEYOND else ""


def _below_adhesion(values, motion, force, noise, period) -> str:
    share = float(np.mean(force < -1.02 * values["limit"] - 3 * noise))
    return f"{100 * share:.1f} % of the samples pull more than its limit" if share > _BEYOND else ""


def _no_disturbance(values, motion, force, noise, period) -> str:
    """Fewer than two cycles are a drift; a line of the excitation's own grid is the model's error."""
    frequency, duration = values["frequency"], float(motion.time[-1])
    if frequency * duration < _FEWEST_CYCLES:
        return f"its record holds {frequency * duration:.1f} cycles of it"
    if period and abs(frequency * period - round(frequency * period)) < _APART * period / duration:
        return "it repeats with the excitation"
    return ""


_CONTRADICTIONS = {
    "above_limit": _above_limit,
    "below_adhesion": _below_adhesion,
    "no_disturbance": _no_disturbance,
}
HOOKS: Mapping[str, Mapping[str, Any]] = {
    "solution": _SOLUTIONS,
    "by_hand": _BY_HAND,
    "starts": _STARTS,
    "contradiction": _CONTRADICTIONS,
}
"""By key of a form in YAML and name."""
