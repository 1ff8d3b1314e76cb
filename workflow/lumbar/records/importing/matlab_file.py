"""MATLAB files of versions 4 to 7.2: variables, fields of structures, columns of matrices."""

from __future__ import annotations

import io

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.importing.raw_table import RawTable
from lumbar.records.importing.variables import to_table
from lumbar.records.unpacking import check_matlab


def read_matlab(content: bytes, source: str, table: str | None = None) -> RawTable:
    """Read a MATLAB file; parameters as of `lumbar.records.importing.text_table.read_text`.

    Raises
    ------
    InputError
        If it is none, or holds no vectors of one length.
    """
    from scipy.io import loadmat

    check_matlab(io.BytesIO(content), source)
    try:
        variables = loadmat(io.BytesIO(content), squeeze_me=True, struct_as_record=False)
    except Exception as error:  # a broken file leads SciPy's reader to errors of many kinds
        raise InputError(f"{source}: not a MATLAB file that can be read ({error})") from error
    arrays: dict[str, np.ndarray] = {}
    opaque: list[str] = []
    for name, value in variables.items():
        if not name.startswith("__") or name == "__function_workspace__":
            _collect(name, value, arrays, opaque)
    if opaque and not arrays:
        raise InputError(
            f"{source}: holds MATLAB objects (tables, timetables, …), which other programs cannot read; save their columns "
            "as variables, or the table T as table2struct(T, 'ToScalar', true)"
        )
    return to_table(arrays, source, "MATLAB", table)


_LABELS = ("label", "Label", "name", "Name")
_VALUES = ("values", "Values", "data", "Data")
"""Fields of a signal as Simulink and measuring systems write it: its values are named after its label."""


def _collect(path: str, value, arrays: dict[str, np.ndarray], opaque: list[str]) -> None:
    """Note the numbers of a variable and of all its fields, by path."""
    if type(value).__name__ in ("MatlabOpaque", "MatlabFunction") or path.startswith("__"):
        opaque.append(path)
    elif hasattr(value, "_fieldnames"):
        fields = {name: getattr(value, name) for name in value._fieldnames}
        label = next((fields[name] for name in _LABELS if isinstance(fields.get(name), str)), "")
        for name, field in fields.items():
            own = f".{label}" if label and name in _VALUES else f".{name}"
            _collect(f"{path}{own}", field, arrays, opaque)
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for number, item in enumerate(value.ravel(), start=1):
            _collect(f"{path}({number})", item, arrays, opaque)
    elif np.asarray(value).dtype.kind in "fiu":
        arrays[path] = np.asarray(value)
