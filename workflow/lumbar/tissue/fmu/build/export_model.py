"""What is exported: a model with its signals, limits and fit, checked before anything is compiled."""

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
from lumbar.tissue.fmu.build.guards import Guards
from lumbar.tissue.fmu.build.linear_model import LinearModel, at_rate
from lumbar.tissue.fmu.conventions import WorkUnits, along_axes, slow_push, work_units
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.form import Place
from lumbar.tissue.models.model_data import GIVEN, MotionRange, Port, identifier

if TYPE_CHECKING:
    from lumbar.settings.runtime import RuntimeSettings

MAX_HISTORY = 512
"""Earlier inputs that an FMU keeps, for its moving average and its delay."""
AS_IN_THESIS = "-thesis"
"""Ending of the name of a model that is exported as the thesis's simulator ran it."""
_LARGEST_N = 15.0
"""Force in N that the thesis's device gives for a moment."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_.+-]{0,199}")


@dataclass(frozen=True)
class ExportModel:
    """A model ready for export: what was identified, and how it is run."""

    identified: FittedModel
    """The model under the name of the export, e.g. ``"KB+coulomb_friction"`` or ``"KB-thesis"``."""
    settings: RuntimeSettings
    """Limits, guards, start and rate; those of the thesis for a model that is run as in the thesis."""
    dynamics: LinearModel | EffectModel
    """Model from deviations of the input to deviations of the output."""
    sampling_time: float
    """Seconds."""
    moving_average: int
    """Samples of the input's moving average, the newest included; 1 is off."""
    runtime: str = ""
    """Text on how it is run if this differs from the settings, for description and documentation."""
    on_device: tuple[str, ...] = ()
    """Verdicts on the device of the study, for the documentation; empty without them."""

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
        if self.dynamics.kept > self.dynamics.max_kept:
            kept = f"{self.dynamics.kept} states", f"at most {self.dynamics.max_kept} fit into an FMU"
            problems.add("order" if isinstance(self.dynamics, LinearModel) else "effects", *kept)
        if self.guards.passive and not self.units.has_energy:
            problems.add(
                "runtime.device_damping",
                f"{self.input.unit} times {self.output.unit} is not an energy",
                "a length and a force or an angle and a torque are needed; leave the key empty",
            )
        if self.axes and self.guards.contact:
            problems.add(
                "runtime.contact",
                f"where tissue ends along {', '.join(self.axes)} no position alone says",
                "false is needed for a model of several axes",
            )
        if self.starts_at_rest and not self.dynamics.rests_anywhere:
            problems.add(
                "runtime.start",
                "a pole at 1: the model rests at no other input than its offset",
                "say runtime.start: offset",
            )
        if not (math.isfinite(self.sampling_time) and self.sampling_time > 0):
            problems.add("sampling_time_s", f"{self.sampling_time}", "a finite number above 0 is needed")
        if self.input.variable == self.output.variable:
            problems.add(
                "quantities", f"input and output are both {self.input.quantity!r}", "they need two names"
            )
        if not abs(self.output.offset) <= self.output_limit:
            problems.add(
                "output_offset",
                f"{self.output.offset}",
                f"it must lie within ±{self.output_limit:g} {self.output.unit}, runtime.output_limit: the largest output that "
                "your device may receive; give another in a study file (--config)",
            )
        problems.raise_if_any()

    @property
    def name(self) -> str:
        """Name in file names."""
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
        """Input from which the model's deviations are counted; in space shape (axes,)."""
        return np.array(self.identified.rests or (0.0,) * len(self.axes)) if self.axes else self.input.offset

    @property
    def output(self) -> Port:
        """Output: the response."""
        return self.identified.output

    @property
    def prescribed(self) -> bool:
        """Whether it was given, like IL, not identified."""
        return self.identified.estimator == GIVEN

    @property
    def valid_for(self) -> MotionRange | None:
        """Motion that the model was fitted to, if it is known."""
        return self.identified.valid_for

    @property
    def output_limit(self) -> float:
        """Largest magnitude of the output, in its unit."""
        return float(self.settings.output_limit)

    @property
    def gain_limit(self) -> float:
        """Largest factor on the output that a user may set."""
        return float(self.settings.gain_limit)

    @property
    def starts_at_rest(self) -> bool:
        """Whether the model rests at the first input; else it rested at the input's offset before."""
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
        """Whether the output depends on the input of the same sample."""
        return self.dynamics.feedthrough or self.guards.active

    @property
    def waits_for_input(self) -> bool:
        """Whether an output without the input of its sample would be meaningless."""
        return self.dynamics.waits_for_input or self.guards.active

    @property
    def history(self) -> int:
        """Earlier inputs kept."""
        return self.moving_average - 1 + self.dynamics.delay

    @property
    def units(self) -> WorkUnits:
        """Input and output in SI units."""
        return work_units(self.input.unit, self.output.unit)

    @cached_property
    def resistance(self) -> float:
        """Sign of the output that resists where it is displayed, 1 or −1.

        A prescribed model is displayed like the others, whatever its sign: an inverted one is active, and draws the tool in.
        """
        return 1.0 if self.prescribed else float(self.resisting_sign)

    @cached_property
    def resisting_sign(self) -> int:
        """Sign of the output that resists a growing input: 1, or −1 of an inverted model."""
        response = self.dynamics.response(along_axes(slow_push(self.sampling_time), len(self.axes)))
        return -1 if (response * along_axes(1.0, len(self.axes))).mean() < 0 else 1

    @property
    def stable(self) -> bool:
        """Whether all poles lie strictly inside the unit circle."""
        return self.dynamics.largest_pole < 1.0


