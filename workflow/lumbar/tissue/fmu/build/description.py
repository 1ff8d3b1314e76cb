"""modelDescription.xml of FMI 2.0 and 3.0."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from xml.sax.saxutils import escape

from markupsafe import Markup

from lumbar import __version__
from lumbar.base.templates import template
from lumbar.tissue.fmu.build.documentation import feedthrough_text, guard_texts, range_text, sign_text
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.guards import LARGEST
from lumbar.tissue.fmu.build.sources import AUTHOR, C_FILES, content_token, model_version
from lumbar.tissue.fmu.conventions import ANNOTATION, ELEMENT, RATE_LIMIT, base_unit, element_names

FMI_VERSIONS = ("2.0", "3.0")


@dataclass(frozen=True)
class Variable:
    """A variable of the FMU."""

    name: str
    reference: int
    """Value reference; the same as in ``sampled_force.h``."""
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
        """Its values as separate variables, as in FMI 2.0."""
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


def variables(model: ExportModel) -> list[Variable]:
    """Return the variables that a user sees, the same in both versions except for vectors."""
    x, y, limit, guards = model.input, model.output, model.output_limit, model.guards
    within, steepest = (-limit, limit, limit), guards.rate_limit
    rest, size = model.rest.tolist() if model.axes else model.rest, len(model.axes) or 1
    output = y.quantity.capitalize()
    resists = (
        "where positive it resists" if model.resisting_sign > 0 else "INVERTED: where negative it answers"
    )
    position = f"Measured {x.quantity}, sampled by the model; it grows into the model"
    force = f"{output} of the model; {resists} a growing {x.quantity}"
    gain = f"Factor on the model's {y.quantity}, at any time: 0 is off; documentation/index.html says what a rise does"
    largest = f"Largest magnitude of the {y.quantity}; it can be lowered, not raised"
    offset = f"{x.quantity.capitalize()} at which the model is at rest"
    listed = [
        Variable(x.variable, 1, "input", position, x.unit, rest, size=size),
        Variable(y.variable, 2, "output", force, y.unit, None, *within, size=size),
        Variable("gain", 3, "parameter", gain, "", 1.0, 0.0, model.gain_limit, 1.0),
        Variable(
            f"{y.variable}_offset", 4, "parameter", f"{output} at rest", y.unit, y.offset, *within, size=size
        ),
        Variable(f"{y.variable}_limit", 5, "parameter", largest, y.unit, limit, 0.0, limit, limit),
        Variable(f"{x.variable}_offset", 6, "parameter", offset, x.unit, rest, size=size),
    ]
    if steepest > 0:
        name, text = (
            y.variable + RATE_LIMIT,
            f"Largest change of the {y.quantity} in a second; it can be lowered, not raised",
        )
        listed.append(Variable(name, 7, "parameter", text, f"{y.unit}/s", steepest, 0.0, steepest, steepest))
    if guards.passive:
        damping = (
            f"Damping that the device surely has at the tool: with less of it the FMU bounds the {y.quantity} more; 0 lets none "
            "through"
        )
        reserve = "Most energy that counts as taken in: what is dissipated early is not kept for ever"
        energy = (
            "Energy that model and device damping have taken in up to the last sample, less what rises of the gain take of it; "
            "negative only where device_damping was lowered on the way"
        )
        given = model.units.damping, guards.device_damping, 0.0, LARGEST, 1.0
        listed += [
            Variable("device_damping", 8, "parameter", damping, *given),
            Variable(
                "energy_reserve", 9, "parameter", reserve, "J", guards.energy_reserve, 0.0, LARGEST, 1.0
            ),
            Variable("energy", 10, "output", energy, "J", None, nominal=1.0),
        ]
    return listed


# The input is sampled: importers apply a discrete input at the events that take the samples, a continuous one only
# between them, which gives each sample the position of the one before.
_ROLES = {
    "input": {"causality": "input", "variability": "discrete"},
    "output": {"causality": "output", "variability": "discrete", "initial": "calculated"},
    "parameter": {"causality": "parameter", "variability": "tunable", "initial": "exact"},
}


def model_description(model: ExportModel, version: str, source_label: str) -> str:
    """Return modelDescription.xml."""
    listed = variables(model)
    if version == "2.0":
        listed = [element for variable in listed for element in variable.elements]
    stability = "" if model.stable else " UNSTABLE: the output runs into its limit."
    texts = (
        f"{model.input.quantity.capitalize()} to {model.output.quantity} model {model.name}, discrete at "
        f"{model.sampling_time:g} s. Data: {source_label}.{stability}{model.runtime and ' ' + model.runtime}",
        sign_text(model),
        range_text(model),
        feedthrough_text(model, version),
        *guard_texts(model),
    )
    # The same for programs, as an annotation: without a unit and the range if the range is not known.
    known = {} if model.valid_for is None else {"unit": model.input.unit, **asdict(model.valid_for)}
    meaning = {
        "push": f"growing {model.input.variable}",
        "resisting_sign": model.resisting_sign,
        "prescribed": model.prescribed,
        **known,
    }
    return template(f"tissue/fmu/build/modelDescription_fmi{version[0]}.xml.jinja").render(
        model=model,
        description=_escaped(" ".join(texts)),
        author=AUTHOR,
        tool_version=__version__,
        model_version=model_version(model),
        token=content_token(model),
        files=C_FILES,
        annotation=ANNOTATION,
        meaning={key: str(value).lower() for key, value in meaning.items()},
        meaning_json=_escaped(json.dumps(meaning), attribute=False),
        base_unit=base_unit,
        units_of_variables=list(dict.fromkeys(variable.unit for variable in listed if variable.unit)),
        variables=[_described(variable, number) for number, variable in enumerate(listed, start=1)],
        outputs=_unknowns(model, listed, initial=False),
        initial_unknowns=_unknowns(model, listed, initial=True),
    )


def _escaped(text: str, attribute: bool = True) -> Markup:
    """Return text for XML in which only what XML requires is escaped."""
    return Markup(escape(text, {'"': "&quot;"} if attribute else {}))


_GIVEN = {"min": "low", "max": "high", "nominal": "nominal"}


def _described(variable: Variable, index: int) -> dict:
    """Return a variable for the templates; FMI 2.0 refers to it by its index, FMI 3.0 by its value reference."""
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
    """Return the outputs with the variables that they depend on at a sample instant, or at the first one."""
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
