"""Names of files, atomic writing, and strict reading of JSON."""

import contextlib
import errno
import json
import math
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from lumbar.base.errors import InputError, NumericalError

_TEMPORARY = re.compile(r"\.(?P<file>.+)\.[a-z0-9_]{8}")
"""Name of a folder of `replacing`: the file's name, and eight characters of `tempfile`."""
_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)


def is_device(name: str) -> bool:
    """Return whether a name, with any ending, is the name of a device on Windows, which no file can have.

    Examples
    --------
    >>> is_device("con"), is_device("Aux.csv"), is_device("control.csv")
    (True, True, False)
    """
    return _DEVICE.fullmatch(name) is not None


def sanitize_name(text: str, default: str, allowed: str = "_-") -> str:
    """Return a valid name for a file or a record, made from any text.

    Parameters
    ----------
    text : str
        Any text.
    default : str
        Name if `text` has no allowed character.
    allowed : str
        Characters that stay, in addition to ASCII letters and digits; all others become ``_``.

    Examples
    --------
    >>> sanitize_name("../gait trial 3", "study"), sanitize_name("???", "study"), sanitize_name("con", "study")
    ('gait_trial_3', 'study', 'con_')
    """
    name = re.sub(rf"[^A-Za-z0-9{re.escape(allowed)}]+", "_", text).strip(allowed) or default
    return f"{name}_" if is_device(name) else name


MAX_FILE_BYTES = 200_000_000
"""Largest size of a file of any kind, packed or unpacked."""
MAX_JSON_BYTES = 15_000_000
"""Largest size of a JSON file; its values may need thirty times as much memory."""
MAX_JSON_LISTS = 1_000_000
"""Largest number of lists and objects in a JSON file; each needs up to 115 bytes."""


def require_file(path: str | os.PathLike, max_bytes: int = MAX_FILE_BYTES) -> int:
    """Return the size of a data file in bytes, without opening it: a pipe would block its reader, a device never ends.

    Raises
    ------
    InputError
        If the path is no file, a folder, a pipe or a device, or the file has more than `max_bytes`.
    """
    try:
        status = Path(path).stat()
    except (FileNotFoundError, NotADirectoryError) as error:
        raise InputError(f"{path}: no such file") from error
    if stat.S_ISDIR(status.st_mode):
        raise InputError(f"{path}: a folder; name the files in it that are recordings")
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: a pipe or a device; a file is needed")
    if status.st_size > max_bytes:
        raise InputError(
            f"{path}: {status.st_size / 1e6:.0f} MB; files of at most {max_bytes / 1e6:.0f} MB are read: save a part by itself"
        )
    return status.st_size


def refuse_links(folder: str | os.PathLike) -> None:
    """Raise if a symbolic link leads out of a folder that is to be written to.

    Raises
    ------
    InputError
        If the folder's path is such a link, or the folder contains such a link; with the link.
    """
    place = Path(folder).absolute()
    for path in (place, *(path for path in place.rglob("*") if path.is_symlink())):
        if not path.resolve().is_relative_to(place):
            raise InputError(f"{path}: a link to {path.resolve()}, where nothing is written: remove it")


@contextlib.contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """Yield a temporary path whose file replaces `path` if the block succeeds.

    If the block raises, no file is left; `leftover_temp_files` returns the temporary files of a killed process.

    Raises
    ------
    OSError
        If the file cannot be written; the error names `path`, not the temporary file.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    prefix = f".{path.name}."
    try:
        with tempfile.TemporaryDirectory(prefix=prefix, dir=path.parent) as folder:
            temporary = Path(folder) / path.name
            yield temporary
            temporary.replace(path)
    except OSError as error:
        if error.filename is None or str(path.parent / prefix) in str(error.filename):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


_MIN_FREE_BYTES = 20e6
"""Free space required before a long computation: a diagnosis with all its pictures writes a few million bytes."""


def check_place(folder: str | os.PathLike) -> None:
    """Check before a computation that its results can be written to a folder, which is not created.

    Raises
    ------
    OSError
        If a file has the folder's name, writing is not permitted, or the disk is almost full.
    """
    folder = Path(folder).absolute()
    there = next(place for place in (folder, *folder.parents) if place.exists())
    if not there.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(there))
    try:
        with tempfile.TemporaryDirectory(dir=there):
            pass
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(there)) from error
    if shutil.disk_usage(there).free < _MIN_FREE_BYTES:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(there / "results"))


def leftover_temp_files(folder: str | os.PathLike) -> list[tuple[str, Path]]:
    """Return the unfinished files of killed processes in a folder (see `replacing`): names and temporary folders."""
    paths = [path for path in Path(folder).iterdir() if path.is_dir()] if Path(folder).is_dir() else []
    return [(match["file"], path) for path in paths if (match := _TEMPORARY.fullmatch(path.name))]


def write_text(path: str | os.PathLike, text: str) -> None:
    """Write UTF-8 text with Unix line ends, completely or not at all; ``?`` replaces surrogates, which file names may contain."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="replace", newline="\n")


def write_csv(path: str | os.PathLike, frame) -> None:
    """Write a data frame as CSV: no index, full precision, Unix line ends."""
    with replacing(path) as temporary:
        frame.to_csv(temporary, index=False, lineterminator="\n", errors="replace")


def write_number_columns(path: str | os.PathLike, columns: Mapping[str, Any]) -> None:
    """Write arrays of finite numbers as columns of CSV, as `write_csv` does, in half its time."""
    rows = zip(*(map(repr, values.tolist()) for values in columns.values()), strict=True)
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(f"{','.join(columns)}\n")
        stream.writelines(f"{','.join(row)}\n" for row in rows)


def _to_json(value, place: str):
    """Convert numpy scalars and arrays to JSON's own types; raise on NaN and infinity."""
    if isinstance(value, dict):
        return {str(key): _to_json(item, f"{place}.{key}") for key, item in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_to_json(item, f"{place}[{index}]") for index, item in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        raise NumericalError(f"{place} is {value}: a result that is not finite is never written")
    return value


def write_json(path: str | os.PathLike, value) -> None:
    """Write JSON, numpy values included; None means unknown.

    Raises
    ------
    NumericalError
        If any number is NaN or infinite.
    """
    text = json.dumps(_to_json(value, Path(path).name), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(path, text + "\n")


def read_json(path: str | os.PathLike):
    """Read a JSON file.

    Raises
    ------
    InputError
        If `require_file` raises it, or the file exceeds `MAX_JSON_BYTES`, is not UTF-8, or is not valid JSON (with the line).
        NaN and Infinity are not valid.
    """

    def reject(constant: str):
        raise InputError(f"{path}: holds {constant}, which is not valid JSON")

    require_file(path, MAX_JSON_BYTES)
    content = Path(path).read_bytes()
    if content.count(b"[") + content.count(b"{") > MAX_JSON_LISTS:
        raise InputError(f"{path}: more than {MAX_JSON_LISTS} lists and objects; save a part by itself")
    try:
        return json.loads(content.decode("utf-8"), parse_constant=reject)
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text ({error})") from error
    except RecursionError as error:
        raise InputError(f"{path}: nested too deep for any result") from error
    except json.JSONDecodeError as error:
        raise InputError(f"{path}, line {error.lineno}: not valid JSON ({error.msg})") from error
    except ValueError as error:  # a number of more digits than Python reads
        raise InputError(f"{path}: not valid JSON ({error})") from error
