"""The thesis's models fitted as passive ones, and what that costs: %VAF beside the free fits, and the damping they need."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.base.files import write_json
from lumbar.records.record import Record
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tables.described import described
from lumbar.tables.table import Table
from lumbar.tissue.haptics.closed_loop import SampledModel, all_angles
from lumbar.tissue.haptics.device_table import device_text, finite
from lumbar.tissue.haptics.judgement import analyse
from lumbar.tissue.haptics.passive_fit import Branches, DeviceCondition, fit_passive
from lumbar.tissue.haptics.rendered_model import export_at, render_model, renderable, scale_of
from lumbar.tissue.haptics.verdict import Analysis
from lumbar.tissue.identification.arx_search import IdentificationData
from lumbar.tissue.identification.identify_tissue import ports_of, scores_of
from lumbar.tissue.models.fitted_model import FittedModel, models_document
from lumbar.tissue.models.model_data import ARX, OUTPUT_ERROR
from lumbar.tissue.models.transfer_function import TransferFunction
from lumbar.tissue.signals.spectrum import motion_range

PASSIVE = "passive"
"""Estimator of these fits."""
_STRUCTURES = {"LE": (True, 0), "Maxwell": (False, 1), "KB": (True, 1), "HO": (True, None)}
"""Whether a model has a spring, and its number of Maxwell branches; None for as many as the data ask for."""
_FREE = {ARX: "free, ridge ARX", OUTPUT_ERROR: "free, output error"}
_ROUNDING = 1e-9


@dataclass(frozen=True)
class PassiveFits:
    """Free and passive fits of one record."""

    free: tuple[FittedModel, ...]
    """As identified, by both estimators."""
    passive: tuple[FittedModel, ...]
    """``<model>-passive``, and ``<model>-passive-<rate>Hz`` where the device is passive with it at that rate, too."""
    settings: RuntimeSettings
    rates: tuple[float, float]
    """That of identification and that of the servo, in Hz."""

    def table(self, source_label: str) -> Table:
        """Return the table model × (free, passive); `source_label` says where the records come from."""
        names = dict.fromkeys(model.name for model in self.free)
        rows = [row for name in names for row in _rows(name, self)]
        own, servo = self.rates
        words = {"device": device_text(self.settings.device), "own": own, "servo": servo}
        return described("tissue/haptics", "passive_fits", rows, source_label, words)

    def save(self, folder: Path, source_label: str) -> None:
        """Write ``passive_models.json`` and the table ``passive_fits``."""
        write_json(folder / "passive_models.json", models_document(self.passive, source_label))
        self.table(source_label).write(folder / "passive_fits")

    def __str__(self) -> str:
        return "\n".join(
            f"{model.name}: {model.scores.vaf_percent:.1f} %VAF, {model.remark}" for model in self.passive
        )


def fit_passive_models(
    models: Sequence[FittedModel],
    training: Record,
    tests: Sequence[Record],
    settings: RuntimeSettings,
    settling_s: float | None,
) -> PassiveFits:
    """Fit the exported models once more, within the passive ones; `settling_s` seconds at the start do not count.

    Those of a device are left out where the records hold no length or no force.
    """
    free = tuple(
        model
        for model in models
        if model.discrete and model.trained_on == training.name and model.name in settings.models
    )
    data = IdentificationData.from_record(training, settling_s)
    others = [IdentificationData.from_record(test, settling_s) for test in tests]
    rates = (slower := 1.0 / training.sampling_time, max(slower, settings.device.rate_Hz))
    passive = []
    for name in dict.fromkeys(model.name for model in free if model.name in _STRUCTURES):
        found = fit_passive(data, *_STRUCTURES[name])
        plain = _fitted(name, PASSIVE, found, training, data, others)
        passive.append(plain)
        for rate in dict.fromkeys(rates if renderable(plain) else ()):
            safe = found
            if not _on_device(plain, settings.model_copy(update={"output_rate_limit": None}), rate).passive:
                safe = fit_passive(data, *_STRUCTURES[name], device_condition(plain, settings, rate))
            passive.append(_fitted(name, f"{PASSIVE}-{rate:.4g}Hz", safe, training, data, others))
    return PassiveFits(free, tuple(passive), settings, rates)


def device_condition(model: FittedModel, settings: RuntimeSettings, rate: float) -> DeviceCondition:
    """What the device of the settings asks of a model's force at a rate in Hz."""
    metre, newton = scale_of(model.name, model.input, model.output)
    samples = export_at(model, settings, rate).moving_average
    average = np.full(samples, newton / metre / samples)
    rendering = SampledModel("", average, np.ones(1), 1.0 / rate).late(1e-3 * settings.device.delay_ms)
    return DeviceCondition(settings.device.damping_N_s_m, rendering)


