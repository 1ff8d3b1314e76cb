"""The exported model: fit, signals, limits and guards, checked before anything is compiled."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import NumericalError, Problems, did_you_mean
from lumbar.base.files import is_device
from lumbar.tissue.fmu.build.effect_model import EffectModel, effect_model
from lumbar.tissue.fmu.build.linear_model import LinearModel, resample_model
from lumbar.tissue.fmu.conventions import WorkUnits, along_axes, slow_push, work_units
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.form import Place
from lumbar.tissue.models.model_data import GIVEN, MotionRange, Port, identifier

if TYPE_CHECKING:
    from lumbar.settings.runtime import RuntimeSettings

MAX_HISTORY = 512
"""Number of earlier inputs that an FMU stores, for its moving average and its delay."""
AS_IN_THESIS = "-thesis"
"""End of the name of a model that is exported as it ran in the thesis's simulator."""
_MAX_THESIS_FORCE_N = 15.0
"""Largest transient force of the thesis's device (section 3.2.3)."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_.+-]{0,199}")


@dataclass(frozen=True)
class Guards:
    """Guards of the force that the device receives."""

    contact: bool = False
    """True if the tissue cannot pull and its surface is at the input's offset: below the offset, the model is at rest."""
    rate_limit: float = 0.0
    """Largest change of the force per second, in the output's unit; 0: no limit."""
    device_damping: float = 0.0
    """Smallest damping of the device in N·s/m (rotations: N·m·s/rad). With it the force is limited so that device and FMU never
    release more energy than they received; 0: no limit."""
    energy_reserve: float = 0.0
    """Largest received energy in J that may be released again."""

    @property
    def passive(self) -> bool:
        """True if device and FMU never release more energy than they received."""
        return self.device_damping > 0

    @property
    def active(self) -> bool:
        """True if a guard makes the force depend on earlier forces."""
        return self.passive or self.rate_limit > 0


