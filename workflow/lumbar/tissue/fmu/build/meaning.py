"""What an FMU says of itself in words: model and data, which way is a push, valid range, guards, feed-through."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.conventions import PUSH, slow_push


def sign_text(model: ExportModel) -> str:
    """One or two sentences on the direction of position and force."""
    x, y = model.input, model.output
    push = f"A growing {x.variable} pushes into the model"
    if model.resisting_sign > 0:
        return (
            f"{push}; a positive {y.variable} resists: on the tool it acts against the direction in which "
            f"{x.variable} grows."
        )
    if model.prescribed:
        why = (
            "INVERTED on purpose, as the inverted linear model of the thesis (section 3.2.3: an inverted force vector and "
            "no dynamic component, made to feel unlike tissue)"
        )
    else:
        why = "INVERTED, as the data it was identified from"
    return (
        f"{why}: a growing {x.variable} gives a negative {y.variable}. Displayed like the {y.variable} of the other models it "
        "draws the tool in; with the other sign it resists."
    )


def range_text(model: ExportModel) -> str:
    """One sentence on the motion that the model was fitted to."""
    if model.valid_for is None:
        known = (
            "prescribed, not fitted to data"
            if model.prescribed
            else "its file does not say what motion it was fitted to"
        )
        return f"Valid range: not known, {known}."
    words = model.valid_for.in_words(model.input.unit)
    return f"Valid range, that of the data it was fitted to: {words}. Beyond it the {model.output.quantity} is a guess."


def rate_text(model: ExportModel) -> str:
    """Sentences on how often to call it."""
    runtime = f"{model.runtime} " if model.runtime else ""
    return (
        f"{runtime}The FMU samples its {model.input.quantity} at {1 / model.sampling_time:g} Hz by its own clock, whatever the "
        f"step of the loop; a faster loop feels each {model.output.quantity} held, a slower one misses samples. "
        "Give it the time that has passed, not one step per call."
    )


def meaning(model: ExportModel) -> dict[str, str | int | float | bool]:
    """Return the same for programs; it stands as an annotation in the model description.

    Without ``unit`` and the numbers of `MotionRange` where the range is not known.
    """
    known = {} if model.valid_for is None else {"unit": model.input.unit, **asdict(model.valid_for)}
    return {
        "push": f"growing {model.input.variable}",
        "resisting_sign": model.resisting_sign,
        "prescribed": model.prescribed,
        **known,
    }


def description_text(model: ExportModel, data: str) -> str:
    """One line on the model for the model description."""
    stability = "" if model.stable else " UNSTABLE: the output runs into its limit."
    return (
        f"{model.input.quantity.capitalize()} to {model.output.quantity} model {model.name}, "
        f"discrete at {model.sampling_time:g} s. Data: {data}.{stability}{model.runtime and ' ' + model.runtime}"
    )


def guards_text(model: ExportModel) -> list[str]:
    """Say what is done to the force before the device receives it, a sentence or two for each guard."""
    y, guards, texts = model.output, model.guards, []
    way = "positive" if model.resistance > 0 else "negative"
    if guards.contact:
        texts.append(
            f"Contact: the tissue cannot pull; {y.variable} is never on the other side than the {way} one, on which it "
            f"resists a growing {model.input.quantity}. The tissue ends at {model.input.variable}_offset: below it the model "
            "rests, so that it is not felt before it is touched again."
        )
    if guards.rate_limit > 0:
        texts.append(
            f"Rate: {y.variable} begins at 0 and changes by at most {y.variable}_rate_limit in a second, "
            f"{guards.rate_limit * model.sampling_time:g} {y.unit} in a sample."
        )
    if guards.passive:
        texts.append(
            f"Passive: {y.variable} stays within the force at which FMU and a device with the damping device_damping cannot "
            "give out more energy than they took in, whatever is done with the device. It gives way where the model alone "
            f"would feed an oscillation; {way} {y.quantity} counts as resisting. The guarantee needs one communication "
            "step per sample, and a device that displays what is read."
        )
    return texts


def gain_text(model: ExportModel) -> str:
    """Say what a change of the gain does while the model runs: switched or scaled as a layer is passed."""
    y = model.output
    if model.guards.passive:
        return (
            f"Gain, off (0) and on: a change acts at the next sample, and the {y.quantity} stays passive whatever is changed and "
            "when. A rise leaves the energy that counts as taken in the share that the old gain has of the new one: a tissue "
            "that is switched on begins with nothing, and is felt as far as the tool then pushes on."
        )
    steps = f"the {y.quantity} steps by the change times the model's"
    if model.guards.rate_limit > 0:
        steps = f"the {y.quantity} goes there at {y.variable}_rate_limit"
    given = switched_on(model)
    size = ""
    if given is not None:
        depth, force, energy = given
        size = (
            f": from 0 to 1 at {depth:.3g} {model.input.unit}, the deepest of its data, after a push of {PUSH:g} s, "
            f"{force:.2g} {y.unit} and, on the way out in the same time, {1000 * energy:.2g} mJ"
        )
    return (
        f"Gain, off (0) and on: on a change {steps}. A rise while the tool is in the tissue can give out energy that nobody put "
        f"in{size}. Nothing here bounds that, and a slow rise can give as much; exported with runtime.device_damping, the file "
        "has an account of energy that does."
    )


def switched_on(model: ExportModel) -> tuple[float, float, float] | None:
    """Return the deepest position of the data, the force that comes with the gain there, and what it gives on the way out, in J.

    None where the range is not known, begins deeper than it ends, or the way out gives nothing.
    """
    deepest = 0.0 if model.valid_for is None else model.valid_for.highest - model.input.offset
    if model.work_units is None or not deepest > 0:
        return None
    way = deepest * slow_push(model.sampling_time)
    forces = model.dynamics.response(np.concatenate([way, way[::-1]]))[len(way) :]
    forces = np.clip(forces, -model.output_limit, model.output_limit)
    steps = np.diff(way[::-1]) * model.input_unit
    energy = -model.resistance * model.output_unit * float(forces[:-1] @ steps)
    return (model.valid_for.highest, float(forces[0]), energy) if energy > 0 else None  # type: ignore[union-attr]


def feedthrough_text(model: ExportModel, version: str) -> str:
    """Say what a client sees of the feed-through, by FMI version."""
    if not model.feedthrough:
        return "The model has no feed-through (D = 0): the output of a sample does not depend on its input."
    if model.waits_for_input:
        return _whole_force_late(version)
    if version == "2.0":
        return (
            "Feed-through: an FMI 2.0 client sets the input of a communication point after it has read the "
            "output there, so that it reads C x[k] + D u[k-1], the feed-through one sample late. "
            "The FMI 3.0 FMU with event mode gives C x[k] + D u[k]."
        )
    return (
        "Feed-through: with event mode the input set at a sample instant acts in the output of the same "
        "instant, C x[k] + D u[k]. Without event mode a client reads C x[k] + D u[k-1], one sample late."
    )


def _whole_force_late(version: str) -> str:
    """Say the same for models whose output needs the input of its own sample: velocities come from it."""
    if version == "2.0":
        return (
            "Feed-through: the force of a sample needs its position, which an FMI 2.0 client sets after it has "
            "read the force there; it reads the force of the sample before. "
            "The FMI 3.0 FMU with event mode gives the force of the same sample."
        )
    return (
        "Feed-through: with event mode the position set at a sample instant acts in the force of the same instant. "
        "Without event mode a client reads the force of the sample before."
    )