def _fitted(
    name: str,
    ending: str,
    found: Branches,
    training: Record,
    data: IdentificationData,
    tests: list[IdentificationData],
) -> FittedModel:
    structure = found.transfer_function(data.sampling_time)
    return FittedModel(
        f"{name}-{ending}",
        structure,
        data.sampling_time,
        *ports_of(training, data.input_offset, data.output_offset),
        estimator=PASSIVE,
        trained_on=training.name,
        no_parameters_because=f"springs in parallel: {found}",
        scores=scores_of(structure, data, tests),
        remark=str(found),
        valid_for=motion_range(training["input"], data.sampling_time),
    )


def takes_energy(structure: TransferFunction) -> bool:
    """Whether a discrete model takes energy at every frequency: H(1) ≥ 0, and Im H(exp(jωT)) ≥ 0 for 0 < ωT < π.

    With the work of a force on the motion between its samples as the mean of their forces times the way, a sine of amplitude
    1 does the work π Im H in a cycle; a spring that pushes would give out energy without end.
    """
    response = SampledModel.of("", structure, 1.0).response(all_angles())
    rounding = _ROUNDING * np.abs(response).max()
    return bool(
        structure.stable and structure.static_gain >= -rounding and (response.imag >= -rounding).all()
    )


def _on_device(model: FittedModel, settings: RuntimeSettings, rate: float) -> Analysis:
    device = settings.device
    return analyse(render_model(export_at(model, settings, rate), device), device)


def _rows(name: str, fits: PassiveFits) -> list[dict]:
    free = {model.estimator: model for model in fits.free if model.name == name}
    best = free[OUTPUT_ERROR].scores.vaf_percent if OUTPUT_ERROR in free else None
    given = [(_FREE.get(estimator, estimator), "as identified", model) for estimator, model in free.items()]
    for model in fits.passive:
        base, _, ending = model.name.partition(f"-{PASSIVE}")
        if base == name:
            given.append(
                (f"{PASSIVE}{f' on the device at {ending[1:]}' if ending else ''}", model.remark, model)
            )
    rows = [_row(name, fit, consists, model, best, fits) for fit, consists, model in given]
    if name not in _STRUCTURES and OUTPUT_ERROR in free:
        none = {"consists_of": "none but 0", "takes_energy": "yes", "vaf_percent": 0.0, "vaf_cost": best}
        rows.append({"model": name, "fit": PASSIVE, **none})
    return rows


def _row(
    name: str, fit: str, consists: str, model: FittedModel, best: float | None, fits: PassiveFits
) -> dict:
    vaf = model.scores.vaf_percent
    tests = [value for value in model.scores.vaf_tests_percent if value is not None]
    own, servo = (_analysis(model, fits.settings, rate) for rate in fits.rates)
    return {
        "model": name,
        "fit": fit,
        "consists_of": consists,
        "takes_energy": "yes" if takes_energy(model.structure) else "NO",
        "vaf_percent": vaf,
        "vaf_cost": None
        if best is None or vaf is None or model.estimator == ARX
        else round(best - vaf, 6) + 0.0,
        "vaf_tests_percent": float(np.mean(tests)) if tests else None,
        "damping_at_own_rate_N_s_m": own and finite(own.damping),
        "damping_at_servo_rate_N_s_m": servo and finite(servo.damping),
        "gain_at_servo_rate": servo and finite(servo.gain),
    }


def _analysis(model: FittedModel, settings: RuntimeSettings, rate: float) -> Analysis | None:
    if not renderable(model):
        return None
    try:
        return _on_device(model, settings, rate)
    except NumericalError:
        return None  # no counterpart at this rate
