"""What running a model costs: the exported force beside the identified model's on the training record, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from lumbar.records.record import Record
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tables.table import Table
from lumbar.tissue.fmu.build.export_model import AS_IN_THESIS, ExportModel, export_models, settings_of_thesis
from lumbar.tissue.fmu.build.reference_response import model_output, reference_output
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.signals.settling import settling_time

_WITHIN = 1e-3
"""Share of a sample within which an instant counts as reached, as in ``sampled_force.c``."""
_DIGITS = 6
"""After the point: less is rounding where a step changes nothing."""
_COLUMNS = {
    "model": ("Model", "Name of the model; -thesis as the thesis ran it"),
    "rate_Hz": ("Rate (Hz)", "Rate at which the file samples the position"),
    "lag_ms": ("Lag (ms)", "By how much moving average and left-out sample let the position come late"),
    "fit_error": ("Fit off record (%s)", "RMS difference of the identified model's free run from the record"),
    "sampling": (
        "Own sampling (%s)",
        "RMS change of the force by the file's own sampling: positions in straight lines between the record's samples, and, "
        "with effects, velocities that know no later sample",
    ),
    "average": ("Average (%s)", "RMS change by the moving average over the newest positions"),
    "late_sample": (
        "Newest left out (%s)",
        "RMS change where the average ends with the position before the newest",
    ),
    "limit": ("Limit (%s)", "RMS change by the limit and the guards"),
    "all": ("File off fit (%s)", "RMS difference of the file's force from the identified model's"),
    "file_error": (
        "File off record (%s)",
        "RMS difference of the file's force, read in event mode, from the record",
    ),
    "file_error_fmi2": (
        "Read as FMI 2.0 (%s)",
        "The same where the feed-through, with effects and guards the whole force, is read a sample late",
    ),
}


def runtime_error_table(
    models: Sequence[FittedModel],
    record: Record,
    settings: RuntimeSettings,
    settling_s: float | None,
    data: str,
) -> Table:
    """Return the table model × step, one row per model of `find_models` as it is exported.

    All files are given the position of the record, and `settling_s` seconds at its start do not count.
    """
    import pandas as pd

    unit = models[0].output.unit
    return Table(
        title="What running a model costs: forces of the files on the record of training.",
        frame=pd.DataFrame([_row(model, record, settings, settling_s) for model in models]),
        data=data,
        definitions={name: text for name, (_, text) in _COLUMNS.items()},
        notes=(
            f"Record {record.name}. Each step is added to those left of it; as RMS values the changes need not add up. The "
            "record's noise is in what is off the record, not in the changes.",
        ),
        headers={name: words.replace("%s", unit) for name, (words, _) in _COLUMNS.items()},
        decimals={"rate_Hz": 0, "lag_ms": 1, **dict.fromkeys(list(_COLUMNS)[3:], 3)},
    )


def _row(model: FittedModel, record: Record, settings: RuntimeSettings, settling_s: float | None) -> dict:
    (exported,) = export_models([model], settings)
    prompt = _with_newest(model, exported, settings)
    late = exported.dynamics.delay - prompt.dynamics.delay
    position, read_at = _positions(record, exported.sampling_time)
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

    changes = [rms(after - before) for before, after in pairwise(steps)]
    return {
        "model": model.name,
        "rate_Hz": 1.0 / exported.sampling_time,
        "lag_ms": 1e3 * exported.sampling_time * ((exported.moving_average - 1) / 2 + late),
        "fit_error": rms(steps[0] - record["output"]),
        **dict(zip(("sampling", "average", "late_sample", "limit"), changes, strict=True)),
        "all": rms(steps[-1] - steps[0]),
        "file_error": rms(steps[-1] - record["output"]),
        "file_error_fmi2": rms(as_fmi2 - record["output"]),
    }


def _with_newest(model: FittedModel, exported: ExportModel, settings: RuntimeSettings) -> ExportModel:
    """The model with an average that ends with the newest position: what it is, but as the thesis ran it."""
    if not model.name.endswith(AS_IN_THESIS):
        return exported
    plain = replace(model, name=model.name.removesuffix(AS_IN_THESIS))
    return export_models([plain], settings_of_thesis(settings, model))[0]


def _positions(record: Record, sampling_time: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions at a file's samples, and the sample whose force is held at each instant of the record."""
    time = np.arange(len(record["input"])) * record.sampling_time
    read_at = np.floor(time / sampling_time + _WITHIN).astype(int)
    own = np.arange(read_at[-1] + 1) * sampling_time
    return np.interp(own, time, record["input"]), read_at
