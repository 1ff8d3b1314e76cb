"""Packed files unpacked up to a limit: a small file may stand for gigabytes."""

from __future__ import annotations

import io
import os
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from lumbar.base.errors import InputError
from lumbar.base.files import LARGEST_FILE

_PIECE = 1_000_000
PACKED = ".gz"
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
        for piece in pieces(reader, remaining, LARGEST_FILE - whole.tell(), len(stored), str(path)):
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


def pieces(reader, stored: bytes, left: int, size: int, source: str) -> Iterator[bytes]:
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


def read_readable(path: Path, read: Callable[..., Any], *options: Any) -> Any:
    """Return what a function reads of a path: a packed file is unpacked, up to `LARGEST_FILE`, for as long.

    Messages about the unpacked file name the packed one.
    """
    if path.suffix.lower() != PACKED:
        return read(path, *options)
    with _memory_file(unpack(path.read_bytes(), path)) as plain:
        try:
            return read(plain, *options)
        except InputError as error:
            raise type(error)(str(error).replace(str(plain), str(path))) from error


@contextmanager
def _memory_file(content: bytes) -> Iterator[Path]:
    """Give the path of a file that ends with this process: in memory, where the system has such."""
    if hasattr(os, "memfd_create"):
        with open(os.memfd_create("unpacked"), "wb") as file:  # noqa: PTH123 - a number, no path
            file.write(content)
            file.flush()
            del content
            yield Path(f"/proc/self/fd/{file.fileno()}")
    else:
        with NamedTemporaryFile() as file:
            file.write(content)
            file.flush()
            yield Path(file.name)
