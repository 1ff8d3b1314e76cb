"""modelDescription.xml of FMI 2.0 and 3.0."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

from lumbar import __version__
from lumbar.base.templates import template
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.guards import LARGEST
from lumbar.tissue.fmu.build.meaning import (
    description_text,
    feedthrough_text,
    guards_text,
    meaning,
    range_text,
    sign_text,
)
from lumbar.tissue.fmu.build.sources import C_FILES, content_token
from lumbar.tissue.fmu.conventions import ANNOTATION, RATE_LIMIT, base_unit

if TYPE_CHECKING:
    from markupsafe import Markup

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
