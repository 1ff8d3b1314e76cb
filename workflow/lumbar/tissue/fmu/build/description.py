"""modelDescription.xml of FMI 2.0 and 3.0, and what an FMU says of itself in words: data, valid range, guards."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

import numpy as np

from lumbar import __version__
from lumbar.base.templates import template
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.guards import LARGEST
from lumbar.tissue.fmu.build.sources import C_FILES, content_token
from lumbar.tissue.fmu.conventions import ANNOTATION, PUSH, RATE_LIMIT, base_unit, slow_push

if TYPE_CHECKING:
    from markupsafe import Markup


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


FMI_VERSIONS = ("2.0", "3.0")
AUTHOR = "The lumbar developers"


@dataclass(frozen=True)
class Variable:
    """A variable of the FMU."""

    name: str
    reference: int
    """Value reference, as in ``sampled_force.h``."""
    kind: str
    """``"input"``, ``"output"`` or ``"parameter"``."""
    description: str
    unit: str
    start: float | None
    """None for the output: it is calculated."""
    low: float | None = None
    high: float | None = None
    nominal: float | None = None


def variables(model: ExportModel) -> list[Variable]:
    """Return the variables that a user sees, the same in both versions."""
    x, y, limit = model.input, model.output, model.output_limit
    force, within = y.quantity.capitalize(), (-limit, limit, limit)
    sampled = f"Measured {x.quantity}, sampled by the model; it grows into the model"
    factor = f"Factor on the model's {y.quantity}, at any time: 0 is off; documentation/index.html says what a rise does"
    largest = f"Largest magnitude of the {y.quantity}; it can be lowered, not raised"
    at_rest = f"{x.quantity.capitalize()} at which the model is at rest"
    return [
        Variable(x.variable, 1, "input", sampled, x.unit, x.offset),
        Variable(y.variable, 2, "output", f"{force} of the model; {_resists(model)}", y.unit, None, *within),
        Variable("gain", 3, "parameter", factor, "", 1.0, 0.0, model.gain_limit, 1.0),
        Variable(f"{y.variable}_offset", 4, "parameter", f"{force} at rest", y.unit, y.offset, *within),
        Variable(f"{y.variable}_limit", 5, "parameter", largest, y.unit, limit, 0.0, limit, limit),
        Variable(f"{x.variable}_offset", 6, "parameter", at_rest, x.unit, x.offset),
        *_guards(model),
    ]


def _guards(model: ExportModel) -> list[Variable]:
    """Variables of the guards that the model has."""
    guards, y = model.guards, model.output
    steepest, damped, most = guards.rate_limit, guards.device_damping, guards.energy_reserve
    change = f"Largest change of the {y.quantity} in a second; it can be lowered, not raised"
    surely = (
        "Damping that the device surely has at the tool: with less of it the FMU bounds the "
        f"{y.quantity} more; 0 lets none through"
    )
    counted = "Most energy that counts as taken in: what is dissipated early is not kept for ever"
    taken = (
        "Energy that model and device damping have taken in up to the last sample, less what rises of the gain take of it; "
        "negative only where device_damping was lowered on the way"
    )
    rate = Variable(
        y.variable + RATE_LIMIT, 7, "parameter", change, f"{y.unit}/s", steepest, 0.0, steepest, steepest
    )
    passive = [
        Variable("device_damping", 8, "parameter", surely, model.damping_unit, damped, 0.0, LARGEST, 1.0),
        Variable("energy_reserve", 9, "parameter", counted, "J", most, 0.0, LARGEST, 1.0),
        Variable("energy", 10, "output", taken, "J", None, nominal=1.0),
    ]
    return [rate] * (steepest > 0) + passive * guards.passive


def _resists(model: ExportModel) -> str:
    if model.resisting_sign > 0:
        return f"where positive it resists a growing {model.input.quantity}"
    return f"INVERTED: where negative it answers a growing {model.input.quantity}"


# The input is sampled: importers apply a discrete input at the events that take the samples, a continuous one only
# between them, which gives each sample the position of the one before.
_ROLES = {
    "input": {"causality": "input", "variability": "discrete"},
    "output": {"causality": "output", "variability": "discrete", "initial": "calculated"},
    "parameter": {"causality": "parameter", "variability": "tunable", "initial": "exact"},
}


def model_description(model: ExportModel, version: str, data: str) -> str:
    """Return modelDescription.xml."""
    listed = variables(model)
    told = meaning(model)
    words = (
        description_text(model, data),
        sign_text(model),
        range_text(model),
        feedthrough_text(model, version),
    )
    return template(f"tissue/fmu/build/modelDescription_fmi{version[0]}.xml.jinja").render(
        model=model,
        description=_escaped(" ".join((*words, *guards_text(model)))),
        author=AUTHOR,
        tool_version=__version__,
        model_version=model_version(model),
        token=content_token(model),
        files=C_FILES,
        annotation=ANNOTATION,
        meaning={key: str(value).lower() for key, value in told.items()},
        meaning_json=_escaped(json.dumps(told), attribute=False),
        base_unit=base_unit,
        units_of_variables=list(dict.fromkeys(variable.unit for variable in listed if variable.unit)),
        variables=[_described(variable, number) for number, variable in enumerate(listed, start=1)],
        outputs=_unknowns(model, initial=False),
        initial_unknowns=_unknowns(model, initial=True),
    )


def _escaped(text: str, attribute: bool = True) -> Markup:
    """Text for XML, with no more escaped than XML asks for."""
    from markupsafe import Markup

    return Markup(escape(text, {'"': "&quot;"} if attribute else {}))


def _described(variable: Variable, index: int) -> dict:
    """What the descriptions say of a variable; FMI 2.0 refers to it by its index, FMI 3.0 by its value reference."""
    given = {"min": variable.low, "max": variable.high, "nominal": variable.nominal, "start": variable.start}
    unit = {"unit": variable.unit} if variable.unit else {}
    return {
        "name": variable.name,
        "reference": variable.reference,
        "index": index,
        "description": _escaped(variable.description),
        "role": _ROLES[variable.kind],
        "attributes": {
            **unit,
            **{key: repr(float(value)) for key, value in given.items() if value is not None},
        },
    }


def _unknowns(model: ExportModel, initial: bool) -> list[dict]:
    """Outputs with the variables that they depend on at a sample instant, or at the first one."""
    listed = [_described(variable, number) for number, variable in enumerate(variables(model), start=1)]
    named = {variable["name"]: variable for variable in listed}
    names = [name for name, variable in named.items() if variable["role"] is _ROLES["parameter"]]
    if model.feedthrough or (initial and model.starts_at_rest):
        names = [model.input.variable, *names]
    else:
        # Without feed-through the input's offset acts through the states alone.
        names.remove(f"{model.input.variable}_offset")
    # The energy is that of the last sample taken.
    dependencies = {model.output.variable: [named[name] for name in names]}
    outputs = [variable for variable in listed if variable["role"] is _ROLES["output"]]
    return [{**variable, "dependencies": dependencies.get(variable["name"], [])} for variable in outputs]


def model_version(model: ExportModel) -> str:
    """Version of the tool and, behind a plus, of the model: another number anywhere makes another one."""
    return f"{__version__}+{content_token(model)[:8]}"
