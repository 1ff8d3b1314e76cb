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
from typing import Any, BinaryIO

from lumbar.base.errors import InputError

SMALLEST_LIMIT, LARGEST_RATIO = 50_000_000, 100
"""Bytes that any file may unpack to, and how many times its own size where that is more: records pack to a tenth."""
_PIECE = 1_000_000
PACKED = ".gz"
_MATLAB_HEADER, _COMPRESSED = 128, 15
"""Bytes before the first variable, and the type of a packed one (MATLAB's description of MAT-files, level 5)."""
MOST_NUMBERS = 50_000_000
"""Numbers of one variable of a MATLAB file."""


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
        The file is broken or cut short, or unpacks to more than the limits above.
    """
    pieces, left = [], _limit(len(stored))
    remaining = stored
    while remaining:
        reader = zlib.decompressobj(wbits=31)
        for piece in _pieces(reader, remaining, left, len(stored), str(path), "the unpacked file"):
            pieces.append(piece)
            left -= len(piece)
        remaining = reader.unused_data.lstrip(b"\0")
    return b"".join(pieces)


def check_zip(content: bytes, source: str) -> None:
    """Raise where a zip archive, as a workbook is one, says that it unpacks to more than the limits above, or is broken."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            size = sum(item.file_size for item in archive.infolist())
    except Exception as error:  # a broken archive leads to errors of many kinds
        raise InputError(f"{source}: the packed file is broken ({error})") from error
    if size > _limit(len(content)):
        raise InputError(
            f"{source}: unpacks to {size / 1e6:.0f} MB, from {len(content) / 1e6:.2g} MB; at most {LARGEST_RATIO} times a "
            "file's size are unpacked: save the sheet as .csv"
        )


def _limit(size: int) -> int:
    return max(SMALLEST_LIMIT, LARGEST_RATIO * size)


def _pieces(reader, stored: bytes, left: int, size: int, source: str, unpacked: str) -> Iterator[bytes]:
    """What one packed stream holds, piece by piece, of which at most `left` bytes are unpacked; advice for more."""
    try:
        while not reader.eof:
            piece = reader.decompress(stored, _PIECE)
            stored = reader.unconsumed_tail
            left -= len(piece)
            if left < 0:
                raise InputError(
                    f"{source}: unpacks to more than {_limit(size) / 1e6:.0f} MB, from {size / 1e6:.2g} MB; "
                    f"at most {LARGEST_RATIO} times a file's size are unpacked: give {unpacked}"
                )
            if not piece and not stored and not reader.eof:
                raise InputError(f"{source}: the packed file is cut short; copy it again")
            yield piece
    except zlib.error as error:
        raise InputError(f"{source}: the packed file is broken ({error})") from error


@contextmanager
def readable_path(path: Path) -> Iterator[Path]:
    """Give the path under which a file can be read: a packed one is unpacked, up to the limits above, for as long.

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


def load_matlab(file: Path | bytes, source: str, broken: str, **options) -> dict[str, Any]:
    """Return the variables of a MATLAB file, or of its bytes, by name; `options` as of `scipy.io.loadmat`.

    Raises
    ------
    InputError
        Where the file is none of version 4 to 7.2 or too large, or SciPy cannot read it: `broken` says so.
    """
    from scipy.io import loadmat

    def opened() -> Path | BinaryIO:
        return io.BytesIO(file) if isinstance(file, bytes) else file

    _check_matlab(opened(), source)
    try:
        return loadmat(opened(), **options)
    except Exception as error:  # a broken file leads SciPy's reader to errors of many kinds
        raise InputError(f"{source}: {broken} ({error})") from error


def _check_matlab(file: Path | BinaryIO, source: str) -> None:
    """Raise where what a MATLAB file holds, which packs its variables, is larger than any recording."""
    from scipy.io import whosmat

    try:
        variables = whosmat(file)
    except Exception as error:  # a broken file leads SciPy's reader to errors of many kinds
        raise InputError(
            f"{source}: not a MATLAB file of version 4 to 7.2 (save it with -v7; {error})"
        ) from error
    for name, shape, _ in variables:
        if math.prod(shape) > MOST_NUMBERS:
            raise InputError(
                f"{source}: its variable {name!r} holds {math.prod(shape)} numbers; at most {MOST_NUMBERS} are read: "
                "save the recording by itself"
            )
    _check_packed_variables(file, source)


def _check_packed_variables(file: Path | BinaryIO, source: str) -> None:
    """Unpack the variables of a MATLAB file of version 5 to 7.2 as far as the limits allow: a struct hides its size."""
    if isinstance(file, Path):
        content = file.read_bytes()
    else:
        content = file.read()
        file.seek(0)
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    place, left = _MATLAB_HEADER, _limit(len(content))
    while order and place + 8 <= len(content):
        kind, size = struct.unpack(f"{order}2I", content[place : place + 8])
        if kind == _COMPRESSED:
            packed = content[place + 8 : place + 8 + size]
            left -= sum(
                map(
                    len,
                    _pieces(zlib.decompressobj(), packed, left, len(content), source, "it saved with -v6"),
                )
            )
        place += 8 + size
