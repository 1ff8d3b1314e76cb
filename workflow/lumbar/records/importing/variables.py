"""Variables of MATLAB files (4 to 7.3) and HDF5 files, which have no rows, as columns of one table."""

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.child_process import read_in_child
from lumbar.records.importing.dialect import MIN_ROWS
from lumbar.records.importing.raw_table import (
    RawColumn,
    RawTable,
    StatedRate,
    split_name_and_unit,
)
from lumbar.records.importing.roles import Choices
from lumbar.records.unpacking import check_size, load_matlab, report_broken

_MAX_CHANNELS = 64
"""Largest number of channels in a matrix."""
_MAX_EXAMPLES = 3
_EXTERNAL = "{source}: {path} is stored in another file; store all numbers in one, with h5repack or h5copy"
_RATES = ("fs", "f_s", "fsample", "rate", "samplerate", "sampling_rate", "sample_rate", "samplingrate")
_INTERVALS = ("dt", "ts", "sampling_time", "sample_time", "delta_t")
_LABEL_FIELDS = ("label", "Label", "name", "Name")
_VALUE_FIELDS = ("values", "Values", "data", "Data")
"""Fields with the values of a signal that Simulink or a measuring system wrote; its label becomes its name."""


def _to_table(
    arrays: Mapping[str, np.ndarray],
    source: str,
    form: str,
    choices: Choices,
    units: Mapping[str, str],
) -> RawTable:
    """Make a table of the vectors, and channels of matrices, with one length; scalars may state the sampling rate.

    `arrays` and `units` are by the variable's path, samples along the first axis. `choices.table` is the path of a group of
    variables; the named columns choose among several lengths.
    """
    table = choices.table
    if table is not None:
        below = (f"{table}/", f"{table}.", f"{table}(")
        selected = {
            path: values for path, values in arrays.items() if path == table or path.startswith(below)
        }
        if not selected:
            raise InputError(f"{source}: no variable {table!r}; there are {', '.join(arrays) or 'none'}")
        arrays = selected
    vectors = dict(_vectors(arrays))
    grouped: dict[int, list[str]] = {}
    for path, values in sorted(vectors.items(), key=lambda item: len(item[1])):
        grouped.setdefault(len(values), []).append(path)
    tables = {length: paths for length, paths in grouped.items() if len(paths) > 1}
    listed = "; ".join(f"{', '.join(paths)} ({length} values)" for length, paths in grouped.items())
    if not tables:
        shapes = (f"{path} {' x '.join(map(str, array.shape)) or '1'}" for path, array in arrays.items())
        raise InputError(
            f"{source}: position and force need two vectors of one length, of at least {MIN_ROWS} values, in one file; there "
            f"are {listed or ', '.join(shapes) or 'none'}"
        )
    paths = next(iter(tables.values()))
    if len(tables) > 1:
        paths = _choose_length(tables, choices.named_columns, listed, source)
    columns = []
    for number, path in enumerate(paths, start=1):
        name, unit = (path, units[path]) if units.get(path) else split_name_and_unit(path)
        group = name[: max(name.rfind("."), name.rfind("/")) + 1]
        columns.append(RawColumn(number, name, unit, vectors[path], group))
    return RawTable(source, form, tuple(columns), rates=tuple(_stated_rates(arrays)))


def _choose_length(
    tables: dict[int, list[str]], columns: Sequence[str], listed: str, source: str
) -> list[str]:
    """Return the vectors of one length that contain all columns that the user named."""
    lengths = {
        column: length
        for column in columns
        for length, paths in tables.items()
        for path in paths
        if column.casefold() in (path.casefold(), split_name_and_unit(path)[0].casefold())
    }
    if len(set(lengths.values())) == 1:
        return tables[next(iter(lengths.values()))]
    if lengths:
        named = " and ".join(f"{column!r} has {length}" for column, length in lengths.items())
        raise InputError(f"{source}: {named} values; a record needs columns of one length: {listed}")
    examples = [f"--position {paths[0]} --force {paths[-1]}" for paths in tables.values()]
    raise InputError(
        f"{source}: vectors of several lengths: {listed}; choose a part with --table VARIABLE, or the vectors of one length by "
        f"naming them, as in {', or '.join(examples[:_MAX_EXAMPLES])}"
    )


def _vectors(arrays: Mapping[str, np.ndarray]) -> Iterator[tuple[str, np.ndarray]]:
    for path, array in arrays.items():
        values = np.squeeze(array)
        if values.ndim == 1 and len(values) >= MIN_ROWS:
            yield path, values.astype(float)
        elif values.ndim == 2 and min(values.shape) <= _MAX_CHANNELS and max(values.shape) >= MIN_ROWS:
            # The samples are along the longer axis; the names are MATLAB's.
            is_wide = values.shape[1] > values.shape[0]
            for number, channel in enumerate(values if is_wide else values.T, start=1):
                yield f"{path}({number},:)" if is_wide else f"{path}(:,{number})", channel.astype(float)


