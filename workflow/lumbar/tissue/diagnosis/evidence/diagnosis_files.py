"""Writing a diagnosis for machines: JSON, the error ladder as a table, the excitation that would break a tie."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from lumbar.base.files import write_json, write_text
from lumbar.tissue.diagnosis.design.discrimination import excitation_csv
from lumbar.tissue.diagnosis.evidence.evidence import Evidence
from lumbar.tissue.diagnosis.selection.verdict import Verdict

LADDER_COLUMNS = ("rung", "effects", "forms", "train_rms", "test_rms", "unit", "noise_floor_rms", "data")
EXCITATION = "separating_excitation.csv"


def write_diagnosis(diagnosis: Verdict, evidence: Evidence, folder: Path, data: str) -> None:
    """Write ``diagnosis.json``, ``ladder.csv`` and, where effects are tied, ``separating_excitation.csv``.

    An excitation that an earlier diagnosis left in the folder is taken away: it does not belong to this one.

    Parameters
    ----------
    data : str
        Where the data come from.
    """
    write_json(folder / "diagnosis.json", diagnosis_document(diagnosis, evidence, data))
    write_text(folder / "ladder.csv", ladder_csv(diagnosis, data))
    if evidence.separation is None or not evidence.separation.improves:
        (folder / EXCITATION).unlink(missing_ok=True)
    else:
        write_text(folder / EXCITATION, excitation_csv(evidence.separation, diagnosis))


def diagnosis_document(diagnosis: Verdict, evidence: Evidence, data: str) -> dict:
    """Return the content of ``diagnosis.json``: the contract's keys, and under keys of their own the evidence beside them."""
    unit = diagnosis.experiment.output_unit
    return {
        **diagnosis.to_json(),
        "ties": None if evidence.ties is None else evidence.ties.to_json(),
        "separating_excitation": None if evidence.separation is None else evidence.separation.to_json(),
        "false_alarm_threshold": {"gain": evidence.threshold, "null_experiments": len(evidence.null.ratios)},
        "detectable_rms": {
            item.effect: {"easiest": item.easiest, "hardest": item.hardest, "unit": unit}
            for item in evidence.detectable
        },
        "data": data,
    }


def ladder_csv(diagnosis: Verdict, data: str) -> str:
    """Return the error ladder: base, base and first effect, …."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(LADDER_COLUMNS)
    floor = diagnosis.experiment.floor
    for number, item in enumerate(diagnosis.path):
        forms = "+".join(form.name for form in item.fit.structure.forms)
        numbers = (repr(item.train_rms), repr(item.test_rms), diagnosis.experiment.output_unit)
        writer.writerow(
            [number, "+".join(item.effects), forms, *numbers, "" if floor is None else repr(floor.rms), data]
        )
    return stream.getvalue()
