"""Effects of the way from position to tissue and from tissue to sensor: play, delay, lost contact, clipping."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from lumbar.tissue.models.c_step import CStep
from lumbar.tissue.models.form import Effect, Form, HandWritten, Place
from lumbar.tissue.models.operators import play
from lumbar.tissue.models.parameter import NonlinearParameter

BACKLASH = Effect(
    name="backlash",
    mechanism="Play in the tool mount: the position reaches the tissue through a gap.",
    source="Nordin and Gutman, Automatica 38 (2002) 1633-1649",
    experiment="reverse with strokes smaller than the gap: the force then rests",
    forms=(
        Form(
            name="play",
            equation=r"z \to \mathrm{play}_g(z)",
            place=Place.INPUT,
            nonlinear=(
                NonlinearParameter(
                    "half_gap", "{x}", "position", 0.005, 0.5, 9, reach=(0.2, 1.6), symbol="g", decisive=True
                ),
            ),
            hand_written=HandWritten(
                input_transform=lambda motion, nonlinear: motion.through(partial(play, gap=nonlinear[0])),
                c_step=CStep(
                    "next[0]", "next[0] = behind_gap(memory[0], position, half_gap, first);", memory=1
                ),
            ),
        ),
    ),
)


def _samples_late(parameters, sampling_time):
    """Whole samples and the share of one that is left over."""
    samples = parameters["delay"] / sampling_time
    whole = math.floor(samples)
    return {"whole": float(whole), "share": samples - whole}


_DELAY_STEP = "double newer = earlier(now, ring, (int)whole), older = earlier(now, ring, (int)whole + 1);"

DELAY = Effect(
    name="delay",
    mechanism="The force comes late: transport or processing time between position and force.",
    source="Ljung, System Identification (1999), section 4.2",
    experiment="excite at higher frequencies: a delay turns the phase in proportion to frequency, at equal gain",
    linear=True,
    forms=(
        Form(
            name="pure",
            equation=r"F(t) \to F(t - T_d)",
            place=Place.INPUT,
            nonlinear=(
                NonlinearParameter(
                    "delay", "s", "sampling", 0.05, 5.0, 6, reach=(0.05, 10.0), symbol="Td", decisive=True
                ),
            ),
            hand_written=HandWritten(
                input_transform=lambda motion, nonlinear: motion.delayed(nonlinear[0]),
                c_step=CStep(
                    "newer + share * (older - newer)",
                    _DELAY_STEP,
                    constants=_samples_late,
                    history=lambda numbers: int(numbers["whole"]) + 1,
                ),
            ),
        ),
    ),
)


_BEYOND = 0.01
"""Share of the samples that may lie beyond a limit."""


def _above_limit(values, motion, force, noise, period) -> str:
    share = float(np.mean(np.abs(force) > 1.02 * values["limit"] + 3 * noise))
    return f"{100 * share:.1f} % of the samples lie above its limit" if share > _BEYOND else ""


def _below_adhesion(values, motion, force, noise, period) -> str:
    share = float(np.mean(force < -1.02 * values["limit"] - 3 * noise))
    return f"{100 * share:.1f} % of the samples pull more than its limit" if share > _BEYOND else ""


_ADHESION = NonlinearParameter("limit", "{y}", "force", 0.3, 1.0, 8, reach=(0.05, 1.6), symbol="F0")

CONTACT_LOSS = Effect(
    name="contact_loss",
    mechanism="The tool leaves the tissue: the force cannot fall below the adhesion.",
    source="Johnson, Contact Mechanics (1985), chapter 5",
    experiment="move about a greater mean depth: a contact that is never left shows no loss",
    forms=(
        Form(
            name="sharp",
            equation="max(F, -F0)",
            place=Place.OUTPUT,
            contradiction=_below_adhesion,
            nonlinear=(_ADHESION,),
        ),
        Form(
            name="soft",
            equation="w*softplus((F + F0)/w) - F0",
            place=Place.OUTPUT,
            contradiction=_below_adhesion,
            nonlinear=(
                _ADHESION,
                NonlinearParameter(
                    "corner_width", "{y}", "force", 0.02, 0.2, 2, reach=(0.1, 4.0), symbol="w"
                ),
            ),
        ),
    ),
)

SATURATION = Effect(
    name="saturation",
    mechanism="The force channel clips.",
    source="range of the force sensor and its amplifier",
    experiment="halve the amplitude: a channel that no longer clips shows no loss",
    forms=(
        Form(
            name="sharp",
            equation="clip(F, -Fs, Fs)",
            place=Place.OUTPUT,
            contradiction=_above_limit,
            nonlinear=(
                NonlinearParameter("limit", "{y}", "force", 0.3, 1.0, 8, reach=(0.05, 1.6), symbol="Fs"),
            ),
        ),
        Form(
            name="soft",
            equation="Fs*tanh(F/Fs)",
            place=Place.OUTPUT,
            contradiction=_above_limit,
            nonlinear=(
                NonlinearParameter("limit", "{y}", "force", 0.6, 4.0, 6, reach=(0.4, 3.0), symbol="Fs"),
            ),
        ),
        Form(
            # F (1 + |F/Fs|^p)^(-1/p), in the smaller of the ratio and its inverse: a high power of a large number overflows.
            name="rounded",
            equation="clip(F, -Fs, Fs)/(1 + (min(abs(F), Fs)/max(abs(F), Fs))**p)**(1/p)",
            place=Place.OUTPUT,
            contradiction=_above_limit,
            nonlinear=(
                NonlinearParameter("limit", "{y}", "force", 0.6, 1.5, 4, reach=(0.4, 3.0), symbol="Fs"),
                NonlinearParameter("sharpness", "1", "one", 3.0, 10.0, 2, reach=(0.5, 2.0), symbol="p"),
            ),
        ),
    ),
)

EFFECTS = (BACKLASH, DELAY, CONTACT_LOSS, SATURATION)
