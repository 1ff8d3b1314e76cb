"""What the commands on a folder of records share: reading it, and which model and records are meant."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.cli.settings import load_settings, record_files
from lumbar.errors import InputError

if TYPE_CHECKING:
    from lumbar.settings.improvement import ImprovementSettings
    from lumbar.settings.layout import ColumnLayout


def add_model(parser: argparse.ArgumentParser, effects_required: bool = False) -> None:
    """Add the folder, ``--add EFFECT`` and the options of `add_selection`."""
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="one file per excitation")
    parser.add_argument(
        "--add",
        action="append",
        default=[],
        required=effects_required,
        metavar="EFFECT",
        help="effect added to the base; may be given several times",
    )
    add_selection(parser)


def fitted_model(options):
    """Read the folder and fit the base with the effects of ``--add``.

    Returns
    -------
    StudySettings
    list of Record
    DiagnosisSettings
        Of `lumbar.diagnosis.fitting.diagnosis_settings`.
    Experiment
    list of Candidate
        The ladder: base, base and first effect, ….
    """
    from lumbar.diagnosis.selection.refine import refine

    settings, records, chosen = read_and_choose(options)
    return settings, records, chosen, *refine(records, options.add, chosen)


def read_and_choose(options):
    """Read the folder as the base asks, and take the options and settings together.

    Returns
    -------
    StudySettings
    list of Record
    DiagnosisSettings
        Of `lumbar.diagnosis.fitting.diagnosis_settings`.
    """
    from lumbar.config.study_recordings import record_layout

    settings = load_settings(options.config)
    chosen = selection(options, settings.improvement)
    return settings, read_folder(options.folder, *record_layout(settings, chosen.base)), chosen


def simulated_model(options):
    """Fit the model of the options and simulate it on every record of the folder.

    Returns
    -------
    str
        Name of the model.
    list of Simulated
    str
        Label of the data.
    """
    from lumbar.diagnosis.residuals.residual_report import compare_and_locate
    from lumbar.diagnosis.selection.refined_model import model_name

    settings, records, chosen, experiment, ladder = fitted_model(options)
    fit, training = ladder[-1].fit, experiment.floor_from
    simulated = compare_and_locate(records, fit, experiment.floor, training, settings.seed, chosen.centre)
    return model_name(fit), simulated, options.data or options.folder.name


def add_selection(parser: argparse.ArgumentParser) -> None:
    """Add ``--base``, ``--train`` and ``--period``."""
    parser.add_argument(
        "--base",
        metavar="MODEL",
        help="base model: LE, Maxwell, KV, KB or pendulum (default: the settings'); the pendulum's records are "
        "time_s,angle_rad,moment_Nm",
    )
    parser.add_argument(
        "--train",
        metavar="NAME",
        action="append",
        help="record to fit on (default: the longest); may be given several times, to fit on several together",
    )
    parser.add_argument(
        "--period",
        action="append",
        default=[],
        metavar="NAME=SECONDS",
        help="period of a record's excitation (default: found from the input)",
    )


def read_folder(folder: Path, layout: ColumnLayout, rate: float | None) -> list:
    """Read every column file of a folder as a record, resampled to `rate` in hertz where one is given."""
    from lumbar.records.columns import read_record
    from lumbar.records.record import same_units

    records = [read_record(path, layout, rate=rate) for path in record_files(folder)]
    same_units(records)
    return records


def selection(options, improvement: ImprovementSettings):
    """Return the `lumbar.diagnosis.fitting.diagnosis_settings.DiagnosisSettings` of the options and the configuration."""
    from lumbar.diagnosis.fitting.diagnosis_settings import DiagnosisSettings

    return DiagnosisSettings.from_improvement(
        improvement, base=options.base, train=options.train, periods=dict(map(_period, options.period))
    )


def _period(text: str) -> tuple[str, float]:
    name, _, seconds = text.partition("=")
    try:
        value = float(seconds)
    except ValueError:
        value = 0.0
    if not name or not 0 < value < float("inf"):
        raise InputError(f"--period {text!r}: NAME=SECONDS with positive seconds is needed")
    return name, value
