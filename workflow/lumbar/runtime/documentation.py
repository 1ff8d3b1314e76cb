"""documentation/index.html of an FMU: equation, variables, fit, timing, and where the data come from."""

from __future__ import annotations

import html

from lumbar.runtime.description import feedthrough_text, variables
from lumbar.runtime.export_model import ExportModel


def equation_text(model: ExportModel) -> list[str]:
    """Return the equations in plain text, one per line, numbers to six digits."""
    system = model.state_space
    rows = []
    for index in range(system.states):
        terms = [(value, f"x{j + 1}[k]") for j, value in enumerate(system.A[index])] + [
            (system.B[index], "u[k]")
        ]
        rows.append(f"x{index + 1}[k+1] = {_sum(terms)}")
    terms = [(value, f"x{j + 1}[k]") for j, value in enumerate(system.C)] + [(system.D, "u[k]")]
    return [*rows, f"y[k] = {_sum(terms)}"]


def _sum(terms: list[tuple[float, str]]) -> str:
    text = ""
    for value, symbol in terms:
        if value != 0.0:
            sign = ("−" if value < 0 else "") if not text else (" − " if value < 0 else " + ")
            text += f"{sign}{symbol}" if abs(value) == 1.0 else f"{sign}{abs(value):.6g} {symbol}"
    return text or "0"


def documentation_html(model: ExportModel, version: str, data: str) -> str:
    """Return a page of its own: no script, no outside resource."""
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
        f"Largest |pole|: {model.state_space.largest_pole:.6g}, stable."
        if model.state_space.stable
        else f"<strong>Unstable</strong>: largest |pole| {model.state_space.largest_pole:.6g}; "
        f"the {y.quantity} runs into its limit."
    )
    return _PAGE.format(
        name=html.escape(model.name),
        version=version,
        data=html.escape(data),
        equations="\n".join(map(html.escape, equation_text(model))),
        averaged=html.escape(averaged),
        output=html.escape(f"{y.variable} = gain · y[k] + {y.variable}_offset, within ±{y.variable}_limit"),
        stability=stability,
        sampling=f"{model.sampling_time:g}",
        feedthrough=html.escape(feedthrough_text(model, version)),
        rows=rows,
        fit=fit,
    )


def _cell(value: float | None) -> str:
    return "–" if value is None else f"{value:g}"


_PAGE = """<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><title>{name} (FMI {version})</title></head>
<body>
<h1>{name}: FMI {version} for co-simulation</h1>
<p><strong>Data: {data}</strong></p>
<h2>Equations</h2>
<pre>
{equations}
</pre>
<p>{averaged}</p>
<p>{output}</p>
<p>{stability}</p>
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
