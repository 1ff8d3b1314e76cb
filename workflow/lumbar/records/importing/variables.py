"""Variables of a file without rows (MATLAB, HDF5) as columns of one table."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.importing.dialect import FEWEST_ROWS
from lumbar.records.importing.raw_table import RawColumn, RawTable, StatedRate
from lumbar.records.importing.units import name_and_unit

_MOST_COLUMNS = 64
_RATES = ("fs", "f_s", "fsample", "rate", "samplerate", "sampling_rate", "sample_rate", "samplingrate")
_INTERVALS = ("dt", "ts", "sampling_time", "sample_time", "delta_t")


def to_table(
    arrays: Mapping[str, np.ndarray],
    source: str,
    form: str,
    table: str | None = None,
    units: Mapping[str, str] | None = None,
) -> RawTable:
    """Make the vectors, and columns of matrices, of one length a table; scalars may state the sampling rate.

    Parameters
    ----------
    arrays : mapping of str to numpy.ndarray
        Numbers by the variable's path, samples along the first axis.
    source, form : str
        As of `RawTable`.
    table : str, optional
        Path below which variables are taken.
    units : mapping of str to str, optional
        By path, where the file states them.

    Raises
    ------
    InputError
        If no two vectors are of one length, or vectors of several lengths are.
    """
    taken = {path: values for path, values in arrays.items() if table is None or _below(path, table)}
    if table is not None and not taken:
        raise InputError(f"{source}: no variable {table!r}; there are {', '.join(arrays) or 'none'}")
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
    if len(tables) > 1:
        raise InputError(
            f"{source}: vectors of several lengths: {found}; choose a part with --table VARIABLE"
        )
    paths = next(iter(tables.values()))
    columns = []
    for number, path in enumerate(paths, start=1):
        name, unit = name_and_unit(path)
        stated = (units or {}).get(path, "")
        name = path if stated else name
        group = name[: max(name.rfind("."), name.rfind("/")) + 1]
        columns.append(RawColumn(number, name, stated or unit, vectors[path], group))
    return RawTable(source, form, tuple(columns), rates=tuple(_stated(taken)))


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
