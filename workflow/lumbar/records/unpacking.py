"""Packed files, unpacked up to a limit: a small file may unpack to gigabytes."""

import gzip
import io
import math
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from lumbar.base.errors import InputError
from lumbar.base.files import MAX_FILE_BYTES

_PIECE_BYTES = 1_000_000
_GZIP_ENDING = ".gz"


def ending_of(path: Path) -> str:
    """Return a file's ending in lower case without the ending of packing: ``".trc"`` of ``squat.TRC.gz``.

    Parameters
    ----------
    path : Path
        The file; it need not exist.
    """
    is_packed = path.suffix.lower() == _GZIP_ENDING
    return (path.with_suffix("") if is_packed else path).suffix.lower()


def stem_of(path: Path) -> str:
    """Return a file's name without its endings: ``squat`` of ``squat.trc.gz``.

    Parameters
    ----------
    path : Path
        The file; it need not exist.
    """
    return (path.with_suffix("") if path.suffix.lower() == _GZIP_ENDING else path).stem


def unpack(packed: bytes, path: Path, output: Any) -> None:
    """Unpack the content of a gzipped file into an open file.

    Parameters
    ----------
    packed : bytes
        Content of the gzipped file.
    path : Path
        The file, for messages.
    output : binary file
        File to which the unpacked content is appended.

    Raises
    ------
    InputError
        If the file is broken or cut short, or unpacks to more than `MAX_FILE_BYTES`.
    """
    try:
        with gzip.open(io.BytesIO(packed)) as file:
            while piece := file.read(_PIECE_BYTES):
                check_size(output.tell() + len(piece), len(packed), str(path))
                output.write(piece)
    except EOFError as error:
        raise InputError(f"{path}: the packed file is cut short; copy it again") from error
    except (OSError, zlib.error) as error:
        raise InputError(f"{path}: the packed file is broken ({error})") from error


def check_size(size: float, packed_size: int, source: str) -> None:
    """Raise if the content of a file takes more than `MAX_FILE_BYTES`.

    Parameters
    ----------
    size : float
        Size after unpacking in bytes.
    packed_size : int
        Size of the packed file in bytes.
    source : str
        The file, for messages.

    Raises
    ------
    InputError
        If the content is larger, with both sizes in megabytes.
    """
    if size > MAX_FILE_BYTES:
        raise InputError(
            f"{source}: unpacks to more than {MAX_FILE_BYTES / 1e6:.0f} MB, from {packed_size / 1e6:.2g} MB; save the recording "
            "by itself"
        )


@contextmanager
def report_broken(message: str) -> Iterator[None]:
    """Raise an `InputError` for any other error in the block: a broken file causes errors of many kinds.

    Parameters
    ----------
    message : str
        Beginning of the message; the error's own text follows.

    Raises
    ------
    InputError
        If the block raised an `Exception`.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{message} ({error})") from error


def read_readable(path: Path, read: Callable[..., Any], *options: Any) -> Any:
    """Return the result of ``read(path, *options)``; a gzipped file is unpacked for it.

    Errors about the unpacked file name the packed one.

    Parameters
    ----------
    path : Path
        The file.
    read : callable
        Reader of an unpacked file.
    *options
        Further arguments of `read`.

    Raises
    ------
    InputError
        If `unpack` or `read` raises it.
    """
    if path.suffix.lower() != _GZIP_ENDING:
        return read(path, *options)
    # In memory if the system supports it; the file is removed when it is closed.
    in_memory = hasattr(os, "memfd_create")
    with os.fdopen(os.memfd_create("unpacked"), "wb") if in_memory else NamedTemporaryFile() as file:
        unpacked = Path(f"/proc/self/fd/{file.fileno()}" if in_memory else file.name)
        unpack(path.read_bytes(), path, file)
        file.flush()
        try:
            return read(unpacked, *options)
        except InputError as error:
            raise type(error)(str(error).replace(str(unpacked), str(path))) from error


_HEADER_BYTES, _COMPRESSED_TYPE = 128, 15
"""Bytes before the first variable, and type number of a packed variable (MATLAB's description of MAT-files, level 5)."""


def load_matlab(content: bytes, source: str, **options) -> dict[str, Any]:
    """Return the variables of a MATLAB file by name.

    Parameters
    ----------
    content : bytes
        The file's content.
    source : str
        The file, for messages.
    **options
        Options of `scipy.io.loadmat`.

    Raises
    ------
    InputError
        If the file is not of version 4 to 7.2, too large or broken.
    """
    from scipy.io import loadmat, whosmat

    with report_broken(f"{source}: not a MATLAB file of version 4 to 7.2; save it with -v7"):
        stated = whosmat(io.BytesIO(content))
    check_size(8 * sum(math.prod(shape) for _, shape, _ in stated), len(content), source)
    variables: dict[str, Any] = {}
    with report_broken(f"{source}: not a MATLAB file that can be read"):
        # Packed variables of version 5 to 7.2 are unpacked up to the limit, because the size of a struct is not stated.
        order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
        place, left = _HEADER_BYTES, MAX_FILE_BYTES
        while order and place + 8 <= len(content):
            kind, size = struct.unpack(f"{order}2I", content[place : place + 8])
            place += 8
            if kind == _COMPRESSED_TYPE:
                left -= len(zlib.decompressobj().decompress(content[place : place + size], left + 1))
                check_size(MAX_FILE_BYTES - left, len(content), source)
            place += size
        loadmat(io.BytesIO(content), variables, **options)
    return variables