@dataclass(frozen=True)
class ExportModel:
    """A model ready for export: the fit, and how it is run."""

    identified: FittedModel
    """The model under the name of the export, e.g. ``"KB+coulomb_friction"`` or ``"KB-thesis"``."""
    settings: RuntimeSettings
    """Limits, guards, start and rate; a model that runs as in the thesis has the thesis's values."""
    dynamics: LinearModel | EffectModel
    """Model from deviations of the input to deviations of the output."""
    sampling_time: float
    """Sampling time in seconds."""
    moving_average: int
    """Number of samples of the input's moving average, the newest included; 1: no average."""
    runtime: str = ""
    """Note for description and documentation if the model does not run as in the settings."""
    on_device: tuple[str, ...] = ()
    """Sentences for the documentation with the verdicts on the study's device; may be empty."""

    def __post_init__(self):
        problems = Problems(f"model {self.name!r}")
        if not _NAME.fullmatch(self.name) or is_device(self.name):
            allowed = "a letter, then letters, digits, _ . + -, at most 200, and no device of Windows"
            problems.add("name", repr(self.name), f"{allowed} (it becomes a file name)")
        if not (self.moving_average >= 1 and self.history <= MAX_HISTORY):
            problems.add(
                "runtime.moving_average_ms",
                f"{self.moving_average} samples, and {self.dynamics.delay} of delay, at {1 / self.sampling_time:g} Hz",
                f"at least 1, and {MAX_HISTORY} in all, fit into an FMU",
            )
        if self.memory > self.dynamics.max_memory:
            problems.add(
                "order" if isinstance(self.dynamics, LinearModel) else "effects",
                f"{self.memory} states",
                f"at most {self.dynamics.max_memory} fit into an FMU",
            )
        if self.guards.passive and not self.units.has_energy:
            problems.add(
                "runtime.device_damping",
                f"{self.input.unit} times {self.output.unit} is not an energy",
                "a length and a force or an angle and a torque are needed; leave the key empty",
            )
        if self.axes and self.guards.contact:
            problems.add(
                "runtime.contact",
                f"along {', '.join(self.axes)} a position alone does not tell where the tissue ends",
                "set it to false for a model of several axes",
            )
        if self.starts_at_rest and not self.dynamics.rests_anywhere:
            problems.add(
                "runtime.start",
                "a pole at 1: the model rests at no other input than its offset",
                "set runtime.start: offset",
            )
        if not (math.isfinite(self.sampling_time) and self.sampling_time > 0):
            problems.add("sampling_time_s", f"{self.sampling_time}", "a finite number above 0 is needed")
        if self.input.variable == self.output.variable:
            fault = f"input and output are both {self.input.quantity!r}"
            problems.add("quantities", fault, "they need two names")
        if not abs(self.output.offset) <= self.output_limit:
            problems.add(
                "output_offset",
                f"{self.output.offset}",
                f"it must be within ±{self.output_limit:g} {self.output.unit}, runtime.output_limit: the largest output that "
                "your device may receive; set another in a study file (--config)",
            )
        problems.raise_if_any()

    @property
    def name(self) -> str:
        """Name of the model in file names."""
        return self.identified.name

    @property
    def identifier(self) -> str:
        """FMI's model identifier: a name that C allows."""
        return identifier(self.name)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes in space; empty along one axis."""
        return self.dynamics.axes

    @property
    def input(self) -> Port:
        """Input: the motion of the tool."""
        return self.identified.input

    @property
    def rest(self) -> float | np.ndarray:
        """Input at rest, from which the model's deviations count; in space shape (axes,)."""
        return np.array(self.identified.rests or (0.0,) * len(self.axes)) if self.axes else self.input.offset

    @property
    def output(self) -> Port:
        """Output: the response."""
        return self.identified.output

    @property
    def prescribed(self) -> bool:
        """True if the model is prescribed, like IL, not identified."""
        return self.identified.estimator == GIVEN

    @property
    def valid_for(self) -> MotionRange | None:
        """Motion that the model was fitted to; None if it is unknown."""
        return self.identified.valid_for

    @property
    def output_limit(self) -> float:
        """Largest magnitude of the output, in its unit."""
        return float(self.settings.output_limit)

    @property
    def starts_at_rest(self) -> bool:
        """True if the model starts at rest at the first input; false if it starts at rest at the input's offset."""
        return self.settings.start == "first_position"

    @cached_property
    def guards(self) -> Guards:
        """Guards of the force that the device receives."""
        return Guards(
            contact=self.settings.contact,
            rate_limit=float(self.settings.output_rate_limit or 0.0),
            device_damping=float(self.settings.device_damping or 0.0),
            energy_reserve=float(self.settings.energy_reserve),
        )

    @property
    def feedthrough(self) -> bool:
        """True if the output depends on the input of the same sample."""
        return self.dynamics.feedthrough or self.guards.active

    @property
    def history(self) -> int:
        """Number of earlier inputs that the FMU stores."""
        return self.moving_average - 1 + self.dynamics.delay

    @property
    def memory(self) -> int:
        """Number of states, including the earlier positions of effects."""
        return self.dynamics.states + sum(self.dynamics.histories)

    @property
    def units(self) -> WorkUnits:
        """Input and output in SI units."""
        return work_units(self.input.unit, self.output.unit)

    @cached_property
    def resistance(self) -> float:
        """Sign of a resisting output on the device, 1 or −1.

        A prescribed model is displayed like the others, whatever its sign: an inverted one is active, and draws the tool in.
        """
        return 1.0 if self.prescribed else float(self.resisting_sign)

    @cached_property
    def resisting_sign(self) -> int:
        """Sign of the output that resists a growing input: 1, or −1 for an inverted model."""
        response = self.dynamics.response(along_axes(slow_push(self.sampling_time), len(self.axes)))
        return -1 if (response * along_axes(1.0, len(self.axes))).mean() < 0 else 1

    @property
    def stable(self) -> bool:
        """True if all poles are strictly inside the unit circle."""
        return self.dynamics.largest_pole < 1.0


def find_models(fitted: list[FittedModel], settings: RuntimeSettings) -> list[FittedModel]:
    """Return the identified models that the settings name, in the order of ``settings.models``.

    ``trained_on`` and ``estimator`` do not apply to a model without a training record: IL is prescribed, not identified.

    Raises
    ------
    InputError
        If a model does not exist or has several fits. The message lists all problems.
    """
    problems = Problems("runtime.models")
    by_identifier: dict[str, str] = {}
    chosen = []
    for name in settings.models:
        if (other := by_identifier.setdefault(identifier(name), name)) != name:
            problems.add("", f"{name!r} and {other!r}", "rename one: both would have the same name in C")
        base_name = name.removesuffix(AS_IN_THESIS)
        named = [model for model in fitted if model.name == base_name]
        # A model with effects has one fit, by the error of its free run, whatever the estimator.
        fits = [
            model
            for model in named
            if model.trained_on in (None, settings.trained_on)
            and (model.trained_on is None or not model.discrete or model.estimator == settings.estimator)
        ]
        if not named:
            known = list(dict.fromkeys(model.name for model in fitted))
            problems.add(
                name, f"no such model{did_you_mean(base_name, known)}", f"there are: {', '.join(known)}"
            )
        elif len(fits) != 1:
            there = "; ".join(f"{model.estimator} on {model.trained_on}" for model in named)
            problems.add(
                name,
                f"{len(fits)} fits by {settings.estimator!r} on {settings.trained_on!r}",
                f"set runtime.estimator and runtime.trained_on to one of: {there}",
            )
        elif not fits[0].discrete and name != base_name:
            problems.add(
                name, "no transfer function", "the thesis ran no other model: take it without -thesis"
            )
        else:
            chosen.append(replace(fits[0], name=name))
    problems.raise_if_any()
    return chosen


