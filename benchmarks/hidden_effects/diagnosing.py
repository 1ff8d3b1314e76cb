"""Diagnosing folders of tissue tests without knowing what is hidden in them."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from lumbar.base.errors import InputError, NumericalError
from lumbar.records.columns import read_record
from lumbar.records.record import Record
from lumbar.settings.tissue import TissueSettings
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose

LAYOUT = TissueSettings().layout
"""Columns of the recordings."""


def read_folder(folder: str | os.PathLike) -> list[Record]:
    """Read every CSV file of one experiment; nothing else in the folder is looked at.

    Raises
    ------
    InputError
        If a record is missing or cannot be analysed.
    """
    files = sorted(Path(folder).glob("*.csv"))
    if not files:
        raise InputError(f"{folder}: holds no CSV file; a set of tissue tests has one per excitation")
    return [read_record(file, LAYOUT) for file in files]


def diagnose_folders(
    folder: str | os.PathLike, diagnosis: Callable[[list[Record]], dict] | None = None
) -> dict[str, dict]:
    """Diagnose every experiment below a folder.

    Parameters
    ----------
    folder : path
        Holds one folder of recordings per experiment.
    diagnosis : callable, optional
        Takes the records of one experiment and returns its diagnosis as plain data; by default `diagnose` with default
        settings.

    Returns
    -------
    dict of str to dict
        Diagnosis by experiment. One that reached no result is ``{"error": message}``: it counts against the
        diagnosis instead of ending the benchmark.
    """
    diagnosis = diagnosis or _diagnosis
    experiments = sorted(path for path in Path(folder).iterdir() if path.is_dir())
    if not experiments:
        raise InputError(f"{folder}: holds no folder of an experiment")
    diagnoses = {}
    for experiment in experiments:
        records = read_folder(experiment)
        try:
            diagnoses[experiment.name] = diagnosis(records)
        except (InputError, NumericalError) as error:
            diagnoses[experiment.name] = {"error": str(error)}
    return diagnoses


def _diagnosis(records: list[Record]) -> dict:
    return diagnose(records).to_json()
