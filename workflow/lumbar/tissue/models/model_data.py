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
"""Names of the estimators; a given model is prescribed, not estimated."""


def identifier(name: str) -> str:
    """Return a name as a C identifier: other characters become ``_``.

    Parameters
    ----------
    name : str
        Any text.
    """
    cleaned = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return cleaned if re.match(r"[A-Za-z_]", cleaned) else f"_{cleaned}"


def unit_of(template: str, input_unit: str, output_unit: str) -> str:
    """Return the unit of a parameter, e.g. ``"N/mm"`` of ``"{y}/{x}"``.

    Parameters
    ----------
    template, input_unit, output_unit : str
        Unit with ``{x}`` for the input's unit and ``{y}`` for the output's; unit of the input; unit of the output.
    """
    return template.replace("{x}", input_unit).replace("{y}", output_unit)


@dataclass(frozen=True)
class FittedParameter:
    """A parameter with its value and interval."""

    name: str
    """Name, e.g. ``"spring_stiffness"``."""
    symbol: str
    """Symbol in LaTeX, e.g. ``"k_e"``."""
    unit: str
    value: float
    low: float | None = None
    """Lower end of the interval, in `unit`; None if the value was not estimated."""
    high: float | None = None
    """Upper end of the interval, in `unit`; None if the value was not estimated."""
    effect: str = ""
    """Effect to which the parameter belongs; empty for the base."""
    derived: bool = False
    """True if the parameter follows from others, e.g. k1 of Kelvin–Boltzmann, and no simulation needs it."""

    @property
    def key(self) -> str:
        """Name within the model, e.g. ``"relaxation_time"`` or ``"coulomb_friction.coulomb_force"``."""
        return f"{self.effect}.{self.name}" if self.effect else self.name


@dataclass(frozen=True)
class Port:
    """Input or output of a model."""

    quantity: str
    """Quantity, e.g. ``"position"``."""
    unit: str
    """Unit, e.g. ``"mm"``."""
    offset: float = 0.0
    """Value at rest, in `unit`."""

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
    """Motion in the training record, for which a model is known to be valid."""

    lowest: float
    """Position, in the input's unit."""
    highest: float
    """Position, in the input's unit."""
    speed: float
    """99 % quantile of the speed, in the input's unit per second."""
    lowest_Hz: float
    """Lower edge of the band of 99 % of the position's power."""
    highest_Hz: float
    """Upper edge of the band of 99 % of the position's power."""

    def describe(self, unit: str) -> str:
        """Return the range as text, e.g. ``"-2 to 2 mm, to 12.6 mm/s, 0.1 to 5 Hz"``.

        Parameters
        ----------
        unit : str
            Unit of the input.
        """
        return (
            f"{self.lowest:.3g} to {self.highest:.3g} {unit}, to {self.speed:.3g} {unit}/s, "
            f"{self.lowest_Hz:.3g} to {self.highest_Hz:.3g} Hz"
        )


@dataclass(frozen=True)
class Scores:
    """Errors and uncertainty of a model; None for a number that does not exist."""

    vaf_percent: float | None = None
    """VAF of the free run on the training record (Eq. 3.12)."""
    fit_percent: float | None = None
    """FIT of the free run on the training record (Eq. 3.11)."""
    mean_residual: float | None = None
    """Mean absolute residual of the free run on the training record (Eq. 3.10)."""
    nmse_train: float | None = None
    """NMSE of the one-step-ahead prediction on the training record (Eq. 3.13)."""
    tests: tuple[str, ...] = ()
    """Names of the unseen records."""
    vaf_tests_percent: tuple[float | None, ...] = ()
    """VAF of the free run on each of `tests`."""
    nmse_tests: tuple[float | None, ...] = ()
    """NMSE of the one-step-ahead prediction on each of `tests`."""
    train_rms: float | None = None
    """RMS error of the free run in training, in the output's unit."""
    test_rms: float | None = None
    """RMS error of the free run on all unseen records together, in the output's unit."""
    free_parameters: int | None = None
    """Number of free coefficients."""
    rank: int | None = None
    """Number of coefficients that the training record determines."""
    condition_number: float | None = None
    """Condition number of the standardised regressor matrix (Eq. 3.14)."""
    mru_percent: float | None = None
    """Largest relative uncertainty, from the covariance (Eqs 3.15, 3.16)."""
    mru_bootstrap_percent: float | None = None
    """Largest relative uncertainty, from the bootstrap."""


