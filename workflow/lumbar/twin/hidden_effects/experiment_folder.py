"""Writing experiments: one folder of CSV files each, and the truth in ``labels.json`` beside them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.files import write_json, write_text
from lumbar.twin.hidden_effects.experiment import HiddenExperiment, Plan, check_settings, make_experiment

if TYPE_CHECKING:
    from lumbar.settings.hidden_effects import HiddenEffectsSettings

HEADER = "time_s,position_mm,force_N"


def write_experiment(folder: str | os.PathLike, experiment: HiddenExperiment) -> None:
    """Write one CSV file per record: header ``time_s,position_mm,force_N``, five decimals."""
    for name, values in experiment.records.items():
        lines = ["%.2f,%.5f,%.5f" % row for row in map(tuple, values.tolist())]  # noqa: UP031 - twice as fast
        write_text(Path(folder) / f"{name}.csv", "\n".join([HEADER, *lines]) + "\n")


def write_experiments(
    folder: str | os.PathLike, labels: str | os.PathLike, plans: list[Plan], settings: HiddenEffectsSettings
) -> None:
    """Make experiments and write their recordings and, apart, the truth.

    Parameters
    ----------
    folder : path
        Gets one folder per experiment.
    labels : path
        JSON file: the truth by experiment.

    Raises
    ------
    InputError
        If the settings contradict themselves; nothing is written.
    """
    check_settings(settings)
    truth = {}
    for plan in plans:
        experiment = make_experiment(plan, settings)
        write_experiment(Path(folder) / plan.name, experiment)
        truth[plan.name] = experiment.label
    write_json(labels, truth)