def find_models(fitted: list[FittedModel], settings: RuntimeSettings) -> list[FittedModel]:
    """Pick the identified models that the settings name, in the order of ``settings.models``.

    A model without a training record (IL is prescribed, not identified) is taken whatever ``trained_on`` and ``estimator``
    say.

    Raises
    ------
    InputError
        A model is not there: all problems at once.
    """
    problems = Problems("runtime.models")
    first: dict[str, str] = {}
    for name in settings.models:
        if (known := first.setdefault(identifier(name), name)) != name:
            problems.add("", f"{name!r} and {known!r}", "rename one: both would have the same name in C")
    found = [_find(fitted, name, settings, problems) for name in settings.models]
    problems.raise_if_any()
    return [model for model in found if model is not None]


def export_models(fitted: list[FittedModel], settings: RuntimeSettings) -> list[ExportModel]:
    """Make fitted models ready for export.

    Raises
    ------
    InputError
        A model cannot be exported.
    NumericalError
        A model is unstable and ``unstable`` is ``"refuse"``.
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


def _find(
    models: list[FittedModel], name: str, settings: RuntimeSettings, problems: Problems
) -> FittedModel | None:
    own_name = name.removesuffix(AS_IN_THESIS)
    named = [model for model in models if model.name == own_name]
    fitting = [
        model
        for model in named
        if model.trained_on is None
        or (
            model.trained_on == settings.trained_on
            # A model with effects has one fit, by the error of its free run.
            and (not model.discrete or model.estimator == settings.estimator)
        )
    ]
    if len(fitting) == 1 and (fitting[0].discrete or name == own_name):
        return replace(fitting[0], name=name)
    if len(fitting) == 1:
        problems.add(name, "no transfer function", "the thesis ran no other model: take it without -thesis")
    elif not named:
        known = list(dict.fromkeys(model.name for model in models))
        problems.add(name, f"no such model{did_you_mean(own_name, known)}", f"there are: {', '.join(known)}")
    else:
        there = "; ".join(f"{model.estimator} on {model.trained_on}" for model in named)
        problems.add(
            name,
            f"{len(fitting)} fits by {settings.estimator!r} on {settings.trained_on!r}",
            f"set runtime.estimator and runtime.trained_on to one of: {there}",
        )
    return None


def _export_model(model: FittedModel, settings: RuntimeSettings) -> ExportModel:
    """Return a model at the rate of the settings, or as the thesis ran it.

    The thesis has "a moving average about the three previous points on the position measurements": without the newest one.
    """
    is_as_in_thesis = model.name.endswith(AS_IN_THESIS)
    if is_as_in_thesis:
        settings = _settings_of_thesis(settings, model)
    wanted = model.sampling_time if settings.rate_Hz is None else 1.0 / settings.rate_Hz
    if model.discrete:
        linear = LinearModel(model.structure.numerator, model.structure.denominator, name=model.name)
        dynamics = at_rate(linear, model.sampling_time, wanted)
    else:
        dynamics = effect_model(model, wanted)
    # The rotation of the force sensor's axes is not part of the tissue.
    forms = getattr(model.structure, "forms", ())
    sensor = " and ".join(form.effect.replace("_", " ") for form in forms if form.place is Place.FRAME)
    runtime = f"Forces are along the axes of the position: {sensor} of the force sensor is left out."
    if is_as_in_thesis:
        dynamics = replace(dynamics, delay=dynamics.delay + 1)
        runtime = (
            f"Run as in the thesis (section 3.2.3.2): at {1 / model.sampling_time:g} Hz, on the mean of the three samples before "
            f"the newest, within {settings.output_limit:g} {model.output.unit}; to compare with, not for a faster loop."
        )
    return ExportModel(
        identified=model,
        settings=settings,
        dynamics=dynamics,
        sampling_time=wanted,
        moving_average=averaged_samples(model.name, settings.moving_average_ms, wanted),
        runtime=runtime if sensor or is_as_in_thesis else "",
    )


def _settings_of_thesis(settings: RuntimeSettings, model: FittedModel) -> RuntimeSettings:
    """Return the runtime of the thesis's section 3.2.3.2.

    The limit is the largest transient force of its device (section 3.2.3), or that of the settings' device if this is less,
    or if the model's output is not a force.
    """
    units = work_units(model.input.unit, model.output.unit)
    newton = units.force if units.is_of_length else 0.0
    return settings.model_copy(
        update={
            "rate_Hz": None,
            "moving_average_ms": 3000.0 * model.sampling_time,
            "output_limit": min(settings.output_limit, _LARGEST_N / newton if newton else math.inf),
            "output_rate_limit": None,
            "contact": False,
            "device_damping": None,
            "start": "offset",
        }
    )


def averaged_samples(name: str, milliseconds: float, sampling_time: float) -> int:
    """Return the samples of the moving average, to the nearest whole number; an average of none is an error."""
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