@dataclass(frozen=True, repr=False)
class ModelData:
    """Content of a fitted model in a file, and its text; `FittedModel` adds simulation and conversion."""

    name: str
    """Name, e.g. ``"KB"`` or ``"KB+coulomb_friction"``."""
    structure: TransferFunction | Structure
    """Structure: H(z) at `sampling_time` of a discrete model, or a base with effects, simulated at any rate."""
    sampling_time: float
    """Sampling time of the training record in seconds."""
    input: Port
    output: Port
    base: str = ""
    """Name of the base in `lumbar.tissue.models.tissue_models.MODELS` or `lumbar.tissue.models.bases.BASES`; empty for any
    other transfer function."""
    estimator: str = GIVEN
    """Estimator: `ARX`, `OUTPUT_ERROR` or `GIVEN`."""
    trained_on: str | None = None
    """Name of the training record; None for a given model."""
    alpha: float | None = None
    """Ridge coefficient (Eq. 3.7); None without ridge."""
    parameters: tuple[FittedParameter, ...] = ()
    """Parameters of base and effects, then derived parameters."""
    no_parameters_because: str = ""
    """Reason if parameters or derived parameters are missing."""
    scores: Scores = field(default_factory=Scores)
    remark: str = ""
    """Text for tables and summaries; empty for most models."""
    valid_for: MotionRange | None = None
    """Motion in the training record; None for a given model, or if the file has none."""
    zeros: tuple[float, ...] = ()
    """Reading of the force sensor along each of several axes at a model force of 0."""
    rests: tuple[float, ...] = ()
    """Zero of the model's position along each of several axes; empty if 0."""

    @property
    def discrete(self) -> bool:
        """True if the model is a transfer function at one sampling time."""
        return isinstance(self.structure, TransferFunction)

    @property
    def order(self) -> int:
        """Number of poles of the transfer function, or of relaxations of the base."""
        if isinstance(self.structure, TransferFunction):
            return len(self.structure.denominator) - 1
        return len(self.structure.base.nonlinear)

    @property
    def stable(self) -> bool:
        """True if a free run exists. Continuous models relax and are always stable."""
        return not isinstance(self.structure, TransferFunction) or self.structure.stable

    def __getitem__(self, key: str) -> FittedParameter:
        """Return the parameter of a key such as ``"relaxation_time"`` or ``"drift.drift_rate"``."""
        for item in self.parameters:
            if item.key == key:
                return item
        known = ", ".join(item.key for item in self.parameters) or f"none: {self.no_parameters_because}"
        raise InputError(f"{self.name} has no parameter {key!r}; there are {known}")

    def values_of(self, part: Base | Form) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the linear and the encoded nonlinear parameters (as a fit searches them) of the base or of an effect's form.

        Parameters
        ----------
        part : Base or Form
            Base or form of the model's structure.

        Raises
        ------
        InputError
            If the model lacks one of these parameters.
        """
        owner = f"{part.effect}." if isinstance(part, Form) else ""
        linear = tuple(self[owner + item.name].value for item in part.linear)
        return linear, tuple(item.encode(self[owner + item.name].value) for item in part.nonlinear)

    @property
    def headline(self) -> str:
        """Name, estimator, training record and VAF."""
        trained = f" on {self.trained_on}" if self.trained_on else ""
        vaf = self.scores.vaf_percent
        return f"{self.name}, {self.estimator}{trained}" + ("" if vaf is None else f", VAF {vaf:.2f} %")

    def __repr__(self) -> str:
        """Return the headline in angle brackets."""
        return f"<FittedModel {self.headline}>"

    def __str__(self) -> str:
        """Return equation, parameters with intervals and scores as lines of plain text."""
        ports = f"{self.input.quantity} in {self.input.unit} to {self.output.quantity} in {self.output.unit}"
        if isinstance(self.structure, TransferFunction):
            equation = f"H(z) = {_ratio(self.structure, '({})/({})', 'z^-{}')}, {1 / self.sampling_time:g} Hz"
        else:
            effects = [f"{form.effect}: {form.text}" for form in self.structure.forms]
            equation = "; ".join([self.structure.base.text, *effects])
        width = max((len(item.key) for item in self.parameters), default=0)
        rows = [f"  {item.key:<{width}}  {_value(item)}" for item in self.parameters]
        return "\n".join([self.headline, f"{equation}, {ports}", *rows, *self._notes])

    def _repr_html_(self) -> str:
        """Return the text as HTML with the equations in LaTeX, for notebooks."""
        rows = "".join(
            f"<tr><td>{html.escape(item.key)}</td><td>${html.escape(item.symbol)}$</td>"
            f"<td>{html.escape(_value(item))}</td></tr>"
            for item in self.parameters
        )
        if isinstance(self.structure, TransferFunction):
            equations = ["H(z) = " + _ratio(self.structure, r"\frac{{{}}}{{{}}}", "z^{{-{}}}", number_latex)]
        else:
            equations = [self.structure.base.latex, *(form.latex for form in self.structure.forms)]
        parts = [f"<p><strong>{html.escape(self.headline)}</strong></p>"]
        parts += [f"<p>$${html.escape(line)}$$</p>" for line in equations]
        parts += [f"<table>{rows}</table>"] if rows else []
        return "".join([*parts, *(f"<p>{html.escape(note)}</p>" for note in self._notes)])

    @property
    def _notes(self) -> list[str]:
        scores = {name: getattr(self.scores, name) for name in _SCORES}
        texts = (
            _SCORES[name].format(value, self.output.unit)
            for name, value in scores.items()
            if value is not None
        )
        return [note for note in (self.no_parameters_because, ", ".join(texts), self.remark) if note]


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


def _ratio(ratio: TransferFunction, form: str, power: str, number: Callable[[str], str] = str) -> str:
    """Format a transfer function with templates for the fraction (`form`) and for each power of z."""
    sides = []
    for coefficients in (ratio.numerator, ratio.denominator):
        text = ""
        for lag, value in enumerate(coefficients):
            if value:
                sign = ("-" if value < 0 else "") if not text else (" - " if value < 0 else " + ")
                text += sign + number(f"{abs(value):.4g}") + (f" {power.format(lag)}" if lag else "")
        sides.append(text or "0")
    return sides[0] if sides[1] == "1" else form.format(*sides)