def export_models(fitted: list[FittedModel], settings: RuntimeSettings) -> list[ExportModel]:
    """Make fitted models ready for export.

    Raises
    ------
    InputError
        If a model cannot be exported.
    NumericalError
        If a model is unstable and ``unstable`` is ``"refuse"``.
    """
    models = [_export_model(model, settings) for model in fitted]
    unstable = [model for model in models if not model.stable and settings.unstable == "refuse"]
    if unstable:
        poles = ", ".join(
            f"{model.name} (largest |pole| {model.dynamics.largest_pole:.6g})" for model in unstable
        )
        raise NumericalError(
            f"unstable, not exported: {poles}. Take the model out of runtime.models, use another runtime.trained_on or "
            "runtime.estimator, or set runtime.unstable: export (the output then runs into its limit)"
        )
    return models


def _export_model(model: FittedModel, settings: RuntimeSettings) -> ExportModel:
    """Return a model ready for export at the rate of the settings, or as in the thesis (section 3.2.3.2).

    The thesis has "a moving average about the three previous points on the position measurements", without the newest point.
    """
    # The rotation of the force sensor's axes is not part of the tissue.
    forms = getattr(model.structure, "forms", ())
    sensor = " and ".join(form.effect.replace("_", " ") for form in forms if form.place is Place.FRAME)
    runtime = f"Forces are along the axes of the position: {sensor} of the force sensor is left out."
    runtime = runtime if sensor else ""
    is_as_in_thesis = model.name.endswith(AS_IN_THESIS)
    if is_as_in_thesis:
        units = work_units(model.input.unit, model.output.unit)
        largest = _MAX_THESIS_FORCE_N / units.force if units.is_of_length else math.inf
        limit = min(settings.output_limit, largest)
        settings = settings.model_copy(
            update={
                "rate_Hz": None,
                "moving_average_ms": 3000.0 * model.sampling_time,
                "output_limit": limit,
                "output_rate_limit": None,
                "contact": False,
                "device_damping": None,
                "start": "offset",
            }
        )
        runtime = (
            f"Run as in the thesis (section 3.2.3.2): at {1 / model.sampling_time:g} Hz, on the mean of the three samples before "
            f"the newest, within {limit:g} {model.output.unit}; to compare with, not for a faster loop."
        )
    sampling_time = model.sampling_time if settings.rate_Hz is None else 1.0 / settings.rate_Hz
    if model.discrete:
        coefficients = model.structure.numerator, model.structure.denominator
        linear = LinearModel(*coefficients, name=model.name, delay=int(is_as_in_thesis))
        dynamics = resample_model(linear, model.sampling_time, sampling_time)
    else:
        dynamics = effect_model(model, sampling_time)
    return ExportModel(
        identified=model,
        settings=settings,
        dynamics=dynamics,
        sampling_time=sampling_time,
        moving_average=averaged_samples(model.name, settings.moving_average_ms, sampling_time),
        runtime=runtime,
    )


def averaged_samples(name: str, milliseconds: float, sampling_time: float) -> int:
    """Return the length of the moving average in whole samples; reject a length between 0 and half a sample."""
    samples = milliseconds / (1000 * sampling_time)
    if milliseconds > 0 and samples < 0.5:
        problems = Problems(f"model {name!r}")
        problems.add(
            "runtime.moving_average_ms",
            f"{milliseconds:g} ms is less than a sample at {1 / sampling_time:g} Hz",
            f"0 is off; the thesis's three samples are {3000 * sampling_time:g}",
        )
        problems.raise_if_any()
    return max(1, round(samples))
