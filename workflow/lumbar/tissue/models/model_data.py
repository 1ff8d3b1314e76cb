"""A fitted model as data and as text: structure, parameters by name with intervals, scores."""

import html
import re
from collections.abc import Callable
from dataclasses import dataclass, field

from lumbar.base.errors import InputError
from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.form import Form
from lumbar.tissue.models.printing import number_latex
from lumbar.tissue.models.structure import Structure
from lumbar.tissue.models.transfer_function import TransferFunction

ARX, OUTPUT_ERROR, GIVEN = "arx", "output_error", "given"
"""Estimators; a given model is prescribed, not estimated."""


def identifier(name: str) -> str:
    """Return `name` as a C identifier: other characters become ``_``."""
    cleaned = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return cleaned if re.match(r"[A-Za-z_]", cleaned) else f"_{cleaned}"


def unit_of(template: str, input_unit: str, output_unit: str) -> str:
    """Return the unit of a parameter, e.g. ``"N/mm"`` of ``"{y}/{x}"``."""
    return template.replace("{x}", input_unit).replace("{y}", output_unit)


@dataclass(frozen=True)
class FittedParameter:
    """A parameter with its value and interval."""

    name: str
    symbol: str
    unit: str
    """`name`, `symbol`, `unit`: E.g. ``"spring_stiffness"``, ``"k_e"`` (LaTeX), ``"N/mm"``."""
    value: float
    low: float | None = None
    high: float | None = None
    """`low`, `high`: ends of the interval; None where none was estimated."""
    effect: str = ""
    """Effect it belongs to; empty for the base's own."""
    derived: bool = False
    """Whether it follows from the other parameters, e.g. k1 of Kelvin–Boltzmann, and is not needed to simulate."""

    @property
    def key(self) -> str:
        """Name within the model, e.g. ``"relaxation_time"`` or ``"coulomb_friction.coulomb_force"``."""
        return f"{self.effect}.{self.name}" if self.effect else self.name


@dataclass(frozen=True)
class Port:
    """Input or output of a model: quantity, unit, and its value at rest."""

    quantity: str
    unit: str
    offset: float = 0.0

    @property
    def variable(self) -> str:
        """The quantity as a variable's name."""
        return identifier(self.quantity)

    @property
    def label(self) -> str:
        """Axis label: quantity and unit."""
        return f"{self.quantity.capitalize()} ({self.unit})"


@dataclass(frozen=True)
class MotionRange:
    """Motion of the record that a model was fitted to: what the model is known to hold for."""

    lowest: float
    highest: float
    """`lowest`, `highest`: positions, in the input's unit."""
    speed: float
    """Below which 99 % of the samples were, in that unit per second."""
    lowest_Hz: float
    highest_Hz: float
    """`lowest_Hz`, `highest_Hz`: band of 99 % of the position's power."""

    def describe(self, unit: str) -> str:
        """E.g. ``"-2 to 2 mm, to 12.6 mm/s, 0.1 to 5 Hz"``."""
        return (
            f"{self.lowest:.3g} to {self.highest:.3g} {unit}, to {self.speed:.3g} {unit}/s, "
            f"{self.lowest_Hz:.3g} to {self.highest_Hz:.3g} Hz"
        )


@dataclass(frozen=True)
class Scores:
    """Errors of a model and how well it is determined; None if a number does not exist."""

    vaf_percent: float | None = None
    fit_percent: float | None = None
    mean_residual: float | None = None
    """`vaf_percent`, `fit_percent`, `mean_residual`: of the free run on the training record (Eqs 3.12, 3.11, 3.10)."""
    nmse_train: float | None = None
    """NMSE of the prediction one step ahead (Eq. 3.13)."""
    tests: tuple[str, ...] = ()
    """Names of the unseen records."""
    vaf_tests_percent: tuple[float | None, ...] = ()
    nmse_tests: tuple[float | None, ...] = ()
    """`vaf_tests_percent`, `nmse_tests`: tuple of (float or None): on each of them."""
    train_rms: float | None = None
    test_rms: float | None = None
    """`train_rms`, `test_rms`: root mean square error of the free run in the output's unit, in training and on all unseen
    records together."""
    free_parameters: int | None = None
    rank: int | None = None
    """`free_parameters`, `rank`: number of free coefficients, and how many of them the training record determines."""
    condition_number: float | None = None
    """Eq. 3.14."""
    mru_percent: float | None = None
    mru_bootstrap_percent: float | None = None
    """`mru_percent`, `mru_bootstrap_percent`: largest relative uncertainty (Eqs 3.15, 3.16), by covariance and by
    bootstrap."""


