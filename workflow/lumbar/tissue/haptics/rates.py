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
from lumbar.tissue.haptics.held_force import FINEST_HZ, held_force
from lumbar.tissue.haptics.judgement import analyse
from lumbar.tissue.haptics.rendered_model import export_at, render_model
from lumbar.tissue.identification.identify_tissue import without_intervals
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.tissue_models import HO, KB, MAXWELL
from lumbar.tissue.perception.felt import Felt, felt_columns, force_difference
from lumbar.tissue.perception.thresholds import Hands

RATES_HZ = (50.0, 100.0, 250.0, 500.0, FINEST_HZ)
_MODELS = (MAXWELL.name, KB.name, HO.name)
_WITHIN = 1e-3
"""Share of a sample within which an instant counts as reached."""


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
        """Largest stiffness with which the loop is stable."""
        return self.stiffness * self.stable_gain


def rates(
    training: Record,
    tests: Sequence[Record],
    tissue: TissueSettings,
    settings: RuntimeSettings,
    hands: Hands,
) -> Iterator[Rate]:
    """Maxwell, KB and HO by the estimator of the settings: every rate of training at its own rate, the highest at all rates.

    Rates above that of the records train nothing. A model that has no counterpart at a rate is left out there.
    """
    own = 1.0 / training.sampling_time
    trained = [rate for rate in RATES_HZ if rate < own * (1 - _WITHIN)]
    for rate in (*trained, own):
        records = (
            [training, *tests] if rate == own else [resample(record, rate) for record in (training, *tests)]
        )
        played = [item for item in RATES_HZ if item > own * (1 - _WITHIN)] if rate == own else []
        for model in without_intervals(records[0], records[1:], tissue):
            if model.name in _MODELS and model.estimator == settings.estimator and model.stable:
                yield from _played(model, training, rate, {rate, *played}, settings, hands)


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
        gain = analyse(render_model(exported, settings.device), settings.device).gain
        yield Rate(model, trained, rate, gain, met and met.felt)


def rates_table(found: Sequence[Rate], record: str, data: str) -> Table:
    """Return the table model × rate."""
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
    model = found[0].model
    return described(
        __file__, "rates", rows, data, {"record": record, "unit": f"{model.output.unit}/{model.input.unit}"}
    )
