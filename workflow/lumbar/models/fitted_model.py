"""A fitted or given model: its structure, its parameters by name with intervals, and how well it does."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.errors import InputError, NumericalError
from lumbar.models.bases import Base
from lumbar.models.form import Effect, Form
from lumbar.models.forward_structure import ForwardStructure
from lumbar.models.measured_motion import with_measured_motion
from lumbar.models.structure import Structure
from lumbar.models.transfer_function import TransferFunction

if TYPE_CHECKING:
    import control

    from lumbar.records.record import Record

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
    """A parameter with its value and interval.

    Attributes
    ----------
    name, symbol, unit : str
        E.g. ``"spring_stiffness"``, ``"k_e"`` (LaTeX), ``"N/mm"``.
    value : float
    low, high : float or None
        Ends of the interval; None where none was estimated.
    effect : str
        Effect it belongs to; empty for the base's own.
    derived : bool
        Whether it follows from the other parameters, as k1 of Kelvin–Boltzmann does, and is not needed to simulate.
    """

    name: str
    symbol: str
    unit: str
    value: float
    low: float | None = None
    high: float | None = None
    effect: str = ""
    derived: bool = False

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
    """Motion of the record that a model was fitted to: what the model is known to hold for.

    Attributes
    ----------
    lowest, highest : float
        Positions, in the input's unit.
    speed : float
        Below which 99 % of the samples were, in that unit per second.
    lowest_Hz, highest_Hz : float
        Band of 99 % of the position's power.
    """

    lowest: float
    highest: float
    speed: float
    lowest_Hz: float
    highest_Hz: float

    def in_words(self, unit: str) -> str:
        """E.g. ``"-2 to 2 mm, to 12.6 mm/s, 0.1 to 5 Hz"``."""
        return (
            f"{self.lowest:.3g} to {self.highest:.3g} {unit}, to {self.speed:.3g} {unit}/s, "
            f"{self.lowest_Hz:.3g} to {self.highest_Hz:.3g} Hz"
        )


@dataclass(frozen=True)
class Scores:
    """How well a model does and how well it is determined; None where a number does not exist.

    Attributes
    ----------
    vaf_percent, fit_percent, mean_residual : float or None
        Of the free run on the training record (Eqs 3.12, 3.11, 3.10).
    nmse_train : float or None
        Of the prediction one step ahead (Eq. 3.13).
    tests : tuple of str
        Names of the unseen records.
    vaf_tests_percent, nmse_tests : tuple of (float or None)
        On each of them.
    train_rms, test_rms : float or None
        Root mean square error of the free run in the output's unit, in training and on all unseen records together.
    free_parameters, rank : int or None
        Number of free coefficients, and how many of them the training record determines.
    condition_number : float or None
        Eq. 3.14.
    mru_percent, mru_bootstrap_percent : float or None
        Largest relative uncertainty (Eqs 3.15, 3.16), by covariance and by bootstrap.
    """

    vaf_percent: float | None = None
    fit_percent: float | None = None
    mean_residual: float | None = None
    nmse_train: float | None = None
    tests: tuple[str, ...] = ()
    vaf_tests_percent: tuple[float | None, ...] = ()
    nmse_tests: tuple[float | None, ...] = ()
    train_rms: float | None = None
    test_rms: float | None = None
    free_parameters: int | None = None
    rank: int | None = None
    condition_number: float | None = None
    mru_percent: float | None = None
    mru_bootstrap_percent: float | None = None


@dataclass(frozen=True, repr=False)
class FittedModel:
    """A model from deviations of the input about rest to deviations of the output.

    Attributes
    ----------
    name : str
        E.g. ``"KB"`` or ``"KB+coulomb_friction"``.
    structure : TransferFunction or Structure
        Discrete: H(z) at `sampling_time`. Continuous: a base with effects, simulated at any rate.
    sampling_time : float
        Seconds; of the record it was fitted to.
    input, output : Port
    base : str
        Name in `lumbar.models.tissue_models.MODELS` or `lumbar.models.bases.BASES`; empty for any other transfer function.
    estimator : str
        `ARX`, `OUTPUT_ERROR` or `GIVEN`.
    trained_on : str or None
        Record; None for a given model.
    alpha : float or None
        Ridge coefficient (Eq. 3.7), where one is used.
    parameters : tuple of FittedParameter
        Of base and effects, then the derived ones.
    no_parameters_because : str
        Why there are none, or no derived ones.
    scores : Scores
    remark : str
    valid_for : MotionRange or None
        Motion of the record it was fitted to; None for a given model, and where a file does not say.

    Examples
    --------
    >>> model = FittedModel(
    ...     "KB", TransferFunction((1.9, -1.2), (1, -0.45)), 0.01, Port("position", "mm"), Port("force", "N"), "KB"
    ... )
    >>> print(model)
    KB, given
    H(z) = (1.9 - 1.2 z^-1)/(1 - 0.45 z^-1), 100 Hz, position in mm to force in N
    """

    name: str
    structure: TransferFunction | Structure
    sampling_time: float
    input: Port
    output: Port
    base: str = ""
    estimator: str = GIVEN
    trained_on: str | None = None
    alpha: float | None = None
    parameters: tuple[FittedParameter, ...] = ()
    no_parameters_because: str = ""
    scores: Scores = field(default_factory=Scores)
    remark: str = ""
    valid_for: MotionRange | None = None

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
        """Parameter by its name, with the effect's in front where it is not the base's: ``"drift.drift_rate"``.

        Raises
        ------
        InputError
            If there is none of this name.
        """
        found = next((item for item in self.parameters if item.key == key), None)
        if found is None:
            known = ", ".join(item.key for item in self.parameters) or f"none: {self.no_parameters_because}"
            raise InputError(f"{self.name} has no parameter {key!r}; there are {known}")
        return found

    def values_of(self, part: Base | Form) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Linear and nonlinear parameters of the base or of an effect's form, in the part's own order."""
        owner = f"{part.effect}." if isinstance(part, Form) else ""
        linear, nonlinear = (
            tuple(self[owner + item.name].value for item in kind) for kind in (part.linear, part.nonlinear)
        )
        return linear, nonlinear

    def simulate(self, record: Record) -> np.ndarray:
        """Free run from a record's input alone.

        Parameters
        ----------
        record : Record
            Channel ``input`` and those that the effects need; a continuous model takes any sampling time.

        Returns
        -------
        numpy.ndarray, shape (samples,)
            In the output's unit.

        Raises
        ------
        InputError
            If the record's input has another unit or, for a discrete model, another sampling time.
        NumericalError
            If the model is unstable.
        """
        unit = record.channels["input"].unit
        if unit != self.input.unit:
            raise InputError(
                f"{record.name}: the input is in {unit!r}, {self.name} takes {self.input.unit!r}"
            )
        if isinstance(self.structure, Structure):
            return self._simulate_structure(self.structure, record) + self.output.offset
        if abs(record.sampling_time / self.sampling_time - 1) > 1e-4:
            raise InputError(
                f"{record.name} is sampled at {1 / record.sampling_time:g} Hz, {self.name} is a difference equation at "
                f"{1 / self.sampling_time:g} Hz: resample the record"
            )
        return self.structure.simulate(record["input"] - self.input.offset) + self.output.offset

    def _simulate_structure(self, structure: Structure, record: Record) -> np.ndarray:
        from lumbar.models.measured_angle import for_base
        from lumbar.models.motion import Motion

        parts = [self.values_of(structure.base), *map(self.values_of, structure.forms)]
        linear, nonlinear = (np.concatenate([part[kind] for part in parts]) for kind in (0, 1))
        if isinstance(structure, ForwardStructure):
            seen = Motion.of(with_measured_motion(record), offset=self.input.offset)
            return structure.simulate(seen, linear, nonlinear, self.output.offset)
        motion = Motion.of(for_base(record, structure.base), offset=self.input.offset)
        return structure.simulate(motion, linear, nonlinear)

    def to_control(self) -> control.TransferFunction:
        """Transfer function of python-control: in z with ``dt``, or in s for a base without effects.

        The pendulum is linearised about θ = 0.

        Raises
        ------
        NumericalError
            If the model has effects: no transfer function holds them.
        """
        import control

        if isinstance(self.structure, TransferFunction):
            from lumbar.models.state_space import aligned

            return control.TransferFunction(*aligned(self.structure), self.sampling_time)
        if isinstance(self.structure, ForwardStructure):
            raise NumericalError(
                f"{self.name}: it goes from force to motion; no transfer function of it is made"
            )
        if self.structure.forms:
            effects = ", ".join(self.structure.effects)
            raise NumericalError(f"{self.name}: no transfer function holds its effects ({effects})")
        base = self.structure.base
        if base.contact:
            raise NumericalError(f"{self.name}: no transfer function holds a contact that is lost")
        values = {item.name: self[item.name].value for item in (*base.linear, *base.nonlinear)}
        if base.system == "pendulum":
            return control.TransferFunction(
                [values["inertia"], values["damping"], values["gravity_moment"]], [1.0]
            )
        from lumbar.models.first_order import FirstOrder

        mass = values.pop("mass", 0.0)
        system = FirstOrder.of_base(**values)
        above, below = [system.nu, system.k], [system.gamma, 1.0]
        if mass:
            above = np.polyadd(np.polymul([mass, 0.0, 0.0], below), above).tolist()
        return control.TransferFunction(above, below)

    def to_state_space(self) -> control.StateSpace:
        """State space of python-control (Eqs 3.17 and 3.18 for a discrete model).

        Raises
        ------
        NumericalError
            If the model has effects, or is improper as Kelvin–Voigt and the pendulum are.
        """
        import control

        if isinstance(self.structure, TransferFunction):
            from lumbar.models.state_space import observer_form

            return observer_form(self.structure, self.sampling_time)
        system = self.to_control()
        if len(system.num[0][0]) > len(system.den[0][0]):
            raise NumericalError(
                f"{self.name}: {system.num[0][0]} over {system.den[0][0]} is improper and has no state space; "
                "take the inverse of to_control(), from output to input"
            )
        return control.ss(system)

    def to_json(self) -> dict:
        """Return the model as plain data, an entry of ``models.json``."""
        from lumbar.models.model_entry import entry_of

        return entry_of(self)

    @classmethod
    def from_json(cls, entry: dict, catalogues: Mapping[str, Mapping[str, Effect]]) -> FittedModel:
        """Return the model of an entry of ``models.json``.

        Parameters
        ----------
        entry : dict
        catalogues : mapping of str to mapping
            Effects by name for every system, as `lumbar.effects.catalogue.CATALOGUES`.

        Raises
        ------
        InputError
            With the place of everything that is missing, unknown or not allowed.
        """
        from lumbar.models.model_entry import read_entry

        return read_entry(entry, catalogues)

    def unscored(self) -> FittedModel:
        """The model without what it owes to one record."""
        return replace(
            self,
            trained_on=None,
            scores=Scores(free_parameters=self.scores.free_parameters, rank=self.scores.rank),
        )

    def __repr__(self) -> str:
        """One line: name, how it was found, how well it does."""
        from lumbar.models.model_text import headline

        return f"<FittedModel {headline(self)}>"

    def __str__(self) -> str:
        """Equation, parameters with intervals, scores."""
        from lumbar.models.model_text import in_text

        return in_text(self)

    def _repr_html_(self) -> str:
        """The same for a notebook."""
        from lumbar.models.model_text import in_html

        return in_html(self)
