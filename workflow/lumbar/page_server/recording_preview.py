"""What the page shows of recordings before they are diagnosed: columns, what they were taken for, first rows, curves."""

from __future__ import annotations

from typing import Any

import numpy as np

from lumbar.interface.importing import ImportedRecordings
from lumbar.page_server.field_problems import in_labels
from lumbar.records.importing.raw_table import RawTable

_ROWS, _POINTS, _MOST_COLUMNS = 4, 300, 60


def tables_columns(table: RawTable) -> list[dict[str, Any]]:
    """Columns of a file: ``value`` (by which one is chosen), ``label`` and ``sample``."""
    names = [column.name for column in table.columns]
    return [
        {
            "value": column.name if column.name and names.count(column.name) == 1 else str(column.number),
            "label": column.label,
            "sample": column.sample,
        }
        for column in table.columns[:_MOST_COLUMNS]
    ]


def preview(imported: ImportedRecordings) -> dict[str, Any]:
    """What one file was taken for.

    Returns
    -------
    dict
        ``record``, ``form``, ``grounds`` by role, ``notes``, ``header`` and ``rows`` of the first samples, ``facts``,
        ``seconds``, and ``curves``: label and values of position and force, drawn over time.
    """
    recording = imported[0]
    record, frame = recording.record, recording.frame()
    facts = imported.table.iloc[0].to_dict()
    return {
        "record": record.name,
        "form": recording.form,
        "grounds": {role: in_labels(words) for role, words in recording.grounds.items()},
        "notes": list(map(in_labels, recording.notes)),
        "header": list(frame.columns),
        "rows": [[f"{value:.6g}" for value in row] for row in frame.head(_ROWS).to_numpy()],
        "facts": [
            f"{name}: {value}" if isinstance(value, str) else f"{name}: {value:.6g}"
            for name, value in facts.items()
        ],
        "seconds": record.duration,
        "curves": [
            {"label": channel.label, "values": _drawn(channel.values)} for channel in record.channels.values()
        ],
    }


def _drawn(values: np.ndarray) -> list[float]:
    """At most 2 × `_POINTS` values between 0 and 1: the least and the largest of every stretch."""
    low, range_ = values.min(), np.ptp(values) or 1.0
    stretches = np.array_split(values, min(_POINTS, len(values)))
    ends = [end for part in stretches for end in (part.min(), part.max())]
    return [round(float((end - low) / range_), 4) for end in ends]
