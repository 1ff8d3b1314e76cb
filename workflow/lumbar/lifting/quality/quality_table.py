"""The quality sheets of a study's recordings as a published table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lumbar.tables.table import Table

_DEFINITIONS = {
    "lift": "Person, mass of the box, and number of the trial where there are several; of perturbed trials group and number.",
    "file": "Marker file.",
    "markers": "Measured markers in the file.",
    "rate_Hz": "Frames per second.",
    "duration_s": "Seconds.",
    "missing_percent": "Share of all samples of all markers in which a marker was not seen, in percent.",
    "longest_gap_s": "Longest stretch in which a marker was not seen; 0 where all always were.",
    "estimated": "Standard markers that the file does not hold and a rule fills.",
    "left_out": "Stretches of a marker left out because they cannot be a body's.",
    "findings": "What was found, with marker and time; each kind is explained in docs/quality.md.",
    "not_checked": "What the file's markers did not allow to check; why stands in quality.json.",
}


def quality_table(sheets: Sequence[dict], data: str) -> Table:
    """Return one row per recording.

    Parameters
    ----------
    sheets : sequence of dict
        As of `QualitySheet.as_dict`, with the name of the lift under ``lift``.
    data : str
        Words for the source of the data.
    """
    import pandas as pd

    return Table(
        "What the recordings hold, and what in them cannot be a body's",
        pd.DataFrame([_row(sheet) for sheet in sheets], columns=list(_DEFINITIONS)),
        _DEFINITIONS,
        data,
        decimals={"missing_percent": 2, "longest_gap_s": 2, "duration_s": 2, "rate_Hz": 0},
    )


def _row(sheet: dict) -> dict:
    findings = [
        f"{finding['kind']} ({finding['outcome']}): {', '.join(finding['markers']) or 'all markers'} "
        f"from {finding['start_s']:.2f} s for {finding['length_s']:.2f} s"
        for finding in sheet["findings"]
    ]
    return {
        "lift": sheet["lift"],
        "file": Path(sheet["file"]).name,
        "markers": len(sheet["markers"]),
        "rate_Hz": float(sheet["rate_Hz"]),
        "duration_s": sheet["duration_s"],
        "missing_percent": 100 * sheet["missing_share"],
        "longest_gap_s": max((gap["longest_s"] for gap in sheet["gaps"]), default=0.0),
        "estimated": ", ".join(sheet["estimated"]) or "none",
        "left_out": sum(finding["outcome"] in ("left out", "proposed") for finding in sheet["findings"]),
        "findings": "; ".join(findings) or "none",
        "not_checked": ", ".join(sheet["unchecked"]) or "none",
    }
