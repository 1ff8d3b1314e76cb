"""documentation/index.html of an FMU: equation, variables, fit, timing, and where the data come from."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from markupsafe import Markup

from lumbar import __version__
from lumbar.base.templates import template
from lumbar.tissue.fmu.build.description import (
    AUTHOR,
    gain_text,
    guards_text,
    model_version,
    sentence,
    variables,
)
from lumbar.tissue.fmu.build.effect_model import Term
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.linear_model import LinearModel
from lumbar.tissue.fmu.build.reference_response import reference_plot, reference_push
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.form import Place
from lumbar.tissue.models.model_data import Port
from lumbar.tissue.models.printing import equation_mathml


def pictures(model: ExportModel, version: str) -> list[str]:
    """What the page draws, as SVG elements: the embedded reference."""
    time, inputs, outputs = reference_push(model, version)
    return [
        reference_plot(time, [*_panels(model, model.input, inputs), *_panels(model, model.output, outputs)])
    ]


def _panels(model: ExportModel, port: Port, values: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """A signal with its label, in space each of its components."""
    if not model.axes:
        return [(port.label, values)]
    labels = (replace(port, quantity=f"{port.quantity} {axis}").label for axis in model.axes)
    return list(zip(labels, values.T, strict=True))


def documentation_html(model: ExportModel, version: str, data: str, drawn: Sequence[str]) -> str:
    """Return a page of its own: no script, no outside resource.

    Parameters
    ----------
    drawn : sequence of str
        Its `pictures`.
    """
    x, y = model.input, model.output
    linear = isinstance(model.dynamics, LinearModel)
    return template("tissue/fmu/build/documentation.html.jinja").render(
        name=model.name,
        version=version,
        data=data,
        input=x,
        output=y,
        linear_equations=model.dynamics.equations() if linear else [],
        terms=[] if linear else [_term(model, term) for term in model.dynamics.terms],
        averaged=_averaged(model),
        guards=[*guards_text(model), gain_text(model)],
        stable=model.stable,
        largest_pole=f"{model.dynamics.largest_pole:.6g}",
        sampling=f"{model.sampling_time:g}",
        feedthrough=sentence("feedthrough", model, version=version),
        sign=sentence("sign", model),
        valid=sentence("range", model),
        rate=sentence("rate", model),
        made_by=f"lumbar {__version__}",
        model_version=model_version(model),
        author=AUTHOR,
        on_device=model.on_device,
        variables=[
            (
                item.name if item.size == 1 else f"{item.name}[{item.size}]",
                item.kind,
                item.unit or "1",
                ", ".join(map(_number, item.starts if len(set(item.starts)) > 1 else item.starts[:1])),
                *map(_number, (item.low, item.high)),
                item.description,
            )
            for item in variables(model)
        ],
        fit=_fit(model.identified),
        plot=Markup("".join(drawn)),
    )


def _fit(model: FittedModel) -> dict[str, str]:
    """How the model was found: label and text."""
    texts = {"Identified from": "nothing: the coefficients are prescribed"}
    if model.trained_on:
        texts["Identified from"] = f"record {model.trained_on}, estimator {model.estimator}"
    if model.alpha is not None:
        texts["Ridge parameter"] = f"{model.alpha:.6g}"
    if model.scores.vaf_percent is not None:
        texts["VAF of the free run on the training record"] = f"{model.scores.vaf_percent:.2f} %"
    for item in model.parameters:
        interval = "" if item.low is None else f" ({item.low:.4g} to {item.high:.4g})"
        texts[item.key] = f"{item.value:.6g} {item.unit}{interval}"
    return texts


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


def _term(model: ExportModel, term: Term) -> tuple:
    """One row of the table of forms."""
    return (
        term.form.key,
        _ACTS[term.form.place],
        Markup(equation_mathml(term.form.latex)),
        _numbers(model, term),
    )


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


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:g}"
