"""MATLAB files of version 4 to 7.2, whose variables are packed, within the limit of any file."""

import io
import math
import struct
import zlib
from typing import Any

from scipy.io import loadmat, whosmat

from lumbar.base.errors import InputError
from lumbar.base.files import LARGEST_FILE
from lumbar.records.unpacking import check_size

_MATLAB_HEADER, _COMPRESSED = 128, 15
"""Bytes before the first variable, and the type of a packed one (MATLAB's description of MAT-files, level 5)."""


def load_matlab(content: bytes, source: str, broken: str, **options) -> dict[str, Any]:
    """Return the variables of a MATLAB file by name; `options` as of `scipy.io.loadmat`.

    Raises
    ------
    InputError
        Where the file is none of version 4 to 7.2 or too large, or SciPy cannot read it: `broken` says so.
    """
    try:
        stated = whosmat(io.BytesIO(content))
    except Exception as error:  # a broken file leads SciPy's reader to errors of many kinds
        raise InputError(
            f"{source}: not a MATLAB file of version 4 to 7.2 (save it with -v7; {error})"
        ) from error
    check_size(8 * sum(math.prod(shape) for _, shape, _ in stated), len(content), source)
    _check_packed_variables(content, source)
    try:
        return loadmat(io.BytesIO(content), **options)
    except Exception as error:  # a broken file leads SciPy's reader to errors of many kinds
        raise InputError(f"{source}: {broken} ({error})") from error


def _check_packed_variables(content: bytes, source: str) -> None:
    """Unpack the variables of a MATLAB file of version 5 to 7.2 as far as the limit allows: a struct hides its size."""
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    place, left = _MATLAB_HEADER, LARGEST_FILE
    while order and place + 8 <= len(content):
        kind, size = struct.unpack(f"{order}2I", content[place : place + 8])
        if kind == _COMPRESSED:
            packed = content[place + 8 : place + 8 + size]
            try:
                left -= len(zlib.decompressobj().decompress(packed, left + 1))
            except zlib.error as error:
                raise InputError(f"{source}: the packed file is broken ({error})") from error
            check_size(LARGEST_FILE - left, len(content), source)
        place += 8 + size
