"""HDF5 files, MATLAB's of version 7.3 among them: data sets, fields of compound ones, columns of matrices."""

from __future__ import annotations

import io

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.importing.raw_table import RawTable
from lumbar.records.importing.variables import to_table
from lumbar.records.unpacking import MOST_NUMBERS


def read_hdf5(content: bytes, source: str, table: str | None = None) -> RawTable:
    """Read an HDF5 file; parameters as of `lumbar.records.importing.text_table.read_text`.

    A matrix is taken with its samples along the longer axis: MATLAB writes them along the other one than most.

    Raises
    ------
    InputError
        If h5py is not installed, or the file is broken or holds no vectors of one length.
    """
    try:
        import h5py
    except ImportError as error:
        raise InputError(
            f"{source}: an HDF5 file (MATLAB 7.3 writes them too) needs the package h5py: pip install 'lumbar[import]'"
        ) from error
    arrays: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}

    def collect(path: str, item) -> None:
        for name in item.attrs:
            if np.size(item.attrs[name]) == 1 and np.asarray(item.attrs[name]).dtype.kind in "fiu":
                arrays[f"{path}/{name}"] = np.asarray(item.attrs[name])
        if not isinstance(item, h5py.Dataset) or path.startswith("#"):  # MATLAB's own book-keeping
            return
        if item.size is not None and item.size > MOST_NUMBERS:
            raise InputError(
                f"{source}: {path} says that it holds {item.size} numbers; at most {MOST_NUMBERS} are read"
            )
        fields = item.dtype.names
        for name in fields or [None]:
            if (item.dtype[name] if name else item.dtype).kind in "fiu":
                values = np.squeeze(item[name] if name else item[()])
                long = values.ndim == 2 and values.shape[1] > values.shape[0]
                arrays[f"{path}/{name}" if name else path] = values.T if long else values
        unit = next((item.attrs[name] for name in item.attrs if name.casefold() in ("unit", "units")), None)
        if unit is not None:
            units[path] = unit.decode() if isinstance(unit, bytes) else str(unit)

    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            file.visititems(collect)
            for name, value in file.attrs.items():
                if np.size(value) == 1 and np.asarray(value).dtype.kind in "fiu":
                    arrays[name] = np.asarray(value)
    except InputError:
        raise
    except Exception as error:  # a broken file leads h5py to errors of many kinds
        raise InputError(f"{source}: a broken HDF5 file ({error})") from error
    return to_table(arrays, source, "HDF5", table, units)
