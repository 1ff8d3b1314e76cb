"""Preview of recordings before they are diagnosed: columns, and messages next to the field that they concern."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from lumbar.interface.importing import ImportedRecordings
from lumbar.records.importing.raw_table import COLUMNS_FOLLOW, RawTable

FIELDS = {
    "time": "Time",
    "time_unit": "Unit of time",
    "position": "Position",
    "position_unit": "Unit of position",
    "force": "Force",
    "force_unit": "Unit of force",
    "rate": "Sampling rate",
    "trim": "Part",
    "table": "Table or sheet",
    "encoding": "Encoding",
    "flip_force": "Change the sign of the force",
    "accept_clipped": "Accept clipped records",
}
"""Labels of the page's fields by the argument of `lumbar.import_recordings`."""
_LONGEST_FIRST = sorted((name.replace("_", "-") for name in FIELDS), key=len, reverse=True)
_OPTION = re.compile(rf"--({'|'.join(_LONGEST_FIRST)})")
_ALIASES = (
    ("--sheet", "--table"),
    ("--variable", "--table"),
    ("the layout's 'clipped: accept'", "--accept-clipped"),
)
_NO_TABLE = re.compile(r"no (table|sheet|variable) '")
_METAVARS = re.compile(r"(--[a-z-]+) (?:NAME or NUMBER|COLUMN|NAME|NUMBER|HZ|VARIABLE)\b")


def in_fields(message: str, wrong: dict[str, list[str]]) -> list[str]:
    """Assign each problem of a reader's message to the first field that it names; return the others.

    Parameters
    ----------
    wrong : dict of str to list of str
        By field; takes the problems that name one.

    Examples
    --------
    >>> wrong = {name: [] for name in FIELDS}
    >>> in_fields("a.csv: no column of time and no rate is stated; give --time COLUMN or --rate HZ", wrong)
    []
    >>> wrong["time"]
    ['a.csv: no column of time and no rate is stated; give “Time” or “Sampling rate”']
    """
    rest = []
    for problem in _problems(message):
        option = _OPTION.search(problem)
        if option is not None:
            place = wrong[option[1].replace("-", "_")]
        else:
            place = wrong["table"] if _NO_TABLE.search(problem) else rest
        place.append(in_labels(problem))
    return rest


def in_labels(text: str) -> str:
    """Return a reader's message with the fields' labels instead of options.

    Examples
    --------
    >>> in_labels("column 2, as given by --force")
    'column 2, as given by “Force”'
    """
    return _OPTION.sub(lambda found: f"“{FIELDS[found[1].replace('-', '_')]}”", text)


def _problems(message: str) -> list[str]:
    """Return the problems of a message, without the columns listed after them."""
    text = re.split(rf"\n\s*{COLUMNS_FOLLOW.strip()} ", message)[0]
    for name, option in _ALIASES:
        text = text.replace(name, option)
    text = _METAVARS.sub(r"\1", text)
    parts = [part.strip() for part in re.split(r"\n\s*- ", text)]
    listed = [part for part in parts if not _HEADING.search(part)]
    return listed or parts


_HEADING = re.compile(r"(: \d+ problems?|: some columns or units are unclear)$")
"""End of a heading before a list of problems."""


_ROWS, _POINTS, _MOST_COLUMNS = 2, 300, 60
OF_SEVERAL_AXES = (
    "Records of several axes: the page shows what lumbar diagnose writes; no other models can be tried."
)


def tables_columns(table: RawTable) -> list[dict[str, Any]]:
    """Return the columns of a file: ``value`` (by which one is chosen), ``label`` and ``sample``."""
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
    """Return how one file is read.

    Returns
    -------
    dict
        ``record``, ``form``, ``grounds`` by field, ``found`` (columns and unit by field), ``notes``, ``remark``, ``header`` and
        ``rows`` of the first samples, ``facts``, ``seconds``, and ``curves``: label and points of position and force over time.
    """
    recording = imported[0]
    record, columns = recording.record, recording.tidy
    return {
        "record": record.name,
        "form": recording.form,
        "grounds": {
            role: in_labels("; ".join(words)) for role, words in _by_field(recording.grounds).items()
        },
        "found": {
            role: (", ".join(column for column, _ in found), found[0][1])
            for role, found in _by_field(recording.sources).items()
        },
        "notes": list(map(in_labels, recording.notes)),
        "remark": OF_SEVERAL_AXES if record.axes else "",
        "header": list(columns),
        "rows": [
            [f"{value:.6g}" for value in row]
            for row in zip(*(item[:_ROWS] for item in columns.values()), strict=True)
        ],
        "facts": [
            f"{name}: {value}" if isinstance(value, str) else f"{name}: {value:.6g}"
            for name, value in recording.numbers.items()
        ],
        "seconds": record.duration,
        "curves": [
            {"label": record.along(role).label, "points": drawn(record[role], _POINTS).round(4).tolist()}
            for role in record.channels
        ],
    }


def _by_field(by_role: Mapping[str, Any]) -> dict[str, list]:
    """Return a list per field: the values of its roles, one per axis."""
    found: dict[str, list] = {}
    for role, value in by_role.items():
        found.setdefault(role.partition("_")[0], []).append(value)
    return found


def drawn(values: np.ndarray, intervals: int) -> np.ndarray:
    """Return points of a line through the samples; of many the smallest and largest of every interval, in order.

    Shape (points, 2): time and value, both from 0 to 1.
    """
    places = np.arange(len(values))
    if len(values) > 2 * intervals:
        length = -(-len(values) // intervals)
        parts = np.pad(values, (0, -len(values) % length), "edge").reshape(-1, length)
        ends = np.arange(len(parts)) * length + [parts.argmin(axis=1), parts.argmax(axis=1)]
        places = np.unique([0, *np.ravel(ends), len(values) - 1])
    shown = values[places]
    return np.column_stack([places / (len(values) - 1), (shown - shown.min()) / (np.ptp(shown) or 1.0)])
