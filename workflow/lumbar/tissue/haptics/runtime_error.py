"""What running a model costs: the exported force beside the identified model's on the training record, step by step."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from lumbar.records.record import Record
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tables.described import described
from lumbar.tables.table import Table
from lumbar.tissue.fmu.build.export_model import AS_IN_THESIS, ExportModel, export_models, settings_of_thesis
from lumbar.tissue.fmu.build.reference_response import model_output, reference_output
from lumbar.tissue.haptics.held_force import held_samples
from lumbar.tissue.identification.metrics import settling_time
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.perception.felt import felt_columns, force_difference
from lumbar.tissue.perception.thresholds import Hands

_DIGITS = 6
"""After the point: less is rounding where a step changes nothing."""


def runtime_error_table(
    models: Sequence[FittedModel],
    record: Record,
    settings: RuntimeSettings,
    settling_s: float | None,
    hands: Hands,
    data: str,
) -> Table:
    """Return the table model × step, one row per model of `find_models` as it is exported.

    All files are given the position of the record, and `settling_s` seconds at its start do not count.
    """
    rows = [_row(model, record, settings, settling_s, hands) for model in models]
    words = {"record": record.name, "unit": models[0].output.unit}
    return described(__file__, "runtime_error", rows, data, words)


def _row(
    model: FittedModel, record: Record, settings: RuntimeSettings, settling_s: float | None, hands: Hands
) -> dict:
    (exported,) = export_models([model], settings)
    prompt = _with_newest(model, exported, settings)
    late = exported.dynamics.delay - prompt.dynamics.delay
    time = np.arange(len(record)) * record.sampling_time
    position, read_at = held_samples(time, record["input"], exported.sampling_time, time)
    steps = [
        model.simulate(record),
        *(
            (model_output(item, position) + model.output.offset)[read_at]
            for item in (replace(prompt, moving_average=1), prompt, exported)
        ),
        reference_output(exported, position, "3.0")[read_at],
    ]
    as_fmi2 = reference_output(exported, position, "2.0")[read_at]
    settled = slice(round(settling_time(record, settling_s) / record.sampling_time), None)

    def rms(values: np.ndarray) -> float:
        return round(float(np.sqrt(np.mean(values[settled] ** 2))), _DIGITS)

    own, file = steps[0][settled], steps[-1][settled]
    met = force_difference(
        own, file, model.output.unit, record["input"][settled], record.sampling_time, hands
    )
    felt = felt_columns(met and met.felt)
    changes = [rms(after - before) for before, after in pairwise(steps)]
    return {
        "model": model.name,
        "rate_Hz": 1.0 / exported.sampling_time,
        "lag_ms": 1e3 * exported.sampling_time * ((exported.moving_average - 1) / 2 + late),
        "fit_error": rms(steps[0] - record["output"]),
        **dict(zip(("sampling", "average", "late_sample", "limit"), changes, strict=True)),
        "all": rms(steps[-1] - steps[0]),
        "file_error": rms(steps[-1] - record["output"]),
        "file_felt_jnd": felt["felt_jnd"],
        "file_told_apart_percent": felt["told_apart_percent"],
        "file_error_fmi2": rms(as_fmi2 - record["output"]),
    }


def _with_newest(model: FittedModel, exported: ExportModel, settings: RuntimeSettings) -> ExportModel:
    """The model with an average that ends with the newest position: what it is, but as the thesis ran it."""
    if not model.name.endswith(AS_IN_THESIS):
        return exported
    plain = replace(model, name=model.name.removesuffix(AS_IN_THESIS))
    return export_models([plain], settings_of_thesis(settings, model))[0]