def _stated_rates(arrays: Mapping[str, np.ndarray]) -> Iterator[StatedRate]:
    for path, array in arrays.items():
        name = path.replace(".", "/").rpartition("/")[2].casefold()
        if name not in (*_RATES, *_INTERVALS) or np.size(array) != 1:
            continue
        value = float(np.squeeze(array))
        if value > 0:
            yield StatedRate(value if name in _RATES else 1 / value, path)


def read_variables(content: bytes, source: str, kind: str, choices: Choices) -> RawTable:
    """Read the variables of a MATLAB or HDF5 file as a table.

    The samples of a matrix in an HDF5 file are along its longer axis, because MATLAB transposes matrices in these files.

    Parameters
    ----------
    content : bytes
        Content of the file.
    source : str
        The file, for messages.
    kind : str
        ``"MATLAB"`` or ``"HDF5"``.
    choices : Choices
        The user's options.

    Raises
    ------
    InputError
        If the file is broken, refers to another file, or has no vectors of one length.
    """
    read = _matlab_variables if kind == "MATLAB" else _hdf5_variables
    result = read_in_child(read, source, content)
    if result["opaque"] and not result["arrays"]:
        raise InputError(
            f"{source}: holds MATLAB objects (tables, timetables, …), which other programs cannot read; save their columns "
            "as variables, or the table T as table2struct(T, 'ToScalar', true)"
        )
    return _to_table(result["arrays"], source, kind, choices, result["units"])


def _matlab_variables(source: str, content: bytes) -> dict[str, Any]:
    """Return the arrays of a MATLAB file, the paths of objects that only MATLAB reads, and the units."""
    arrays: dict[str, np.ndarray] = {}
    opaque: list[str] = []

    def collect(path: str, value) -> None:
        if type(value).__name__ in ("MatlabOpaque", "MatlabFunction") or path.startswith("__"):
            opaque.append(path)
        elif hasattr(value, "_fieldnames"):
            fields = {name: getattr(value, name) for name in value._fieldnames}
            label = next((fields[name] for name in _LABEL_FIELDS if isinstance(fields.get(name), str)), "")
            for name, item in fields.items():
                collect(f"{path}.{label if label and name in _VALUE_FIELDS else name}", item)
        elif isinstance(value, np.ndarray) and value.dtype == object:
            for number, item in enumerate(value.ravel(), start=1):
                collect(f"{path}({number})", item)
        elif np.asarray(value).dtype.kind in "fiu":
            arrays[path] = np.asarray(value)

    for name, value in load_matlab(content, source, squeeze_me=True, struct_as_record=False).items():
        if not name.startswith("__") or name == "__function_workspace__":
            collect(name, value)
    return {"arrays": arrays, "opaque": opaque, "units": {}}


def _hdf5_variables(source: str, content: bytes) -> dict[str, Any]:
    """Return the arrays of an HDF5 file by path, and the units that it states, by path."""
    import h5py

    arrays: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    size = 0

    def collect(path: str, item) -> None:
        nonlocal size
        size += _hdf5_size(path, item, source)
        check_size(size, len(content), source)
        attributes = _hdf5_attributes(item)
        arrays.update({f"{path}/{name}": value for name, value in attributes.items()})
        if isinstance(item, h5py.Dataset) and not path.startswith("#"):  # MATLAB's internal groups
            # Only numbers: other kinds may be large, or refer to other files.
            for name in item.dtype.names or [None]:
                if (item.dtype[name] if name else item.dtype).kind in "fiu":
                    values = np.squeeze(item[name] if name else item[()])
                    is_wide = values.ndim == 2 and values.shape[1] > values.shape[0]
                    arrays[f"{path}/{name}" if name else path] = values.T if is_wide else values
            for name, value in attributes.items():
                if name.casefold() in ("unit", "units"):
                    unit = value.item()
                    units.setdefault(path, unit.decode() if isinstance(unit, bytes) else str(unit))

    with report_broken(f"{source}: a broken HDF5 file"), h5py.File(io.BytesIO(content), "r") as file:
        linked = file.visititems_links(lambda path, link: path if hasattr(link, "filename") else None)
        if linked:
            raise InputError(_EXTERNAL.format(source=source, path=linked))
        file.visititems(collect)
        arrays.update(_hdf5_attributes(file))
    numbers = {path: values for path, values in arrays.items() if values.dtype.kind in "fiu"}
    return {"arrays": numbers, "opaque": [], "units": units}


def _hdf5_size(path: str, item, source: str) -> int:
    """Return the stated size of an item in bytes, at least the size of a chunk; raise if its values are in another file."""
    import h5py

    if not isinstance(item, h5py.Dataset):
        return 0
    creation = item.id.get_create_plist()
    if creation.get_external_count() or creation.get_layout() == h5py.h5d.VIRTUAL:
        raise InputError(_EXTERNAL.format(source=source, path=path))
    return max(8, item.dtype.itemsize) * max(item.size or 0, math.prod(item.chunks or ()))


def _hdf5_attributes(item) -> dict[str, np.ndarray]:
    """Return the attributes with one value, by name."""
    single = [name for name in item.attrs if math.prod(item.attrs.get_id(name).shape or ()) == 1]
    return {name: np.asarray(item.attrs[name]) for name in single}
