"""documentation/index.html of an FMU: equation, variables, fit, timing, and where the data come from."""

from __future__ import annotations

import html

import numpy as np

from lumbar.models.form import Place
from lumbar.fmu.build.description import feedthrough_text, variables
from lumbar.fmu.build.effect_model import Term
from lumbar.fmu.build.equation_svg import equation_svg
from lumbar.fmu.build.export_model import ExportModel
from lumbar.fmu.build.line_plot import svg_plot
from lumbar.fmu.build.linear_model import LinearModel


def documentation_html(
    model: ExportModel, version: str, data: str, push: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> str:
    """Return a page of its own: no script, no outside resource.

    Parameters
    ----------
    model : ExportModel
    version : str
        Of FMI.
    data : str
        Where the model's data come from.
    push : tuple of numpy.ndarray
        Time, input and output of the embedded reference, drawn.
    """
    x, y = model.input, model.output
    averaged = (
        f"u[k] is the mean of the last {model.moving_average} samples of {x.variable} − {x.variable}_offset, "
        "the newest included; before the start the model was at rest."
        if model.moving_average > 1
        else f"u[k] = {x.variable} − {x.variable}_offset."
    )
    rows = "".join(
        f"<tr><td>{html.escape(item.name)}</td><td>{item.kind}</td><td>{html.escape(item.unit) or '1'}</td>"
        f"<td>{_cell(item.start)}</td><td>{_cell(item.low)}</td><td>{_cell(item.high)}</td>"
        f"<td>{html.escape(item.description)}</td></tr>\n"
        for item in variables(model)
    )
    fit = "".join(
        f"<dt>{html.escape(label)}</dt><dd>{html.escape(text)}</dd>\n" for label, text in model.fit.items()
    )
    stability = (
        f"Largest |pole|: {model.dynamics.largest_pole:.6g}, stable."
        if model.stable
        else f"<strong>Unstable</strong>: largest |pole| {model.dynamics.largest_pole:.6g}; "
        f"the {y.quantity} runs into its limit."
    )
    return _PAGE.format(
        name=html.escape(model.name),
        version=version,
        data=html.escape(data),
        equations=_equations(model),
        derivatives="" if isinstance(model.dynamics, LinearModel) else _DERIVATIVES,
        averaged=html.escape(averaged),
        output=html.escape(f"{y.variable} = gain · y[k] + {y.variable}_offset, within ±{y.variable}_limit"),
        stability=stability,
        sampling=f"{model.sampling_time:g}",
        feedthrough=html.escape(feedthrough_text(model, version)),
        rows=rows,
        fit=fit,
        plot=svg_plot(push[0], [(x.label, push[1]), (y.label, push[2])]),
        plotted=html.escape(f"{x.quantity.capitalize()} and {y.quantity} of one push. Data: {data}."),
    )


def _equations(model: ExportModel) -> str:
    if isinstance(model.dynamics, LinearModel):
        return f"<pre>\n{html.escape(chr(10).join(model.dynamics.equations()))}\n</pre>"
    rows = "".join(
        f"<tr><td>{html.escape(term.form.key)}</td><td>{_ACTS[term.form.place]}</td>"
        f"<td>{equation_svg(term.form.latex)}</td><td>{html.escape(_numbers(model, term))}</td></tr>\n"
        for term in model.dynamics.terms
    )
    return (
        '<table border="1" cellpadding="4">\n<tr><th>Form</th><th>Acts on</th><th>Equation</th><th>Parameters</th></tr>'
        f"\n{rows}</table>"
    )


_ACTS = {
    Place.INPUT: "the position, before it reaches the tissue",
    Place.PARALLEL: "adds to the force",
    Place.OUTPUT: "the sum of the forces",
}


def _numbers(model: ExportModel, term: Term) -> str:
    """Parameters of a form with units, to six digits."""
    parameters = (*term.form.linear, *term.form.nonlinear)
    return ", ".join(
        f"{item.name} = {value:.6g} {item.unit.format(x=model.input.unit, y=model.output.unit)}".removesuffix(
            " 1"
        )
        for item, value in zip(parameters, (*term.linear, *term.nonlinear), strict=True)
    )


def _cell(value: float | None) -> str:
    return "–" if value is None else f"{value:g}"


_DERIVATIVES = """<p>z is u[k], for forms behind the input forms what they make of it; F is the sum of all parallel forms,
s the path travelled, v the velocity.
Velocity and acceleration are backward differences of the samples, v[k] = (z[k] − z[k−1])/T and
a[k] = (v[k] − v[k−1])/T, both 0 at the first sample: in a running loop no later sample is known. Against the true
derivative of a smooth motion v is late by half a sampling time T, a by a whole one. Relaxations are exact for
positions in straight lines between samples; the delay interpolates linearly; t and s begin at the start and after a
reset.</p>
"""
_PAGE = """<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><title>{name} (FMI {version})</title></head>
<body>
<h1>{name}: FMI {version} for co-simulation</h1>
<p><strong>Data: {data}</strong></p>
<h2>Equations</h2>
{equations}
{derivatives}<p>{averaged}</p>
<p>{output}</p>
<p>{stability}</p>
<figure>
{plot}
<figcaption>{plotted} The numbers are in resources/reference_input.csv and resources/reference_output.csv: an
importer that plays the first should read the second.</figcaption>
</figure>
<h2>Timing</h2>
<p>The model samples its input every {sampling} s from the start time on and holds its output in between.
Communication steps of any length are allowed; an instant counts as reached within a thousandth of the
sampling time.</p>
<p>{feedthrough}</p>
<p>An input that is not finite is refused with a warning: the last finite one stays. Parameters outside their
bounds are refused with an error.</p>
<h2>Variables</h2>
<table border="1" cellpadding="4">
<tr><th>Name</th><th>Kind</th><th>Unit</th><th>Start</th><th>Min</th><th>Max</th><th>Description</th></tr>
{rows}</table>
<h2>Fit</h2>
<dl>
{fit}</dl>
</body>
</html>
"""
