"""Variables of MATLAB files (4 to 7.3) and HDF5 files, which know no rows, as columns of one table."""

import io
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.child_process import read_in_child
from lumbar.records.importing.dialect import FEWEST_ROWS
from lumbar.records.importing.raw_table import RawColumn, RawTable, ReadOptions, StatedRate, name_and_unit
from lumbar.records.unpacking import check_size

_MOST_COLUMNS, _MOST_OFFERED = 64, 3
_ELSEWHERE = "{source}: {path} stands in another file; store all numbers in one, with h5repack or h5copy"
_RATES = ("fs", "f_s", "fsample", "rate", "samplerate", "sampling_rate", "sample_rate", "samplingrate")
_INTERVALS = ("dt", "ts", "sampling_time", "sample_time", "delta_t")


def to_table(
    arrays: Mapping[str, np.ndarray],
    source: str,
    form: str,
    asked: ReadOptions,
    units: Mapping[str, str] | None = None,
) -> RawTable:
    """Make the vectors, and columns of matrices, of one length a table; scalars may state the sampling rate.

    Parameters
    ----------
    arrays : mapping of str to numpy.ndarray
        Numbers by the variable's path, samples along the first axis.
    source, form : str
        As of `RawTable`.
    asked : ReadOptions
        `table` is the path below which variables are taken; `columns` choose among several lengths.
    units : mapping of str to str, optional
        By path, where the file states them.

    Raises
    ------
    InputError
        If no two vectors are of one length, or vectors of several lengths are.
    """
    taken = {
        path: values for path, values in arrays.items() if asked.table is None or _below(path, asked.table)
    }
    if asked.table is not None and not taken:
        raise InputError(f"{source}: no variable {asked.table!r}; there are {', '.join(arrays) or 'none'}")
    vectors = dict(_vectors(taken))
    lengths = sorted({len(values) for values in vectors.values()})
    grouped = {
        length: [path for path, values in vectors.items() if len(values) == length] for length in lengths
    }
    tables = {length: paths for length, paths in grouped.items() if len(paths) > 1}
    found = "; ".join(f"{', '.join(paths)} ({length} values)" for length, paths in grouped.items()) or "none"
    if not tables:
        raise InputError(
            f"{source}: position and force need two vectors of one length, of at least {FEWEST_ROWS} values, in one file; there "
            f"are {found}"
        )
    paths = (
        next(iter(tables.values()))
        if len(tables) == 1
        else _of_one_length(tables, asked.columns, found, source)
    )
    columns = []
    for number, path in enumerate(paths, start=1):
        name, unit = name_and_unit(path)
        stated = (units or {}).get(path, "")
        name = path if stated else name
        group = name[: max(name.rfind("."), name.rfind("/")) + 1]
        columns.append(RawColumn(number, name, stated or unit, vectors[path], group))
    return RawTable(source, form, tuple(columns), rates=tuple(_stated(taken)))


def _of_one_length(
    tables: dict[int, list[str]], columns: Sequence[str], found: str, source: str
) -> list[str]:
    """The vectors among which all columns are that a person named."""
    lengths = {
        column: length
        for column in columns
        for length, paths in tables.items()
        for path in paths
        if column.casefold() in (path.casefold(), name_and_unit(path)[0].casefold())
    }
    if len(set(lengths.values())) == 1:
        return tables[next(iter(lengths.values()))]
    if lengths:
        told = " and ".join(f"{column!r} {length}" for column, length in lengths.items())
        raise InputError(
            f"{source}: {told.replace(' ', ' has ', 1)} values; a record needs columns of one length: {found}"
        )
    named = [f"--position {paths[0]} --force {paths[-1]}" for paths in tables.values()]
    raise InputError(
        f"{source}: vectors of several lengths: {found}; choose a part with --table VARIABLE, or the vectors of one length by "
        f"naming them, as in {', or '.join(named[:_MOST_OFFERED])}"
    )


def _below(path: str, table: str) -> bool:
    return path == table or path.startswith((f"{table}/", f"{table}.", f"{table}("))


def _vectors(arrays: Mapping[str, np.ndarray]):
    for path, array in arrays.items():
        values = np.squeeze(array)
        if values.ndim == 1 and len(values) >= FEWEST_ROWS:
            yield path, values.astype(float)
        elif values.ndim == 2 and values.shape[0] >= FEWEST_ROWS and values.shape[1] <= _MOST_COLUMNS:
            for column in range(values.shape[1]):
                yield f"{path}(:,{column + 1})", values[:, column].astype(float)


