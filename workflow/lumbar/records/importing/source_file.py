"""A file of any kind as a raw table: what it is follows from its first bytes, not from its name."""

import hashlib
import io
from importlib.util import find_spec
from pathlib import Path

from lumbar.base.errors import InputError
from lumbar.records.child_process import read_in_child
from lumbar.records.importing.raw_table import Asked, RawTable
from lumbar.records.importing.recording import record_name
from lumbar.records.importing.text_table import read_text, table_of_lines
from lumbar.records.unpacking import MOST_NUMBERS, check_zip, ending_of, stem_of, unpack


def read_workbook(content: bytes, source: str, asked: Asked) -> RawTable:
    """Read one sheet.

    Raises
    ------
    InputError
        If several sheets hold something, or there is no table.
    """
    sheets: dict[str, list[str]] = read_in_child(_sheets, source, content)
    filled = {title: lines for title, lines in sheets.items() if any(line.strip() for line in lines)}
    if not filled:
        raise InputError(f"{source}: no sheet holds anything")
    if asked.table is None and len(filled) != 1:
        raise InputError(
            f"{source}: {len(filled)} sheets hold something: {', '.join(filled)}; choose by --sheet NAME"
        )
    title = asked.table if asked.table is not None else next(iter(filled))
    if title not in filled:
        raise InputError(f"{source}: no sheet {title!r}; there are {', '.join(filled)}")
    return table_of_lines(filled[title], source, f"sheet {title!r}")


def _sheets(source: str, content: bytes) -> dict[str, list[str]]:
    """Lines of every sheet, by title."""
    import openpyxl

    check_zip(content, source)
    try:
        return _lines(openpyxl.load_workbook(io.BytesIO(content), read_only=True, data_only=True), source)
    except InputError:
        raise
    except Exception as error:  # a zip that is no workbook, or a broken one, leads to errors of many kinds
        raise InputError(f"{source}: not an Excel workbook that can be read ({error})") from error


def _lines(book, source: str) -> dict[str, list[str]]:
    """Lines of every sheet; one cell far away stands for all the empty ones before it."""
    sheets: dict[str, list[str]] = {}
    left = MOST_NUMBERS
    for sheet in book:
        lines = sheets[sheet.title] = []
        for row in sheet.iter_rows(values_only=True):
            left -= max(len(row), 1)
            if left < 0:
                raise InputError(f"{source}: more than {MOST_NUMBERS} cells; save the recording by itself")
            lines.append("\t".join("" if cell is None else str(cell).replace("\t", " ") for cell in row))
    return sheets


_HDF5 = b"\x89HDF\r\n\x1a\n"
_OLD_EXCEL = b"\xd0\xcf\x11\xe0"
_GZIP = b"\x1f\x8b"


def read_content(stored: bytes, path: Path, asked: Asked) -> tuple[RawTable, str]:
    """Read what a file holds, wherever it lies: its table, and the SHA-256 of the file.

    Parameters
    ----------
    stored : bytes
        Text, MATLAB, HDF5 or Excel; also gzipped.
    path : Path
        For messages, and for the ending of its name.

    Raises
    ------
    InputError
        If there is no table in it, or no package that reads it.
    """
    content = stored
    if stored.startswith(_GZIP):
        unpack(stored, path, file := io.BytesIO())
        content = file.getvalue()
    return _reader(content, path)(content, str(path), asked), hashlib.sha256(stored).hexdigest()


def _reader(content: bytes, path: Path):
    """Find the reader of this content: called with content, source and what is asked."""
    kind = ending_of(path)
    if content.startswith(_HDF5) or content[512:520] == _HDF5:  # MATLAB 7.3 puts 512 bytes of its own before
        _require("h5py", "an HDF5 file (MATLAB 7.3 writes them too)", path)
        from lumbar.records.importing.variables import read_hdf5

        return read_hdf5
    if content.startswith(b"MATLAB 5.0 MAT-file") or kind == ".mat":
        from lumbar.records.importing.variables import read_matlab

        return read_matlab
    if content.startswith(b"PK\x03\x04"):
        _require("openpyxl", "an Excel workbook", path)
        return read_workbook
    if content.startswith(_OLD_EXCEL):
        raise InputError(f"{path}: an Excel file of before 2007; save it as .xlsx or .csv")
    if kind in (".c3d", ".trc", ".bvh"):
        raise InputError(f"{path}: a file of markers, which needs no import: lumbar lift reads it")
    return read_text


def _require(package: str, kind: str, path: Path) -> None:
    """Say what needs a package that is not there."""
    if find_spec(package) is None:
        raise InputError(f"{path}: {kind} needs the package {package}: pip install 'lumbar[import]'")


def file_name(path: Path) -> str:
    """Name of a file's record: the file's without endings, with ``_`` for what a name may not hold."""
    return record_name(stem_of(path))
