"""Names of files, writing them whole or not at all, and reading JSON strictly."""

import contextlib
import errno
import json
import math
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from lumbar.base.errors import InputError, NumericalError

_TEMPORARY = re.compile(r"\.(?P<file>.+)\.[a-z0-9_]{8}")
"""Folders of `replacing`: the file's name, and eight characters of `tempfile`."""

_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)


def is_device(name: str) -> bool:
    """Whether this names a device on Windows, whatever its ending: no file can be called so there.

    Examples
    --------
    >>> is_device("con"), is_device("Aux.csv"), is_device("control.csv")
    (True, True, False)
    """
    return _DEVICE.fullmatch(name) is not None


def sanitize_name(text: str, otherwise: str, others: str = "_-") -> str:
    """Return a text with ``_`` for what no name holds: letters, digits and `others` stay; `otherwise` where nothing is left.

    Examples
    --------
    >>> sanitize_name("../gait trial 3", "study"), sanitize_name("???", "study"), sanitize_name("con", "study")
    ('gait_trial_3', 'study', 'con_')
    """
    name = re.sub(rf"[^A-Za-z0-9{re.escape(others)}]+", "_", text).strip(others) or otherwise
    return f"{name}_" if is_device(name) else name


LARGEST_FILE = 200_000_000
"""Bytes of a file that is read, of any kind, as it lies and unpacked."""


LARGEST_JSON, MOST_LISTS = 15_000_000, 1_000_000
"""Bytes of a JSON file, whose values may take thirty times as much; lists and objects in it, whose two take up to 230."""


def require_file(path: str | os.PathLike, most: int = LARGEST_FILE) -> int:
    """Return the bytes of a file of data; refuse what is none before it is opened: a pipe hangs its reader, a device never ends.

    Raises
    ------
    InputError
        No such file; a folder, a pipe or a device; a file of more than `most` bytes.
    """
    try:
        found = Path(path).stat()
    except (FileNotFoundError, NotADirectoryError) as error:
        raise InputError(f"{path}: no such file") from error
    if stat.S_ISDIR(found.st_mode):
        raise InputError(f"{path}: a folder; name the files in it that are recordings")
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path}: a pipe or a device; a file is needed")
    if found.st_size > most:
        raise InputError(
            f"{path}: {found.st_size / 1e6:.0f} MB; files of at most {most / 1e6:.0f} MB are read: save a part by itself"
        )
    return found.st_size


def refuse_links(folder: str | os.PathLike) -> None:
    """Refuse a folder that is to be written to where a link leads out of it, or on the way to it elsewhere.

    Raises
    ------
    InputError
        Naming the link.
    """
    place = Path(folder).absolute()
    links = [place, *(path for path in place.rglob("*") if path.is_symlink())]
    for path in links:
        if not path.resolve().is_relative_to(place):
            raise InputError(
                f"{path}: leads by a link to {path.resolve()}; nothing is written there: remove the link"
            )


@contextlib.contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """Yield a temporary path whose file replaces `path` if the block succeeds.

    If the block raises, nothing is left; `leftover_temp_files` returns what a killed process left.

    Raises
    ------
    OSError
        Naming `path`, where the system's own error names no file (a full disk) or the temporary one.
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


_LEAST_FREE = 20e6
"""Bytes that must be free before work of minutes begins: a diagnosis with all its pictures writes a few million."""


def check_place(folder: str | os.PathLike) -> None:
    """Raise, before the work whose results are meant for a folder, what writing them would raise after it.

    Nothing is made or left behind.

    Raises
    ------
    OSError
        Where a file stands in the way, nothing may be written, or hardly any space is left.
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
    if shutil.disk_usage(there).free < _LEAST_FREE:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(there / "results"))


def leftover_temp_files(folder: str | os.PathLike) -> list[tuple[str, Path]]:
    """Return what `replacing` left in a folder as its process was killed: names of the files, and what lies there for them."""
    folder = Path(folder)
    found = [(_TEMPORARY.fullmatch(path.name), path) for path in folder.iterdir()] if folder.is_dir() else []
    return [(name["file"], path) for name, path in found if name and path.is_dir()]


def write_text(path: str | os.PathLike, text: str) -> None:
    """Write UTF-8 text with Unix line ends, whole or not at all; ``?`` for what is no text, as in names of files."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="replace", newline="\n")


def write_csv(path: str | os.PathLike, frame) -> None:
    """Write a data frame as CSV: no index, full precision, Unix line ends."""
    with replacing(path) as temporary:
        frame.to_csv(temporary, index=False, lineterminator="\n", errors="replace")


def _plain(value, place: str):
    """Turn numpy scalars and arrays into JSON's own types; refuse NaN and infinity."""
    if isinstance(value, dict):
        return {str(key): _plain(item, f"{place}.{key}") for key, item in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item, f"{place}[{index}]") for index, item in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        raise NumericalError(f"{place} is {value}: a result that is not finite is never written")
    return value


def write_json(path: str | os.PathLike, value) -> None:
    """Write JSON, numpy values included; `None` stands for "not known".

    Raises
    ------
    NumericalError
        If any number is NaN or infinite.
    """
    text = json.dumps(_plain(value, Path(path).name), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(path, text + "\n")


def read_json(path: str | os.PathLike):
    """Read a JSON file.

    Raises
    ------
    InputError
        As `require_file` and `parsed_json`.
    """
    require_file(path, LARGEST_JSON)
    return parsed_json(Path(path).read_bytes(), str(path))


def parsed_json(content: bytes, place: str):
    """Values of a text in JSON.

    Parameters
    ----------
    place : str
        What holds it, for messages.

    Raises
    ------
    InputError
        It is longer than `LARGEST_JSON`, not UTF-8, or not valid JSON (with the line). NaN and Infinity are not JSON.
    """

    def refuse(constant: str):
        raise InputError(f"{place}: holds {constant}, which is not valid JSON")

    if len(content) > LARGEST_JSON:
        raise InputError(f"{place}: more than {LARGEST_JSON / 1e6:.0f} MB of JSON")
    if content.count(b"[") + content.count(b"{") > MOST_LISTS:
        raise InputError(f"{place}: more than {MOST_LISTS} lists and objects; save a part by itself")
    try:
        return json.loads(content.decode("utf-8"), parse_constant=refuse)
    except UnicodeDecodeError as error:
        raise InputError(f"{place}: not UTF-8 text ({error})") from error
    except RecursionError as error:
        raise InputError(f"{place}: nested too deep for any result") from error
    except json.JSONDecodeError as error:
        raise InputError(f"{place}, line {error.lineno}: not valid JSON ({error.msg})") from error
    except ValueError as error:  # a number of more digits than Python reads
        raise InputError(f"{place}: not valid JSON ({error})") from error