def _stated(arrays: Mapping[str, np.ndarray]):
    for path, array in arrays.items():
        name = path.replace(".", "/").rpartition("/")[2].casefold()
        if np.size(array) != 1 or not float(np.squeeze(array)) > 0:
            continue
        value = float(np.squeeze(array))
        if name in _RATES:
            yield StatedRate(value, path)
        elif name in _INTERVALS:
            yield StatedRate(1 / value, path)


def read_matlab(content: bytes, source: str, asked: ReadOptions) -> RawTable:
    """Read a MATLAB file; parameters as for `to_table`.

    Raises
    ------
    InputError
        If it is none, or holds no vectors of one length.
    """
    found = read_in_child(_matlab_variables, source, content)
    arrays, opaque = found["arrays"], found["opaque"]
    if opaque and not arrays:
        raise InputError(
            f"{source}: holds MATLAB objects (tables, timetables, …), which other programs cannot read; save their columns "
            "as variables, or the table T as table2struct(T, 'ToScalar', true)"
        )
    return to_table(arrays, source, "MATLAB", asked)


def _matlab_variables(source: str, content: bytes) -> dict[str, Any]:
    """Numbers of a MATLAB file by path, and the paths of what only MATLAB reads."""
    from lumbar.records.unpacking import load_matlab

    broken = "not a MATLAB file that can be read"
    variables = load_matlab(content, source, broken, squeeze_me=True, struct_as_record=False)
    arrays: dict[str, np.ndarray] = {}
    opaque: list[str] = []
    for name, value in variables.items():
        if not name.startswith("__") or name == "__function_workspace__":
            _collect(name, value, arrays, opaque)
    return {"arrays": arrays, "opaque": opaque}


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


def _stated_size(path: str, item, source: str) -> int:
    """Bytes that an item of an HDF5 file says it holds, the larger of its pieces at least.

    Raises
    ------
    InputError
        Where they stand in another file, which neither its shape nor its values are asked for.
    """
    import h5py

    if not isinstance(item, h5py.Dataset):
        return 0
    made = item.id.get_create_plist()
    if made.get_external_count() or made.get_layout() == h5py.h5d.VIRTUAL:
        raise InputError(_ELSEWHERE.format(source=source, path=path))
    return max(8, item.dtype.itemsize) * max(item.size or 0, math.prod(item.chunks or ()))


def _attributes(item) -> dict[str, np.ndarray]:
    """Attributes of one value, by name; longer ones are not read."""
    single = [name for name in item.attrs if math.prod(item.attrs.get_id(name).shape or ()) == 1]
    return {name: np.asarray(item.attrs[name]) for name in single}


def read_hdf5(content: bytes, source: str, asked: ReadOptions) -> RawTable:
    """Read an HDF5 file; parameters as for `to_table`.

    A matrix is taken with its samples along the longer axis: MATLAB writes them along the other one than most.

    Raises
    ------
    InputError
        If the file is broken, leads to another or holds no vectors of one length.
    """
    found = read_in_child(_hdf5_variables, source, content)
    return to_table(found["arrays"], source, "HDF5", asked, found["units"])


def _hdf5_variables(source: str, content: bytes) -> dict[str, Any]:
    """Numbers of an HDF5 file by path, and the units of some."""
    import h5py

    arrays: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    stated = 0

    def collect(path: str, item) -> None:
        nonlocal stated
        stated += _stated_size(path, item, source)
        check_size(stated, len(content), source)
        attributes = _attributes(item)
        arrays.update({f"{path}/{name}": value for name, value in attributes.items()})
        if not isinstance(item, h5py.Dataset) or path.startswith("#"):  # MATLAB's own book-keeping
            return
        fields = item.dtype.names
        for name in fields or [None]:
            if (
                item.dtype[name] if name else item.dtype
            ).kind in "fiu":  # others may be large, or lead elsewhere
                values = np.squeeze(item[name] if name else item[()])
                long = values.ndim == 2 and values.shape[1] > values.shape[0]
                arrays[f"{path}/{name}" if name else path] = values.T if long else values
        for name, value in attributes.items():
            if name.casefold() in ("unit", "units"):
                unit = value.item()
                units.setdefault(path, unit.decode() if isinstance(unit, bytes) else str(unit))

    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            linked = file.visititems_links(lambda path, link: path if hasattr(link, "filename") else None)
            if linked:
                raise InputError(_ELSEWHERE.format(source=source, path=linked))
            file.visititems(collect)
            arrays.update(_attributes(file))
    except InputError:
        raise
    except Exception as error:  # a broken file leads h5py to errors of many kinds
        raise InputError(f"{source}: a broken HDF5 file ({error})") from error
    return {
        "arrays": {path: values for path, values in arrays.items() if values.dtype.kind in "fiu"},
        "units": units,
    }
