"""Fitted and given models: simulation, conversion to other representations, and files of models."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import InputError, NumericalError, Problems
from lumbar.records.record import Record
from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.driven_motion import linearise
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.measured_motion import add_measured_motion, for_base
from lumbar.tissue.models.model_data import ModelData
from lumbar.tissue.models.model_entry import checked_entry, entry_of
from lumbar.tissue.models.motion import Motion, SpatialMotion
from lumbar.tissue.models.structure import ForwardStructure, Structure
from lumbar.tissue.models.transfer_function import (
    FirstOrder,
    TransferFunction,
    aligned_coefficients,
    observer_form,
)

if TYPE_CHECKING:
    import control


@dataclass(frozen=True, repr=False)
class FittedModel(ModelData):
    """A model from deviations of the input from rest to deviations of the output, with the fields of `ModelData`.

    Examples
    --------
    >>> model = FittedModel(
    ...     "KB", TransferFunction((1.9, -1.2), (1, -0.45)), 0.01, Port("position", "mm"), Port("force", "N"), "KB"
    ... )
    >>> print(model)
    KB, given
    H(z) = (1.9 - 1.2 z^-1)/(1 - 0.45 z^-1), 100 Hz, position in mm to force in N
    """

    def simulate(self, record: Record) -> np.ndarray:
        """Simulate the output as a free run from a record's input; shape (samples,), along several axes (axes, samples).

        Parameters
        ----------
        record : Record
            Record with the channel ``input`` and those that the effects need; a continuous model accepts any sampling time.

        Raises
        ------
        InputError
            If the record's input has another unit, other axes or, for a discrete model, another sampling time.
        NumericalError
            If the model is unstable.
        """
        unit = record.channels[record.roles("input")[0]].unit
        if unit != self.input.unit:
            raise InputError(
                f"{record.name}: the input is in {unit!r}, {self.name} takes {self.input.unit!r}"
            )
        structure = self.structure
        if isinstance(structure, TransferFunction):
            if abs(record.sampling_time / self.sampling_time - 1) > 1e-4:
                raise InputError(
                    f"{record.name} is sampled at {1 / record.sampling_time:g} Hz, {self.name} is a difference equation at "
                    f"{1 / self.sampling_time:g} Hz: resample the record"
                )
            return structure.simulate(record["input"] - self.input.offset) + self.output.offset
        # Linear and nonlinear parameters, those of the base first.
        parts = [self.values_of(structure.base), *map(self.values_of, structure.forms)]
        linear, nonlinear = (np.concatenate([part[kind] for part in parts]) for kind in (0, 1))
        if structure.base.spatial is not None:
            if record.axes != structure.base.spatial.axes:
                axes = ", ".join(structure.base.spatial.axes)
                raise InputError(f"{record.name} does not have the axes {axes} that {self.name} takes")
            forces = structure.simulate(SpatialMotion.from_record(record, self.rests), linear, nonlinear)
            return forces.reshape(len(record.axes), -1) + np.array(self.zeros)[:, None]
        if isinstance(structure, ForwardStructure):
            force = Motion.from_record(add_measured_motion(record), offset=self.input.offset)
            return structure.simulate(force, linear, nonlinear, self.output.offset) + self.output.offset
        motion = Motion.from_record(for_base(record, structure.base), offset=self.input.offset)
        return structure.simulate(motion, linear, nonlinear) + self.output.offset

    def to_control(self) -> control.TransferFunction:
        """Return the transfer function of python-control: in z with ``dt``, or in s for a base without effects.

        The pendulum is linearised about θ = 0, a user-defined base about 0 of its input and states.

        Raises
        ------
        NumericalError
            If the model has effects, which no transfer function can represent, or cannot be linearised at 0.
        """
        import control

        structure = self.structure
        if isinstance(structure, TransferFunction):
            return control.TransferFunction(*aligned_coefficients(structure), self.sampling_time)
        base, reason = structure.base, ""
        if isinstance(structure, ForwardStructure):
            reason = "a model from force to motion is not converted to a transfer function"
        elif structure.forms:
            reason = f"no transfer function can represent its effects ({', '.join(structure.effects)})"
        elif base.contact:
            reason = "no transfer function can represent a contact that is lost"
        elif base.is_quasi_linear:
            reason = "no transfer function can represent a nonlinear elastic response"
        if reason:
            raise NumericalError(f"{self.name}: {reason}")
        if base.is_user_defined:
            return control.TransferFunction(*self._linearise(base))
        values = {item.name: self[item.name].value for item in (*base.linear, *base.nonlinear)}
        if base.system == "pendulum":
            return control.TransferFunction(
                [values["inertia"], values["damping"], values["gravity_moment"]], [1.0]
            )

        mass = values.pop("mass", 0.0)
        system = FirstOrder.from_base(**values)
        above, below = [system.nu, system.k], [system.gamma, 1.0]
        if mass:
            above = np.polyadd(np.polymul([mass, 0.0, 0.0], below), above).tolist()
        return control.TransferFunction(above, below)

    def _linearise(self, base: Base) -> tuple[np.ndarray, np.ndarray]:
        """Return numerator and denominator in s, from the slopes of the equation and of the rates of its states."""
        linear, nonlinear = self.values_of(base)
        by_motion, by_states = linearise(base.form, linear, nonlinear)
        if not (np.isfinite(by_motion).all() and np.isfinite(by_states).all()):
            raise NumericalError(f"{self.name}: its slope is not finite at 0 of its input and states")
        rates, response = by_states[1:], by_states[0]
        denominator = np.poly(rates) if len(rates) else np.ones(1)
        numerator = np.zeros(1)
        for power, (direct, *driven) in enumerate(by_motion.T):
            # c (sI − A)⁻¹ b is det(sI − A + b c) / det(sI − A) − 1.
            rank_one = np.poly(rates - np.outer(driven, response)) if len(rates) else denominator
            part = np.polysub(rank_one, (1 - direct) * denominator)
            numerator = np.polyadd(numerator, np.polymul(part, np.eye(1, power + 1)[0]))
        return np.trim_zeros(numerator, "f"), denominator

    def to_state_space(self) -> control.StateSpace:
        """Return the state space of python-control (Eqs 3.17 and 3.18 for a discrete model).

        Raises
        ------
        NumericalError
            If the model has effects or is improper, like Kelvin–Voigt and the pendulum.
        """
        import control

        if isinstance(self.structure, TransferFunction):
            matrices = observer_form(self.structure)
            return control.StateSpace(*matrices, dt=self.sampling_time, remove_useless_states=False)
        system = self.to_control()
        if len(system.num[0][0]) > len(system.den[0][0]):
            raise NumericalError(
                f"{self.name}: {system.num[0][0]} over {system.den[0][0]} is improper and has no state space; "
                "take the inverse of to_control(), from output to input"
            )
        return control.ss(system)

    def to_json(self) -> dict:
        """Return the model as plain data, an entry of ``models.json``."""
        return entry_of(self)

    @classmethod
    def from_json(cls, entry: object, catalogues: Mapping[str, Mapping[str, Effect]]) -> FittedModel:
        """Return the model of an entry of ``models.json``.

        Parameters
        ----------
        entry : object
            Result of `to_json`, as read from JSON.
        catalogues : mapping
            Effects by name for every system, as in `read_models`.

        Raises
        ------
        InputError
            If a field is missing, unknown or invalid. The message lists every place.
        """
        problems = Problems(f"model {entry.get('name') if isinstance(entry, dict) else None!r}")
        fields = checked_entry(entry, catalogues, problems)
        problems.raise_if_any()
        assert fields is not None  # else there were problems
        return cls(**fields)


SCHEMA = "lumbar.models/2"


def models_document(
    models: Iterable[FittedModel], source_label: str, noise_floor_rms: float | None = None
) -> dict:
    """Return the content of a file of models, complete with the YAML files of user-defined bases and effects.

    Parameters
    ----------
    models : iterable of FittedModel
        Steps of an error ladder, from the base to the last.
    source_label : str
        Source of the data.
    noise_floor_rms : float, optional
        Noise floor of the training record, in the output's unit.
    """
    models = list(models)
    structures = [model.structure for model in models if isinstance(model.structure, Structure)]
    bases = {item.base.name: item.base.definition for item in structures if item.base.is_user_defined}
    forms = (form for structure in structures for form in structure.forms if form.definition)
    effects = {form.effect: form.definition for form in forms}
    content = {"schema": SCHEMA, "data": source_label, "noise_floor_rms": noise_floor_rms}
    definitions = {key: value for key, value in (("bases", bases), ("effects", effects)) if value}
    return {**content, **definitions, "models": [model.to_json() for model in models]}


def read_models(
    content, catalogues: Mapping[str, Mapping[str, Effect]], name: str = "models.json"
) -> list[FittedModel]:
    """Return the models of a file.

    Parameters
    ----------
    content : object
        Content of the file, as read from JSON.
    catalogues : mapping
        Effects by name for every system, as `lumbar.tissue.effects.catalogue.CATALOGUES`.
    name : str
        File name for messages.

    Raises
    ------
    InputError
        If a field of any model is missing, unknown or invalid. The message lists every place.
    """
    problems = Problems(name, most=20)
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        schema = repr(content.get("schema")) if isinstance(content, dict) else type(content).__name__
        problems.add("schema", schema, f"{SCHEMA!r} is needed; make the file again with identify or refine")
    elif content.get("models") == []:
        needed = (
            "a list of at least one is needed; only diagnosis.json contains linear dynamics behind a sensor"
        )
        problems.add("models", "no model", needed)
    elif not isinstance(content.get("models"), list):
        problems.add("models", repr(content.get("models")), "a list of models is needed")
    problems.raise_if_any()
    models = []
    for index, entry in enumerate(content["models"]):
        faults = Problems(f"models.{entry.get('name', index) if isinstance(entry, dict) else index}")
        fields = checked_entry(entry, catalogues, faults)
        models += [FittedModel(**fields)] if fields else []
        problems.extend(faults)
    problems.raise_if_any()
    return models
