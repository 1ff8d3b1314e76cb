"""The rate at which models are trained and played: stiffness, fit, and what of it a hand feels.

The thesis identifies and plays its models at 100 Hz. Here they are identified anew at lower rates, and played at these and at
higher ones, each force held until the next. What a rate changes is the difference of the held force from that of the same
identification played a thousand times a second.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.records.record import Record, resample
from lumbar.settings.runtime import RuntimeSettings
from lumbar.settings.tissue import TissueSettings
from lumbar.tables.described import described
from lumbar.tables.table import Table
from lumbar.tissue.haptics.held_force import FINEST_HZ, WITHIN, held_force
from lumbar.tissue.haptics.judgement import analyse
from lumbar.tissue.haptics.rendered_model import export_at, render_model, renderable
from lumbar.tissue.identification.identify_tissue import without_intervals
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.tissue_models import HO, KB, MAXWELL
from lumbar.tissue.perception.felt import Felt, felt_columns, force_difference
from lumbar.tissue.perception.thresholds import Hands

RATES_HZ = (50.0, 100.0, 250.0, 500.0, FINEST_HZ)
_MODELS = (MAXWELL.name, KB.name, HO.name)


@dataclass(frozen=True)
class Rate:
    """One model, trained at one rate and played at one."""

    model: FittedModel
    trained_Hz: float
    played_Hz: float
    stable_gain: float
    felt: Felt | None
    """Its difference from the same model played at `FINEST_HZ`."""

    @property
    def stiffness(self) -> float:
        """Dynamic stiffness |H| at 1 Hz, in the model's units: a Maxwell model has no static one."""
        z = np.exp(2j * np.pi * self.model.sampling_time)
        structure = self.model.structure
        return float(
            abs(np.polyval(structure.numerator[::-1], 1 / z) / np.polyval(structure.denominator[::-1], 1 / z))
        )

    @property
    def stable_stiffness(self) -> float:
        """Largest stiffness with which the loop is stable; NaN where no device was asked."""
        return self.stiffness * self.stable_gain


def rates(
    training: Record,
    tests: Sequence[Record],
    tissue: TissueSettings,
    settings: RuntimeSettings,
    hands: Hands,
) -> tuple[list[Rate], list[str]]:
    """Maxwell, KB and HO by the estimator of the settings: every rate of training at its own rate, the highest at all rates.

    Rates above that of the records train nothing. Behind the models stands why a rate could not be trained at; a model that has
    no counterpart at a rate is left out there.
    """
    own = 1.0 / training.sampling_time
    found: list[Rate] = []
    refused = []
    for rate in (*(rate for rate in RATES_HZ if rate < own * (1 - WITHIN)), own):
        try:
            records = [record if rate == own else resample(record, rate) for record in (training, *tests)]
            models = without_intervals(records[0], records[1:], tissue)
        except (InputError, NumericalError) as error:
            refused.append(f"Not trained at {rate:g} Hz: {error}")
            continue
        played = {rate} if rate < own else {rate, *(item for item in RATES_HZ if item > own * (1 - WITHIN))}
        for model in models:
            if model.name in _MODELS and model.estimator == settings.estimator and model.stable:
                found += _played(model, training, rate, played, settings, hands)
    return found, refused


def _played(
    model: FittedModel,
    record: Record,
    trained: float,
    played: set[float],
    settings: RuntimeSettings,
    hands: Hands,
) -> Iterator[Rate]:
    plain = replace(settings, moving_average_ms=0.0, device_damping=None)
    time = np.arange(len(record)) * record.sampling_time
    finest = None
    for rate in sorted({FINEST_HZ, *played}, reverse=True):
        try:
            exported = export_at(model, plain, rate)
        except (InputError, NumericalError):
            continue
        force, position = held_force(exported, time, record["input"])
        finest = force if rate == FINEST_HZ else finest
        if rate not in played:
            continue
        met = None
        if finest is not None:
            met = force_difference(finest, force, model.output.unit, position, 1.0 / FINEST_HZ, hands)
        device, gain = settings.device, np.nan
        if renderable(exported):
            gain = analyse(render_model(exported, device), device).gain
        yield Rate(model, trained, rate, gain, met and met.felt)


def rates_table(found: Sequence[Rate], refused: Sequence[str], record: Record, data: str) -> Table:
    """Return the table model × rate of what `rates` found of a training record."""
    rows = [
        {
            "model": item.model.name,
            "trained_Hz": item.trained_Hz,
            "played_Hz": item.played_Hz,
            "vaf_percent": item.model.scores.vaf_percent,
            "stiffness": item.stiffness,
            "stable_stiffness": item.stable_stiffness if np.isfinite(item.stable_gain) else None,
            **felt_columns(item.felt),
        }
        for item in sorted(
            found, key=lambda item: (_MODELS.index(item.model.name), item.trained_Hz, item.played_Hz)
        )
    ]
    units = "/".join(record.channels[role].unit for role in ("output", "input"))
    return described(__file__, "rates", rows, data, {"record": record.name, "unit": units}, notes=refused)
