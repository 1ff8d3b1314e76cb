"""Preview of recordings before they are diagnosed: columns, and messages next to the fields to which they belong."""

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
_HEADING = re.compile(r"(: \d+ problems?|: some columns or units are unclear)$")
"""End of the heading of a list of problems."""
_METAVARS = re.compile(r"(--[a-z-]+) (?:NAME or NUMBER|COLUMN|NAME|NUMBER|HZ|VARIABLE)\b")
_ROWS, _POINTS, _MAX_COLUMNS = 2, 300, 60
OF_SEVERAL_AXES = (
    "Records of several axes: the page shows what lumbar diagnose writes; no other models can be tried."
)


def assign_problems(message: str, wrong: dict[str, list[str]]) -> list[str]:
    """Append each problem of a reader's message to `wrong` under the first field that it names; return the others.

    Examples
    --------
    >>> wrong = {name: [] for name in FIELDS}
    >>> assign_problems("a.csv: no column of time and no rate is stated; give --time COLUMN or --rate HZ", wrong)
    []
    >>> wrong["time"]
    ['a.csv: no column of time and no rate is stated; give “Time” or “Sampling rate”']
    """
    # The problems of the message, without the columns listed after them and without its heading.
    text = re.split(rf"\n\s*{COLUMNS_FOLLOW.strip()} ", message)[0]
    for name, option in _ALIASES:
        text = text.replace(name, option)
    parts = [part.strip() for part in re.split(r"\n\s*- ", _METAVARS.sub(r"\1", text))]
    rest: list[str] = []
    for problem in [part for part in parts if not _HEADING.search(part)] or parts:
        place = wrong["table"] if _NO_TABLE.search(problem) else rest
        if option := _OPTION.search(problem):
            place = wrong[option[1].replace("-", "_")]
        place.append(replace_options(problem))
    return rest


def replace_options(text: str) -> str:
    """Return a reader's message with the fields' labels instead of options.

    Examples
    --------
    >>> replace_options("column 2, as set by --force")
    'column 2, as set by “Force”'
    """
    return _OPTION.sub(lambda option: f"“{FIELDS[option[1].replace('-', '_')]}”", text)


def table_columns(table: RawTable) -> list[dict[str, Any]]:
    """Return the columns of a file: ``value`` (for the choice), ``label`` and ``sample``."""
    names = [column.name for column in table.columns]
    return [
        {
            "value": column.name if column.name and names.count(column.name) == 1 else str(column.number),
            "label": column.label,
            "sample": column.sample,
        }
        for column in table.columns[:_MAX_COLUMNS]
    ]


def preview(imported: ImportedRecordings) -> dict[str, Any]:
    """Return the first recording of a file for the page.

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
            field: replace_options("; ".join(texts))
            for field, texts in _group_by_field(recording.grounds).items()
        },
        "found": {
            field: (", ".join(column for column, _ in columns_and_units), columns_and_units[0][1])
            for field, columns_and_units in _group_by_field(recording.sources).items()
        },
        "notes": list(map(replace_options, recording.notes)),
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
            {
                "label": record.along(role).label,
                "points": curve_points(record[role], _POINTS).round(4).tolist(),
            }
            for role in record.channels
        ],
    }


def _group_by_field(by_role: Mapping[str, Any]) -> dict[str, list]:
    """Return the values of the roles of each field, as a list with one value per axis."""
    by_field: dict[str, list] = {}
    for role, value in by_role.items():
        by_field.setdefault(role.partition("_")[0], []).append(value)
    return by_field


def curve_points(values: np.ndarray, intervals: int) -> np.ndarray:
    """Return points of a line through the samples, (points, 2): time and value from 0 to 1.

    Many samples are reduced to the smallest and largest of every interval, in order.
    """
    places = np.arange(len(values))
    if len(values) > 2 * intervals:
        length = -(-len(values) // intervals)
        parts = np.pad(values, (0, -len(values) % length), "edge").reshape(-1, length)
        ends = np.arange(len(parts)) * length + [parts.argmin(axis=1), parts.argmax(axis=1)]
        places = np.unique([0, *np.ravel(ends), len(values) - 1])
    shown = values[places]
    return np.column_stack([places / (len(values) - 1), (shown - shown.min()) / (np.ptp(shown) or 1.0)])
