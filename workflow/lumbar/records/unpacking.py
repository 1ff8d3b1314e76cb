"""Packed files unpacked up to a limit: a small file may stand for gigabytes."""

from __future__ import annotations

import io
import math
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lumbar.base.errors import InputError
from lumbar.base.files import LARGEST_FILE

_PIECE = 1_000_000
PACKED = ".gz"
_MATLAB_HEADER, _COMPRESSED = 128, 15
"""Bytes before the first variable, and the type of a packed one (MATLAB's description of MAT-files, level 5)."""
MOST_NUMBERS = LARGEST_FILE // 8
"""Numbers, or cells, of one file."""


def ending_of(path: Path) -> str:
    """Ending of a file in small letters without that of packing: ``".trc"`` of ``squat.TRC.gz``."""
    return path.with_suffix("").suffix.lower() if path.suffix.lower() == PACKED else path.suffix.lower()


def stem_of(path: Path) -> str:
    """Name of a file without its endings: ``squat`` of ``squat.trc.gz``."""
    return path.with_suffix("").stem if path.suffix.lower() == PACKED else path.stem


def unpack(stored: bytes, path: Path) -> bytes:
    """Return what a gzipped file holds.

    Raises
    ------
    InputError
        The file is broken or cut short, or unpacks to more than `LARGEST_FILE`.
    """
    # A buffer that is given away, not pieces that are joined: the whole is there once.
    whole, remaining = io.BytesIO(), stored
    while remaining:
        reader = zlib.decompressobj(wbits=31)
        for piece in _pieces(reader, remaining, LARGEST_FILE - whole.tell(), len(stored), str(path)):
            whole.write(piece)
        remaining = reader.unused_data.lstrip(b"\0")
    return whole.getvalue()


def check_zip(content: bytes, source: str) -> None:
    """Raise where a zip archive, as a workbook is one, says that it unpacks to more than `LARGEST_FILE`, or is broken."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            size = sum(item.file_size for item in archive.infolist())
    except Exception as error:  # a broken archive leads to errors of many kinds
        raise InputError(f"{source}: the packed file is broken ({error})") from error
    check_size(size, len(content), source)


def check_size(size: float, stored: int, source: str) -> None:
    """Raise where what a file of `stored` bytes holds takes more than `LARGEST_FILE`."""
    if size > LARGEST_FILE:
        raise InputError(
            f"{source}: unpacks to more than {LARGEST_FILE / 1e6:.0f} MB, from {stored / 1e6:.2g} MB; that is the most that is "
            "read of a file: save the recording by itself"
        )


def _pieces(reader, stored: bytes, left: int, size: int, source: str) -> Iterator[bytes]:
    """What one packed stream holds, piece by piece, of which at most `left` bytes are unpacked."""
    try:
        while not reader.eof:
            piece = reader.decompress(stored, _PIECE)
            stored = reader.unconsumed_tail
            left -= len(piece)
            check_size(LARGEST_FILE - left, size, source)
            if not piece and not stored and not reader.eof:
                raise InputError(f"{source}: the packed file is cut short; copy it again")
            yield piece
    except zlib.error as error:
        raise InputError(f"{source}: the packed file is broken ({error})") from error


@contextmanager
def readable_path(path: Path) -> Iterator[Path]:
    """Give the path under which a file can be read: a packed one is unpacked, up to `LARGEST_FILE`, for as long.

    Messages about the unpacked file name the packed one.
    """
    if path.suffix.lower() != PACKED:
        yield path
        return
    with TemporaryDirectory() as folder:
        plain = Path(folder) / path.with_suffix("").name
        plain.write_bytes(unpack(path.read_bytes(), path))
        try:
            yield plain
        except InputError as error:
            raise type(error)(str(error).replace(str(plain), str(path))) from error


def load_matlab(content: bytes, source: str, broken: str, **options) -> dict[str, Any]:
    """Return the variables of a MATLAB file by name; `options` as of `scipy.io.loadmat`.

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
    place, left = _MATLAB_HEADER, LARGEST_FILE
    while order and place + 8 <= len(content):
        kind, size = struct.unpack(f"{order}2I", content[place : place + 8])
        if kind == _COMPRESSED:
            packed = content[place + 8 : place + 8 + size]
            left -= sum(map(len, _pieces(zlib.decompressobj(), packed, left, len(content), source)))
        place += 8 + size