@dataclass(frozen=True, repr=False)
class ModelData:
    """Everything that a fitted model is, as it is written to a file; `FittedModel` is what one does with it."""

    name: str
    """E.g. ``"KB"`` or ``"KB+coulomb_friction"``."""
    structure: TransferFunction | Structure
    """Discrete: H(z) at `sampling_time`. Continuous: a base with effects, simulated at any rate."""
    sampling_time: float
    """Seconds; of the record it was fitted to."""
    input: Port
    output: Port
    base: str = ""
    """Name in `lumbar.tissue.models.tissue_models.MODELS` or `lumbar.tissue.models.bases.BASES`; empty for any other
    transfer function."""
    estimator: str = GIVEN
    """`ARX`, `OUTPUT_ERROR` or `GIVEN`."""
    trained_on: str | None = None
    """Record; None for a given model."""
    alpha: float | None = None
    """Ridge coefficient (Eq. 3.7), where one is used."""
    parameters: tuple[FittedParameter, ...] = ()
    """Parameters of base and effects, then the derived ones."""
    no_parameters_because: str = ""
    """Reason for missing parameters, or missing derived ones."""
    scores: Scores = field(default_factory=Scores)
    remark: str = ""
    valid_for: MotionRange | None = None
    """Motion of the record it was fitted to; None for a given model, and where a file does not say."""
    zeros: tuple[float, ...] = ()
    """Reading of the force sensor along each of several axes if the model gives 0."""
    rests: tuple[float, ...] = ()
    """Position along each of several axes from which the model counts; empty if 0."""

    @property
    def discrete(self) -> bool:
        """Whether it is a transfer function at one sampling time."""
        return isinstance(self.structure, TransferFunction)

    @property
    def order(self) -> int:
        """Poles of the transfer function, or relaxations of the base."""
        if isinstance(self.structure, TransferFunction):
            return len(self.structure.denominator) - 1
        return len(self.structure.base.nonlinear)

    @property
    def stable(self) -> bool:
        """Whether a free run exists; continuous models relax, hence are stable."""
        return not isinstance(self.structure, TransferFunction) or self.structure.stable

    def __getitem__(self, key: str) -> FittedParameter:
        """Parameter by its name, with the effect's in front where it is not the base's: ``"drift.drift_rate"``."""
        found = next((item for item in self.parameters if item.key == key), None)
        if found is None:
            known = ", ".join(item.key for item in self.parameters) or f"none: {self.no_parameters_because}"
            raise InputError(f"{self.name} has no parameter {key!r}; there are {known}")
        return found

    def values_of(self, part: Base | Form) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Linear and nonlinear parameters of the base or of an effect's form, in the part's own order."""
        owner = f"{part.effect}." if isinstance(part, Form) else ""
        linear = tuple(self[owner + item.name].value for item in part.linear)
        return linear, tuple(item.encode(self[owner + item.name].value) for item in part.nonlinear)


def headline(model: ModelData) -> str:
    """Name, estimator, training record and VAF."""
    trained = f" on {model.trained_on}" if model.trained_on else ""
    vaf = model.scores.vaf_percent
    return f"{model.name}, {model.estimator}{trained}" + ("" if vaf is None else f", VAF {vaf:.2f} %")


def format_text(model: ModelData) -> str:
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


def format_html(model: ModelData) -> str:
    """Return the same as HTML with the equations in LaTeX, as notebooks set them."""
    rows = "".join(
        f"<tr><td>{html.escape(item.key)}</td><td>${html.escape(item.symbol)}$</td>"
        f"<td>{html.escape(_value(item))}</td></tr>"
        for item in model.parameters
    )
    if isinstance(model.structure, TransferFunction):
        equations = ["H(z) = " + _ratio(model.structure, r"\frac{{{}}}{{{}}}", "z^{{-{}}}", number_latex)]
    else:
        equations = [model.structure.base.latex, *(form.latex for form in model.structure.forms)]
    shown = [f"<p><strong>{html.escape(headline(model))}</strong></p>"]
    shown += [f"<p>$${html.escape(line)}$$</p>" for line in equations]
    shown += [f"<table>{rows}</table>"] if rows else []
    notes = (model.no_parameters_because, _scores(model), model.remark)
    return "".join([*shown, *(f"<p>{html.escape(note)}</p>" for note in notes if note)])


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


def _ratio(ratio: TransferFunction, form: str, power: str, number: Callable[[str], str] = str) -> str:
    numerator, denominator = (
        _polynomial(part, power, number) for part in (ratio.numerator, ratio.denominator)
    )
    return numerator if denominator == "1" else form.format(numerator, denominator)


def _polynomial(coefficients: tuple[float, ...], power: str, number: Callable[[str], str]) -> str:
    text = ""
    for lag, value in enumerate(coefficients):
        if value:
            sign = ("-" if value < 0 else "") if not text else (" - " if value < 0 else " + ")
            text += sign + number(f"{abs(value):.4g}") + (f" {power.format(lag)}" if lag else "")
    return text or "0"
