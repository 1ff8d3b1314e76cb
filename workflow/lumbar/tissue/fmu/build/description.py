"""modelDescription.xml of FMI 2.0 and 3.0."""

import json
from dataclasses import asdict
from xml.sax.saxutils import escape

from markupsafe import Markup

from lumbar import __version__
from lumbar.base.templates import template
from lumbar.tissue.fmu.build.documentation import feedthrough_text, guard_texts, range_text, sign_text
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.sources import AUTHOR, C_FILES, content_token, model_version
from lumbar.tissue.fmu.conventions import ANNOTATION, ELEMENT, base_unit, element_names

FMI_VERSIONS = ("2.0", "3.0")
_MAX_GUARD = 1e3
"""Upper limit of device damping in N·s/m and of the energy reserve in J, as in ``sampled_force.c``."""
# The input is sampled: importers apply a discrete input at the events that take the samples, a continuous one only
# between them, which gives each sample the position of the one before.
_ROLES = {
    "input": {"causality": "input", "variability": "discrete"},
    "output": {"causality": "output", "variability": "discrete", "initial": "calculated"},
    "parameter": {"causality": "parameter", "variability": "tunable", "initial": "exact"},
}


def _variables(model: ExportModel, version: str) -> list[dict]:
    """Return the variables that a user sees, as data for the templates; in FMI 2.0 a vector becomes one variable per axis."""
    x, y, guards, size = model.input, model.output, model.guards, len(model.axes) or 1
    rest, output = model.rest.tolist() if model.axes else [model.rest], y.quantity.capitalize()
    resists = (
        "where positive it resists" if model.resisting_sign > 0 else "INVERTED: where negative it answers"
    )
    position = f"Measured {x.quantity}, sampled by the model; it grows into the model"
    force = f"{output} of the model; {resists} a growing {x.quantity}"
    gain = f"Factor on the model's {y.quantity}, at any time: 0 is off; documentation/index.html says what a rise does"
    largest = f"Largest magnitude of the {y.quantity}; it can be lowered, not raised"
    offset = f"{x.quantity.capitalize()} at which the model is at rest"

    def up_to(high: float, nominal: float) -> dict[str, float]:
        return {"min": 0.0, "max": high, "nominal": nominal}

    limit = model.output_limit
    within = {**up_to(limit, limit), "min": -limit}
    # Value reference (as in sampled_force.h), kind, name, description, unit, start values, bounds.
    rows = [
        (1, "input", x.variable, position, x.unit, rest, {}),
        (2, "output", y.variable, force, y.unit, [None] * size, within),
        (3, "parameter", "gain", gain, "", [1.0], up_to(model.settings.gain_limit, 1.0)),
        (4, "parameter", f"{y.variable}_offset", f"{output} at rest", y.unit, [y.offset] * size, within),
        (5, "parameter", f"{y.variable}_limit", largest, y.unit, [limit], up_to(limit, limit)),
        (6, "parameter", f"{x.variable}_offset", offset, x.unit, rest, {}),
    ]
    if guards.rate_limit > 0:
        name, rate = f"{y.variable}_rate_limit", guards.rate_limit
        text = f"Largest change of the {y.quantity} in a second; it can be lowered, not raised"
        rows.append((7, "parameter", name, text, f"{y.unit}/s", [rate], up_to(rate, rate)))
    if guards.passive:
        damping = (
            f"Least damping of the device at the tool: with less of it the FMU bounds the {y.quantity} more; 0 lets none "
            "through"
        )
        reserve = "Most energy that counts as taken in: what is dissipated early is not kept for ever"
        energy = (
            "Energy that model and device damping have taken in up to the last sample, less what rises of the gain take of it; "
            "negative only where device_damping was lowered on the way"
        )
        bounds = up_to(_MAX_GUARD, 1.0)
        rows += [
            (8, "parameter", "device_damping", damping, model.units.damping, [guards.device_damping], bounds),
            (9, "parameter", "energy_reserve", reserve, "J", [guards.energy_reserve], bounds),
            (10, "output", "energy", energy, "J", [None], {"nominal": 1.0}),
        ]
    listed: list[dict] = []
    for reference, kind, name, description, unit, starts, bounds in rows:
        elements = [(name, reference, starts)]
        if version == "2.0" and len(starts) > 1:
            names = enumerate(zip(element_names(name, size), starts, strict=True))
            elements = [(element, reference + ELEMENT * row, [start]) for row, (element, start) in names]
        for element, element_reference, values in elements:
            attributes = {"unit": unit} if unit else {}
            attributes |= {key: repr(float(value)) for key, value in bounds.items()}
            if None not in values:
                attributes["start"] = " ".join(repr(float(value)) for value in values)
            listed.append(
                {
                    "name": element,
                    "reference": element_reference,
                    "index": len(listed) + 1,
                    "description": _escape(description),
                    "kind": kind,
                    "role": _ROLES[kind],
                    "size": len(values),
                    "attributes": attributes,
                }
            )
    return listed


def model_description(model: ExportModel, version: str, source_label: str) -> str:
    """Return modelDescription.xml of one of `FMI_VERSIONS`."""
    listed = _variables(model, version)

    def unknowns(initial: bool) -> list[dict]:
        """Return the outputs, each with the variables that it depends on at a sample instant, or at the start if `initial`."""
        has_input = model.feedthrough or (initial and model.starts_at_rest)
        # Without feed-through the input's offset, 6, acts through the states only.
        acting = [
            item
            for item in listed
            if (item["kind"] == "parameter" and (has_input or item["reference"] != 6))
            or (item["kind"] == "input" and has_input)
        ]
        # The energy is that of the last sample, without dependencies.
        return [
            {**item, "dependencies": acting if item["reference"] % ELEMENT == 2 else []}
            for item in listed
            if item["kind"] == "output"
        ]

    units = (item["attributes"].get("unit") for item in listed)
    stability = "" if model.stable else " UNSTABLE: the output runs into its limit."
    texts = (
        f"{model.input.quantity.capitalize()} to {model.output.quantity} model {model.name}, discrete at "
        f"{model.sampling_time:g} s. Data: {source_label}.{stability}{model.runtime and ' ' + model.runtime}",
        sign_text(model),
        range_text(model),
        feedthrough_text(model, version),
        *guard_texts(model),
    )
    # The same for programs, as an annotation: without unit and range if the range is not known.
    known = {} if model.valid_for is None else {"unit": model.input.unit, **asdict(model.valid_for)}
    meaning = {
        "push": f"growing {model.input.variable}",
        "resisting_sign": model.resisting_sign,
        "prescribed": model.prescribed,
        **known,
    }
    return template(f"tissue/fmu/build/modelDescription_fmi{version[0]}.xml.jinja").render(
        model=model,
        description=_escape(" ".join(texts)),
        author=AUTHOR,
        tool_version=__version__,
        model_version=model_version(model),
        token=content_token(model),
        files=C_FILES,
        annotation=ANNOTATION,
        meaning={key: str(value).lower() for key, value in meaning.items()},
        meaning_json=_escape(json.dumps(meaning), quotes=False),
        base_unit=base_unit,
        units_of_variables=[unit for unit in dict.fromkeys(units) if unit],
        variables=listed,
        outputs=unknowns(initial=False),
        initial_unknowns=unknowns(initial=True),
    )


def _escape(text: str, quotes: bool = True) -> Markup:
    """Return text for XML; escape only the characters that XML requires."""
    return Markup(escape(text, {'"': "&quot;"} if quotes else {}))
