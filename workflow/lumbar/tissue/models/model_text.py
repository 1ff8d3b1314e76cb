"""A fitted model in words: for the terminal and for a notebook."""

from __future__ import annotations

import html

from lumbar.tissue.models.model_data import FittedParameter, ModelData
from lumbar.tissue.models.transfer_function import TransferFunction


def headline(model: ModelData) -> str:
    """Name, estimator, training record and VAF."""
    trained = f" on {model.trained_on}" if model.trained_on else ""
    vaf = model.scores.vaf_percent
    return f"{model.name}, {model.estimator}{trained}" + ("" if vaf is None else f", VAF {vaf:.2f} %")


def in_text(model: ModelData) -> str:
    """Return equation, parameters with intervals and scores as lines of plain text."""
    signals = (
        f"{model.input.quantity} in {model.input.unit} to {model.output.quantity} in {model.output.unit}"
    )
    if isinstance(model.structure, TransferFunction):
        equation = f"H(z) = {_ratio(model.structure, '({})/({})', 'z^-{}')}, {1 / model.sampling_time:g} Hz"
    else:
        effects = [f"{form.effect}: {form.text}" for form in model.structure.forms]
        equation = "; ".join([model.structure.base.text, *effects])
    width = max((len(item.key) for item in model.parameters), default=0)
    rows = [f"  {item.key:<{width}}  {_value(item)}" for item in model.parameters]
    notes = (model.no_parameters_because, _scores(model), model.remark)
    return "\n".join([headline(model), f"{equation}, {signals}", *rows, *filter(None, notes)])


def in_html(model: ModelData) -> str:
    """Return the same as HTML with the equations in LaTeX, as notebooks set them."""
    rows = "".join(
        f"<tr><td>{html.escape(item.key)}</td><td>${html.escape(item.symbol)}$</td>"
        f"<td>{html.escape(_value(item))}</td></tr>"
        for item in model.parameters
    )
    shown = [f"<p><strong>{html.escape(headline(model))}</strong></p>"]
    shown += [f"<p>$${html.escape(line)}$$</p>" for line in _latex(model)]
    shown += [f"<table>{rows}</table>"] if rows else []
    notes = (model.no_parameters_because, _scores(model), model.remark)
    return "".join([*shown, *(f"<p>{html.escape(note)}</p>" for note in notes if note)])


def _latex(model: ModelData) -> list[str]:
    """Transfer function of a discrete model; equation of the base and of every effect of a continuous one."""
    if isinstance(model.structure, TransferFunction):
        return ["H(z) = " + _ratio(model.structure, r"\frac{{{}}}{{{}}}", "z^{{-{}}}")]
    return [model.structure.base.latex, *(form.latex for form in model.structure.forms)]


def _value(item: FittedParameter) -> str:
    interval = "" if item.low is None else f" ({item.low:.4g} to {item.high:.4g})"
    return f"{item.value:.4g} {item.unit}{interval}"


_SCORES = {
    "vaf_percent": "VAF {:.2f} %",
    "fit_percent": "FIT {:.2f} %",
    "mean_residual": "mean residual {:.4g} {}",
    "nmse_train": "NMSE {:.4g} one step ahead",
    "train_rms": "RMS error {:.4g} {} in training",
    "test_rms": "RMS error {:.4g} {} unseen",
    "condition_number": "condition number {:.4g}",
}


def _scores(model: ModelData) -> str:
    found = {name: getattr(model.scores, name) for name in _SCORES}
    return ", ".join(
        _SCORES[name].format(value, model.output.unit) for name, value in found.items() if value is not None
    )


def _ratio(ratio: TransferFunction, form: str, power: str) -> str:
    numerator, denominator = (_polynomial(part, power) for part in (ratio.numerator, ratio.denominator))
    return numerator if denominator == "1" else form.format(numerator, denominator)


def _polynomial(coefficients: tuple[float, ...], power: str) -> str:
    text = ""
    for lag, value in enumerate(coefficients):
        if value:
            sign = ("-" if value < 0 else "") if not text else (" - " if value < 0 else " + ")
            text += f"{sign}{abs(value):.4g}" + (f" {power.format(lag)}" if lag else "")
    return text or "0"
