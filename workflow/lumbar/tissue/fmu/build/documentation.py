"""documentation/index.html of an FMU: a short text on direction, equations, timing and where the data come from."""

import numpy as np

from lumbar import __version__
from lumbar.base.templates import template
from lumbar.tissue.fmu.build.description import (
    AUTHOR,
    guards_text,
    model_version,
    sentence,
    switched_on,
)
from lumbar.tissue.fmu.build.effect_model import Term
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.linear_model import LinearModel
from lumbar.tissue.fmu.conventions import PUSH
from lumbar.tissue.models.form import Place


def documentation_html(model: ExportModel, version: str, source_label: str) -> str:
    """Return the text as a page without script and without outside resources."""
    return template("tissue/fmu/build/documentation.html.jinja").render(
        name=model.name,
        version=version,
        paragraphs=[
            f"Data: {source_label}",
            sentence("sign", model),
            sentence("range", model),
            *_equations(model),
            _averaged(model),
            *guards_text(model),
            sentence("gain", model, switched=None if model.guards.passive else switched_on(model), push=PUSH),
            _stability(model),
            f"The model samples its input every {model.sampling_time:g} s from the start time and holds its output in "
            "between. Communication steps of any length are allowed.",
            sentence("rate", model),
            sentence("feedthrough", model, version=version),
            *model.on_device,
            "modelDescription.xml lists the variables with their units and bounds. An importer that plays "
            "resources/reference_input.csv should read resources/reference_output.csv.",
            f"Made by lumbar {__version__}, model version {model_version(model)}. Author of the code: {AUTHOR}; licence: "
            "MIT (licenses/license.txt). The numbers come from the data named above.",
        ],
    )


def _equations(model: ExportModel) -> list[str]:
    """The difference equations of a linear model, or each form of a model with effects with its parameters."""
    if isinstance(model.dynamics, LinearModel):
        equations = model.dynamics.equations()
    else:
        equations = [
            f"{term.form.key} ({_ACTS[term.form.place]}): {_numbers(model, term)}"
            for term in model.dynamics.terms
        ]
    output = model.output.variable
    return [*equations, f"{output} = gain · y[k] + {output}_offset, within ±{output}_limit"]


def _stability(model: ExportModel) -> str:
    pole = f"largest |pole| {model.dynamics.largest_pole:.6g}"
    return (
        f"Stable: {pole}."
        if model.stable
        else f"Unstable: {pole}; the {model.output.quantity} runs into its limit."
    )


def _averaged(model: ExportModel) -> str:
    """What u[k] is, and what it was before the start."""
    x, samples = model.input.variable, model.moving_average
    text = f"u[k] = {x} − {x}_offset"
    if samples > 1:
        milliseconds = 1000 * samples * model.sampling_time
        text = (
            f"u[k] is the mean of the last {samples} samples ({milliseconds:g} ms) of {x} − {x}_offset, the newest "
            "included"
        )
    rest = "has always been where it is" if model.starts_at_rest else "rested at its offset before"
    return f"{text}; at the first sample the {model.input.quantity} counts as one that {rest}."


_ACTS = {
    Place.INPUT: "the position, before it reaches the tissue",
    Place.PARALLEL: "adds to the force",
    Place.OUTPUT: "the sum of the forces",
}


def _numbers(model: ExportModel, term: Term) -> str:
    """Parameters of a form with units, to six digits; of a base in space its matrices, row by row."""
    base = model.dynamics.base
    linear = [(item, f"{value:.6g}") for item, value in zip(term.form.linear, term.linear, strict=True)]
    if base.spatial and term.form.effect == base.form.effect:
        matrices = base.spatial.matrices(*map(np.array, model.dynamics.base_numbers))
        rows = {
            name: "; ".join(" ".join(f"{value:.6g}" for value in row) for row in matrix)
            for name, matrix in matrices.items()
        }
        linear = [(item, rows[item.name]) for item in base.spatial.base.linear]
    nonlinear = zip(term.form.nonlinear, (f"{value:.6g}" for value in term.nonlinear), strict=True)
    return ", ".join(
        f"{item.name} = {text} {item.unit.format(x=model.input.unit, y=model.output.unit)}".removesuffix(" 1")
        for item, text in (*linear, *nonlinear)
    )
