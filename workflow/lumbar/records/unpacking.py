"""Packed files unpacked up to a limit: a small file may stand for gigabytes."""

import gzip
import io
import math
import os
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from lumbar.base.errors import InputError
from lumbar.base.files import MAX_FILE_BYTES

_PIECE = 1_000_000
PACKED = ".gz"
MOST_NUMBERS = MAX_FILE_BYTES // 8
"""Numbers, or cells, of one file."""


def ending_of(path: Path) -> str:
    """Ending of a file in small letters without that of packing: ``".trc"`` of ``squat.TRC.gz``."""
    return path.with_suffix("").suffix.lower() if path.suffix.lower() == PACKED else path.suffix.lower()


def stem_of(path: Path) -> str:
    """Name of a file without its endings: ``squat`` of ``squat.trc.gz``."""
    return path.with_suffix("").stem if path.suffix.lower() == PACKED else path.stem


def unpack(stored: bytes, path: Path, into: Any) -> None:
    """Write what a gzipped file holds into a file that is open.

    Raises
    ------
    InputError
        The file is broken or cut short, or unpacks to more than `MAX_FILE_BYTES`.
    """
    try:
        with gzip.open(io.BytesIO(stored)) as file:
            while piece := file.read(_PIECE):
                check_size(into.tell() + len(piece), len(stored), str(path))
                into.write(piece)
    except EOFError as error:
        raise InputError(f"{path}: the packed file is cut short; copy it again") from error
    except (OSError, zlib.error) as error:
        raise InputError(f"{path}: the packed file is broken ({error})") from error


def check_zip(content: bytes, source: str) -> None:
    """Raise where a zip archive, as a workbook is one, says that it unpacks to more than `MAX_FILE_BYTES`, or is broken."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            size = sum(item.file_size for item in archive.infolist())
    except Exception as error:  # a broken archive leads to errors of many kinds
        raise InputError(f"{source}: the packed file is broken ({error})") from error
    check_size(size, len(content), source)


def check_size(size: float, stored: int, source: str) -> None:
    """Raise where what a file of `stored` bytes holds takes more than `MAX_FILE_BYTES`."""
    if size > MAX_FILE_BYTES:
        raise InputError(
            f"{source}: unpacks to more than {MAX_FILE_BYTES / 1e6:.0f} MB, from {stored / 1e6:.2g} MB; that is the most that is "
            "read of a file: save the recording by itself"
        )


def read_readable(path: Path, read: Callable[..., Any], *options: Any) -> Any:
    """Return what a function reads of a path: a packed file is unpacked, up to `MAX_FILE_BYTES`, for as long.

    Messages about the unpacked file name the packed one.
    """
    if path.suffix.lower() != PACKED:
        return read(path, *options)
    # Gone with this process: in memory, where the system has such files.
    in_memory = hasattr(os, "memfd_create")
    with os.fdopen(os.memfd_create("unpacked"), "wb") if in_memory else NamedTemporaryFile() as file:
        plain = Path(f"/proc/self/fd/{file.fileno()}" if in_memory else file.name)
        unpack(path.read_bytes(), path, file)
        file.flush()
        try:
            return read(plain, *options)
        except InputError as error:
            raise type(error)(str(error).replace(str(plain), str(path))) from error


_MATLAB_HEADER, _COMPRESSED = 128, 15
"""Bytes before the first variable, and the type of a packed one (MATLAB's description of MAT-files, level 5)."""


def load_matlab(content: bytes, source: str, broken: str, **options) -> dict[str, Any]:
    """Return the variables of a MATLAB file by name; `options` as for `scipy.io.loadmat`.

    Raises
    ------
    InputError
        Where the file is none of version 4 to 7.2 or too large, or SciPy cannot read it: `broken` says so.
    """
    from scipy.io import loadmat, whosmat

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
    place, left = _MATLAB_HEADER, MAX_FILE_BYTES
    while order and place + 8 <= len(content):
        kind, size = struct.unpack(f"{order}2I", content[place : place + 8])
        if kind == _COMPRESSED:
            packed = content[place + 8 : place + 8 + size]
            try:
                left -= len(zlib.decompressobj().decompress(packed, left + 1))
            except zlib.error as error:
                raise InputError(f"{source}: the packed file is broken ({error})") from error
            check_size(MAX_FILE_BYTES - left, len(content), source)
        place += 8 + size
