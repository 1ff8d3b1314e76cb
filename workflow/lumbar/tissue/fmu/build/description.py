"""modelDescription.xml of FMI 2.0 and 3.0, and what an FMU says of itself in words: data, valid range, guards."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from xml.sax.saxutils import escape

import numpy as np
from markupsafe import Markup

from lumbar import __version__
from lumbar.base.templates import template
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.guards import LARGEST
from lumbar.tissue.fmu.build.sources import C_FILES, content_token
from lumbar.tissue.fmu.conventions import (
    ANNOTATION,
    ELEMENT,
    RATE_LIMIT,
    base_unit,
    element_names,
    slow_push,
)


def sentence(name: str, model: ExportModel, **known) -> str:
    """Return a macro of ``description.txt.jinja`` for a model, as one line."""
    macro = getattr(template("tissue/fmu/build/description.txt.jinja").module, name)
    return " ".join(macro(model, **known).split())


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


def description_text(model: ExportModel, source_label: str) -> str:
    """One line on the model for the model description."""
    stability = "" if model.stable else " UNSTABLE: the output runs into its limit."
    return (
        f"{model.input.quantity.capitalize()} to {model.output.quantity} model {model.name}, "
        f"discrete at {model.sampling_time:g} s. Data: {source_label}.{stability}{model.runtime and ' ' + model.runtime}"
    )


def guards_text(model: ExportModel) -> list[str]:
    """Say what is done to the force before the device receives it, a sentence or two for each guard."""
    guards = model.guards
    there = {"contact": guards.contact, "rate": guards.rate_limit > 0, "passive": guards.passive}
    space = [sentence("space", model)] if model.axes else []
    return [*space, *(sentence(f"{name}_guard", model) for name, guard in there.items() if guard)]


def switched_on(model: ExportModel) -> tuple[float, float, float] | None:
    """Return the deepest position of the data, the force that comes with the gain there, and what it gives on the way out, in J.

    None where the range is not known, begins deeper than it ends, or the way out gives nothing.
    """
    deepest = 0.0 if model.valid_for is None else model.valid_for.highest - model.input.offset
    if model.work_units is None or model.axes or not deepest > 0:
        return None
    way = deepest * slow_push(model.sampling_time)
    forces = model.dynamics.response(np.concatenate([way, way[::-1]]))[len(way) :]
    forces = np.clip(forces, -model.output_limit, model.output_limit)
    steps = np.diff(way[::-1]) * model.input_unit
    energy = -model.resistance * model.output_unit * float(forces[:-1] @ steps)
    return (model.valid_for.highest, float(forces[0]), energy) if energy > 0 else None  # type: ignore[union-attr]


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
    start: float | Sequence[float] | None
    """One for every axis, or the same for all; None for the output: it is calculated."""
    low: float | None = None
    high: float | None = None
    nominal: float | None = None
    size: int = 1
    """Values: one, or one for every axis."""

    @property
    def elements(self) -> "list[Variable]":
        """Its values as variables of their own, as FMI 2.0 has them."""
        if self.size == 1:
            return [self]
        names = enumerate(zip(element_names(self.name, self.size), self.starts, strict=True))
        return [
            replace(self, name=name, reference=self.reference + ELEMENT * row, start=start, size=1)
            for row, (name, start) in names
        ]

    @property
    def starts(self) -> list:
        """Start values, one of each element."""
        alike = self.start is None or isinstance(self.start, float | int)
        return [self.start] * self.size if alike else list(self.start)  # type: ignore[arg-type]


_VECTORS = (1, 2, 4, 6)
"""Variables that have a value for every axis, by their numbers."""


def variables(model: ExportModel) -> list[Variable]:
    """Return the variables that a user sees, the same in both versions but for vectors."""
    x, y, limit, guards = model.input, model.output, model.output_limit, model.guards
    within, steepest = (-limit, limit, limit), guards.rate_limit
    rest = model.rest.tolist() if model.axes else model.rest
    change = f"{y.unit}/s", steepest, 0.0, steepest, steepest
    damping = model.damping_unit, guards.device_damping, 0.0, LARGEST, 1.0
    listed = [
        (x.variable, 1, "input", x.unit, rest),
        (y.variable, 2, "output", y.unit, None, *within),
        ("gain", 3, "parameter", "", 1.0, 0.0, model.gain_limit, 1.0),
        (f"{y.variable}_offset", 4, "parameter", y.unit, y.offset, *within),
        (f"{y.variable}_limit", 5, "parameter", y.unit, limit, 0.0, limit, limit),
        (f"{x.variable}_offset", 6, "parameter", x.unit, rest),
        *[(y.variable + RATE_LIMIT, 7, "parameter", *change)] * (steepest > 0),
        *[
            ("device_damping", 8, "parameter", *damping),
            ("energy_reserve", 9, "parameter", "J", guards.energy_reserve, 0.0, LARGEST, 1.0),
            ("energy", 10, "output", "J", None, None, None, 1.0),
        ]
        * guards.passive,
    ]
    return [
        Variable(
            name,
            number,
            kind,
            sentence("variable", model, number=number),
            *values,
            size=len(model.axes) or 1 if number in _VECTORS else 1,
        )
        for name, number, kind, *values in listed
    ]


# The input is sampled: importers apply a discrete input at the events that take the samples, a continuous one only
# between them, which gives each sample the position of the one before.
_ROLES = {
    "input": {"causality": "input", "variability": "discrete"},
    "output": {"causality": "output", "variability": "discrete", "initial": "calculated"},
    "parameter": {"causality": "parameter", "variability": "tunable", "initial": "exact"},
}


def model_description(model: ExportModel, version: str, source_label: str) -> str:
    """Return modelDescription.xml."""
    listed = _listed(model, version)
    told = meaning(model)
    words = (
        description_text(model, source_label),
        sentence("sign", model),
        sentence("range", model),
        sentence("feedthrough", model, version=version),
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
        outputs=_unknowns(model, listed, initial=False),
        initial_unknowns=_unknowns(model, listed, initial=True),
    )


def _listed(model: ExportModel, version: str) -> list[Variable]:
    found = variables(model)
    return found if version == "3.0" else [element for variable in found for element in variable.elements]


def _escaped(text: str, attribute: bool = True) -> Markup:
    """Text for XML, with no more escaped than XML asks for."""
    return Markup(escape(text, {'"': "&quot;"} if attribute else {}))


_GIVEN = {"min": "low", "max": "high", "nominal": "nominal"}


def _described(variable: Variable, index: int) -> dict:
    """What the descriptions say of a variable; FMI 2.0 refers to it by its index, FMI 3.0 by its value reference."""
    given = {key: [getattr(variable, name)] for key, name in _GIVEN.items()} | {"start": variable.starts}
    unit = {"unit": variable.unit} if variable.unit else {}
    return {
        "name": variable.name,
        "reference": variable.reference,
        "index": index,
        "description": _escaped(variable.description),
        "role": _ROLES[variable.kind],
        "size": variable.size,
        "attributes": {
            **unit,
            **{
                key: " ".join(repr(float(value)) for value in values)
                for key, values in given.items()
                if None not in values
            },
        },
    }


def _unknowns(model: ExportModel, listed: list[Variable], initial: bool) -> list[dict]:
    """Outputs with the variables that they depend on at a sample instant, or at the first one."""
    described = [(item, _described(item, number)) for number, item in enumerate(listed, start=1)]
    acting = {item.reference for item in listed if item.kind == "parameter"}
    if model.feedthrough or (initial and model.starts_at_rest):
        acting |= {item.reference for item in listed if item.kind == "input"}
    else:
        # Without feed-through the input's offset acts through the states alone.
        acting -= {6}
    # The energy is that of the last sample taken.
    dependencies = [given for item, given in described if item.reference in acting]
    return [
        {**given, "dependencies": dependencies if item.reference % ELEMENT == 2 else []}
        for item, given in described
        if item.kind == "output"
    ]


def model_version(model: ExportModel) -> str:
    """Version of the tool and, behind a plus, of the model: another number anywhere makes another one."""
    return f"{__version__}+{content_token(model)[:8]}"
