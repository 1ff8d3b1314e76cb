"""Packed files unpacked up to a limit: a small file may stand for gigabytes."""

from __future__ import annotations

import math
import os
import zlib
from pathlib import Path
from typing import BinaryIO

from lumbar.errors import InputError

SMALLEST_LIMIT, LARGEST_RATIO = 50_000_000, 100
"""Bytes that any file may unpack to, and how many times its own size where that is more: records pack to a tenth."""
_PIECE = 1_000_000
MOST_NUMBERS = 50_000_000
"""Numbers of one variable of a MATLAB file."""


def unpack(stored: bytes, path: Path) -> bytes:
    """Return what a gzipped file holds.

    Parameters
    ----------
    stored : bytes
        The file.
    path : Path
        For messages.

    Raises
    ------
    InputError
        The file is broken or cut short, or unpacks to more than the limits above.
    """
    limit = max(SMALLEST_LIMIT, LARGEST_RATIO * len(stored))
    pieces, size = [], 0
    try:
        while stored:
            reader = zlib.decompressobj(wbits=31)
            while not reader.eof:
                piece = reader.decompress(stored, _PIECE)
                stored = reader.unconsumed_tail
                pieces.append(piece)
                size += len(piece)
                if size > limit:
                    raise InputError(
                        f"{path}: unpacks to more than {limit / 1e6:.0f} MB, from {path.stat().st_size / 1e6:.2g} MB; "
                        f"at most {LARGEST_RATIO} times a file's size are unpacked: give the unpacked file"
                    )
                if not piece and not stored and not reader.eof:
                    raise InputError(f"{path}: the packed file is cut short; copy it again")
            stored = reader.unused_data.lstrip(b"\0")
    except zlib.error as error:
        raise InputError(f"{path}: the packed file is broken ({error})") from error
    return b"".join(pieces)


def check_matlab(file: str | os.PathLike | BinaryIO, source: str) -> None:
    """Raise where a variable of a MATLAB file, which packs its variables, is larger than any recording.

    Parameters
    ----------
    file : path or binary stream
    source : str
        For messages.

    Raises
    ------
    InputError
        Also where the file is no MATLAB file of version 4 to 7.2.
    """
    from scipy.io import whosmat

    try:
        variables = whosmat(file)
    except Exception as error:  # a broken file leads SciPy's reader to errors of many kinds
        raise InputError(f"{source}: not a MATLAB file of version 4 to 7.2 ({error})") from error
    for name, shape, _ in variables:
        if math.prod(shape) > MOST_NUMBERS:
            raise InputError(
                f"{source}: its variable {name!r} holds {math.prod(shape)} numbers; at most {MOST_NUMBERS} are read: "
                "save the recording by itself"
            )
