"""Reader of a foreign file as a raw table. The kind of file follows from its first bytes, not from its name.

Texts of any dialect and sheets of workbooks are columns of numbers, with names, units and the sampling rate from the lines
above them; `lumbar.records.importing.variables` reads MATLAB and HDF5 files.
"""

import hashlib
import io
import itertools
import re
import zipfile
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.files import MAX_FILE_BYTES
from lumbar.records.child_process import read_in_child
from lumbar.records.importing.dialect import (
    MAX_HEADER_LINES,
    MIN_ROWS,
    MISSING,
    Block,
    TableDialect,
    find_blocks,
    find_dialects,
)
from lumbar.records.importing.raw_table import (
    RawColumn,
    RawTable,
    StatedRate,
    find_unit,
    split_name_and_unit,
)
from lumbar.records.importing.roles import Choices
from lumbar.records.importing.variables import read_variables
from lumbar.records.number_table import (
    Dialect,
    NumberTable,
    decode_lines,
    read_format_numbers,
    read_numbers,
    split_rows,
)
from lumbar.records.unpacking import check_size, ending_of, report_broken, unpack

_HDF5 = b"\x89HDF\r\n\x1a\n"
_OLD_EXCEL = b"\xd0\xcf\x11\xe0"
_OPEN_DOCUMENT = b"mimetypeapplication/vnd.oasis.opendocument"
"""Bytes after the first 30 of a file of LibreOffice."""
_GZIP = b"\x1f\x8b"

MAX_CELLS = MAX_FILE_BYTES // 8
"""Largest number of cells of a workbook, with the empty cells before the last used cell."""
_MAX_LABEL_CHARACTERS = 1000
"""Number of first characters of a line that are searched for a rate."""
_DAY_S = 86400.0
_MAX_LABELS = 1000
"""Largest number of distinct texts of a text column."""
_COMMENT = re.compile(r"^\s*[#%!;]+\s*")
_MAX_LISTED = 3
"""Largest number of lines or cells that a note lists."""


def read_content(stored: bytes, path: Path, choices: Choices) -> tuple[RawTable, str]:
    """Read the table of a file from its content.

    Parameters
    ----------
    stored : bytes
        Text, MATLAB, HDF5 or Excel; also gzipped.
    path : Path
        The file, for messages and its ending.
    choices : Choices
        The user's options, with the part of the file and its encoding.

    Returns
    -------
    RawTable
        The table.
    str
        SHA-256 of the file.

    Raises
    ------
    InputError
        If the file has no table, or the package that reads it is not installed.
    """
    content, source, ending = stored, str(path), ending_of(path)
    if stored.startswith(_GZIP):
        unpack(stored, path, file := io.BytesIO())
        content = file.getvalue()
    if content.startswith(_HDF5) or content[512:520] == _HDF5:  # MATLAB 7.3 puts 512 bytes before
        _require_package("h5py", "an HDF5 file (MATLAB 7.3 writes them too)", path)
        table = read_variables(content, source, "HDF5", choices)
    elif content.startswith(b"MATLAB 5.0 MAT-file") or ending == ".mat":
        table = read_variables(content, source, "MATLAB", choices)
    elif content[30:].startswith(_OPEN_DOCUMENT):
        raise InputError(f"{path}: an OpenDocument file; save it as .xlsx or .csv")
    elif content.startswith(b"PK\x03\x04"):
        _require_package("openpyxl", "an Excel workbook", path)
        table = _read_workbook(content, source, choices)
    elif content.startswith(_OLD_EXCEL):
        raise InputError(f"{path}: an Excel file of before 2007; save it as .xlsx or .csv")
    elif ending in (".c3d", ".trc", ".bvh"):
        raise InputError(f"{path}: a file of markers, which needs no import: lumbar lift reads it")
    else:
        lines, encoding = decode_lines(content, source, choices.encoding)
        table = _read_lines(lines, source, encoding, choices.table)
    return table, hashlib.sha256(stored).hexdigest()


def _require_package(package: str, kind: str, path: Path) -> None:
    if find_spec(package) is None:
        raise InputError(f"{path}: {kind} needs the package {package}: pip install 'lumbar[import]'")


def _read_workbook(content: bytes, source: str, choices: Choices) -> RawTable:
    """Read one sheet; raise if several sheets have a table and none is chosen.

    ``choices.table`` is the title of a sheet, the number of a table in the only sheet, or both: ``"Trial:2"``.
    """
    sheets: dict[str, list[str]] = read_in_child(_read_sheets, source, content)
    filled = {title: lines for title, lines in sheets.items() if any(line.strip() for line in lines)}
    if not filled:
        raise InputError(f"{source}: the sheets are empty")
    tables = [title for title, lines in filled.items() if find_dialects(lines, is_sheet=True)]
    choice = choices.table
    title, number = choice, None
    if choice not in filled and choice is not None:  # no title contains a colon
        title, _, number = choice.rpartition(":")
    if not title and len(tables) > 1:
        raise InputError(
            f"{source}: {len(tables)} sheets have tables: {', '.join(tables)}; choose by --sheet NAME"
        )
    title = title or (tables or [*filled])[0]
    if title not in filled:
        raise InputError(f"{source}: no sheet {title!r}; there are {', '.join(filled)}")
    return _read_lines(filled[title], source, f"sheet {title!r}", number, title)


def _read_sheets(source: str, content: bytes) -> dict[str, list[str]]:
    """Return the lines of every sheet by its title; tabs separate the cells, and all lines have the same number of them."""
    import openpyxl

    sheets: dict[str, list[str]] = {}
    left = MAX_CELLS
    with report_broken(f"{source}: not an Excel workbook that can be read"):
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            check_size(sum(item.file_size for item in archive.infolist()), len(content), source)
        for sheet in openpyxl.load_workbook(io.BytesIO(content), read_only=True, data_only=True):
            lines: list[str] = []
            width = 0
            for row in sheet.iter_rows(values_only=True):
                left -= max(len(row), 1)
                if left < 0:
                    raise InputError(f"{source}: more than {MAX_CELLS} cells; save the recording by itself")
                # No cell contains a tab, a line break or a quote.
                cells = [
                    "" if cell is None else " ".join(str(cell).split()).replace('"', "''") for cell in row
                ]
                lines.append("\t".join(cells))
                width = max(width, len(cells))
            sheets[sheet.title] = [line + "\t" * (width - 1 - line.count("\t")) for line in lines]
    return sheets


def _read_lines(
    lines: list[str], source: str, encoding: str, table: str | None = None, sheet: str = ""
) -> RawTable:
    """Return the table in lines of text, or of the rows of a sheet; `table` is its number (from 1) if there are several."""
    dialects = find_dialects(lines, bool(sheet))
    plain = _read_plain_table(lines, dialects[0]) if len(dialects) == 1 else None
    if plain is None:
        runs = [(dialect, block) for dialect in dialects for block in find_blocks(lines, dialect)]
    else:
        runs = [(dialects[0], Block(plain.lines[0] - 1, plain.lines[-1] - 1))]
    tables = [(dialect, block) for dialect, block in runs if block.last - block.first + 1 >= MIN_ROWS]
    if not tables:
        raise InputError(
            f"{source}: no table of numbers in these {len(lines)} lines ({encoding}); at least {MIN_ROWS} rows with two "
            "numbers or more are needed"
        )
    listed = ", ".join(
        _describe_table(*item, number, len(dialects)) for number, item in enumerate(tables, start=1)
    )
    if table is None and len(tables) > 1:
        option = f"--sheet '{sheet}:1'" if sheet else "--table 1"
        raise InputError(f"{source}: {len(tables)} tables of numbers ({listed}); choose one, e.g. {option}")
    if table is not None and (not table.isdigit() or not 1 <= int(table) <= len(tables)):
        raise InputError(f"{source}: no table {table!r}; there are {listed}")
    dialect, block = tables[int(table or 1) - 1]
    first, last, comments = block
    before = [other.last for _, other in tables if other.last < first]
    above = lines[before[-1] + 1 if before else 0 : first]
    names, units = _read_header(above, dialect)
    remarks = [] if any(names) else _remarks_on_names(above, lines[first], dialect, source)
    notes = _notes_on_rows(lines, runs, dialect, block)
    if plain is None and len(dialects) == 1 and dialect.delimiter is not None:
        notes += _notes_on_cells(lines, dialect, block)
    # Columns of numbers and of times of day.
    cells = dialect.split(lines[first])
    positions = {
        f"column {dialect.left + column + 1}{f' {name!r}' if name else ''}": column
        for column, name in enumerate(names)
        if column not in dialect.text_columns
    }
    skipped = frozenset(comments)
    rows = (
        row
        for row in split_rows(lines[first : last + 1], dialect, source, first + 1)
        if row.line - 1 not in skipped and any(row.cells)
    )
    numbers = plain or read_numbers(rows, positions, source, dialect, dialect.width)
    columns = []
    for column, values in zip(positions.values(), numbers.values.T, strict=True):
        is_clock = column in dialect.clock_columns
        if is_clock:  # seconds since the first one, across midnight
            midnights = np.concatenate([[0], np.cumsum(np.diff(values) < -_DAY_S / 2)])
            values = values - values[0] + _DAY_S * midnights
        unit = "s" if is_clock else units[column]
        columns.append(RawColumn(dialect.left + column + 1, names[column], unit, values))
    # Columns of text, which may name trials.
    texts = []
    for column in sorted(dialect.text_columns):
        remarks.append(f"column {dialect.left + column + 1} is not a number ({cells[column]!r})")
        labels = [dialect.split(lines[line - 1])[column] for line in numbers.lines]
        number = {label: index for index, label in enumerate([*dict.fromkeys(labels)][:_MAX_LABELS])}
        values = np.array([number.get(label, np.nan) for label in labels], dtype=float)
        values[[label.casefold() in MISSING for label in labels]] = np.nan
        texts.append(RawColumn(dialect.left + column + 1, names[column], "", values, "", tuple(number)))
    form = "; ".join([f"{encoding}, {dialect}, lines {first + 1} to {last + 1}", *remarks])
    rates = tuple(_stated_rates(lines[:first]))
    return RawTable(source, form, tuple(columns), numbers.lines, rates, tuple(texts), tuple(notes))


def _read_plain_table(lines: list[str], dialect: TableDialect) -> NumberTable | None:
    """Return the numbers of a text that has only rows of numbers from its first row to its end; None for another text."""
    if dialect.left:
        return None
    last = next((n for n in range(len(lines), 0, -1) if lines[n - 1].strip()), 0)
    first = next((n for n in range(last) if dialect.is_row(lines[n])), last)
    if last - first < MIN_ROWS:
        return None
    readers = dict.fromkeys(dialect.clock_columns, dialect.read_clocks)
    readers |= dict.fromkeys(dialect.text_columns, lambda cells: np.full(len(cells), np.nan))
    table = read_format_numbers(lines[first:last], dialect, dialect.width, first + 1, readers)
    numeric = [column for column in range(dialect.width) if column not in dialect.text_columns]
    return table and replace(table, values=table.values[:, numeric])


def _describe_table(dialect: TableDialect, block: Block, number: int, tables_abreast: int) -> str:
    """Return number, lines and, of tables side by side, columns of a table."""
    columns = f", columns {dialect.left + 1} to {dialect.left + dialect.width}" if tables_abreast > 1 else ""
    return f"{number}: lines {block.first + 1} to {block.last + 1}{columns}"


def _notes_on_rows(
    lines: list[str], runs: list[tuple[TableDialect, Block]], dialect: TableDialect, block: Block
) -> list[str]:
    """Return notes on rows that are in no table, and on comments."""
    notes = [
        f"rows left out, too few for a table: {other.last - other.first + 1} from line {other.first + 1}"
        for dialect_, other in runs
        if other.last - other.first + 1 < MIN_ROWS
        and dialect_ is dialect
        and not dialect.cells_outside(lines[other.first])  # a label of settings
    ]
    filled = [
        n for n in range(len(lines)) if not block.first <= n <= block.last and any(dialect.split(lines[n]))
    ]
    below = itertools.takewhile(
        lambda n: dialect.is_faulty_row(lines[n]), (n for n in filled if n > block.last)
    )
    # Only rows with too many cells are no header.
    above = itertools.takewhile(
        lambda n: dialect.is_faulty_row(lines[n]) and len(dialect.split(lines[n])) > dialect.width,
        reversed([n for n in filled if n < block.first]),
    )
    if faulty := sorted([*above, *below]):
        shown = " ".join(filter(None, dialect.split(lines[faulty[0]])))[:60]
        notes.append(
            f"rows left out, not whole: {len(faulty)}, the first in line {faulty[0] + 1} ({shown!r})"
        )
    if block.comments:
        shown = " ".join(filter(None, dialect.split(lines[block.comments[0]])))[:60]
        notes.append(
            f"comments between rows: {len(block.comments)}, the first in line {block.comments[0] + 1} ({shown!r})"
        )
    return notes


def _notes_on_cells(lines: list[str], dialect: TableDialect, block: Block) -> list[str]:
    """Return a note on the cells of rows that are outside the only table."""
    inside = range(block.first, block.last + 1)
    outside = [(line, *cell) for line in inside for cell in dialect.cells_outside(lines[line])]
    listed = [
        f"line {line + 1}, column {number}: {cell[:30]!r}" for line, number, cell in outside[:_MAX_LISTED]
    ]
    more = ", …" if len(outside) > _MAX_LISTED else ""
    return [f"cells left out, outside the table: {'; '.join(listed)}{more}"] if outside else []


def _read_header(above: list[str], dialect: TableDialect) -> tuple[list[str], list[str]]:
    """Return names and units of the columns from the lines above the table; empty if they are not stated."""
    near: list[str] = []
    for line in filter(str.strip, above):
        if near and near[-1].count('"') % 2:  # a cell in quotes spans lines
            near[-1] += f" {line}"
        else:
            near.append(line)
    rows = [cells for line in near[-MAX_HEADER_LINES:] if (cells := _header_cells(line, dialect))]
    names, units = [""] * dialect.width, [""] * dialect.width
    # Units for the last columns from a line such as ``Y_Unit_Label<tab>mm<tab>N``.
    for line in reversed(above):
        label, *cells = [cell for cell in Dialect.split(dialect, line) if cell] or [""]
        if "unit" in label.casefold() and 0 < len(cells) <= dialect.width and _is_unit_row(cells):
            units = [""] * (dialect.width - len(cells)) + cells
    unit_row = next((cells for cells in reversed(rows[-2:]) if _is_unit_row(cells)), None)
    if unit_row:
        units = [cell.strip("[](){}<> ") for cell in unit_row]
    name_rows = [cells for cells in reversed(rows) if cells is not unit_row]
    if name_rows:
        # A merged cell has its name in a row above.
        merged = [next(filter(None, cells), "") for cells in zip(*name_rows, strict=True)]
        pairs = [split_name_and_unit(cell) for cell in merged]
        names = [name for name, _ in pairs]
        units = [unit or stated for (_, unit), stated in zip(pairs, units, strict=True)]
    return names, units


def _remarks_on_names(above: list[str], row: str, dialect: TableDialect, source: str) -> list[str]:
    """Return a remark on the line in which names were expected.

    Raises
    ------
    InputError
        If there are half as many names as cells in a row: commas are delimiters and decimal signs.
    """
    line = next((line for line in reversed(above) if line.strip()), "")
    names = [cell for cell in dialect.split(line) if cell] if line else []
    if dialect.delimiter == "," and "." not in row and 2 * len(names) == dialect.width:
        raise InputError(
            f"{source}: {len(names)} names, but rows of {dialect.width} cells such as {row!r}: commas are delimiters and "
            "decimal signs; write the file with another delimiter"
        )
    return [f"no names: the line above the table is {line.strip()[:60]!r}"] if names else []


def _header_cells(line: str, dialect: TableDialect) -> list[str] | None:
    """Return the cells of a header row, one per column; None if it is not a header.

    If blanks separate the columns, a name may contain a blank before its unit, or between words if two blanks separate
    names.
    """
    if dialect.delimiter != ";":  # or empty columns are first
        line = _COMMENT.sub("", line)
    splits = [dialect.split(line)]
    if dialect.delimiter is None:
        splits.append(re.split(r"\s{2,}|\t", line.strip()))
        splits.append(re.findall(r"[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?", line))
        splits.append(re.findall(r"[\[(][^\])]*[\])]|\S+", line))
    for cells in splits:
        cells = [cell.strip().strip('"') for cell in cells]
        # A header may name a column of comments, or end in delimiters, which the rows omit.
        surplus = [cell for cell in cells[dialect.width :] if cell]
        is_wide = len(cells) >= dialect.width and sum(map(bool, cells)) >= min(2, dialect.width)
        if is_wide and all(cell.casefold().startswith("comment") for cell in surplus):
            return cells[: dialect.width]
    return None


def _is_unit_row(cells: list[str]) -> bool:
    filled = [cell for cell in cells if cell]
    return bool(filled) and sum(find_unit(cell) is not None for cell in filled) > 0.5 * len(filled)


_RATE = re.compile(
    r"(?:sampl\w*|scan|acquisition|data|abtast|mess|[ée]chantillon\w*|muestreo|campionamento)[\s_-]*(?:d')?"
    r"(?:rate|freq\w*|frequenz)?\b|(?:rate|fr[ée]quence|frecuencia|frequenza) d\w*.{0,2}"
    r"(?:[ée]chantillonnage|muestreo|campionamento)|\bfs\b",
    re.IGNORECASE,
)
_RATE_LABEL = re.compile(r"rate|fre[qc]|fr[ée]q|\bfs\b", re.IGNORECASE)
"""Label of a rate, not of a number of samples; a rate without a unit is in hertz."""
_INTERVAL = re.compile(
    r"sampl\w*[\s_-]*(?:interval|period|time)|abtastintervall|abtastzeit|delta_?x|\bdt\b", re.IGNORECASE
)
_VALUE = re.compile(r"([+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)\s*\"?[\t;,]?\"?\s*([a-zA-Zµ]+(?:/s(?:ec)?)?)?")
_HERTZ_PER_UNIT = {"hz": 1.0, "khz": 1e3, "s/s": 1.0, "sps": 1.0, "samples/s": 1.0, "samples/sec": 1.0}
_SECONDS_PER_UNIT = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}


def _stated_rates(above: list[str]) -> list[StatedRate]:
    """Return the sampling rates and intervals that the lines above the table state."""
    rates = []
    for number, line in enumerate(above, start=1):
        line = line[:_MAX_LABEL_CHARACTERS]
        interval = _INTERVAL.search(line)
        label = interval or _RATE.search(line)
        value = _VALUE.search(line, label.end()) if label else None
        if not label or not value or value.start() - label.end() > 25:
            continue
        size, unit = float(value[1].replace(",", ".")), (value[2] or "").casefold()
        if size <= 0:
            continue
        if interval and unit not in _HERTZ_PER_UNIT:
            rates.append(StatedRate(1.0 / (size * _SECONDS_PER_UNIT.get(unit, 1.0)), f"line {number}"))
        elif unit in _HERTZ_PER_UNIT or (not unit and _RATE_LABEL.search(label[0])):
            rates.append(StatedRate(size * _HERTZ_PER_UNIT.get(unit, 1.0), f"line {number}"))
    return rates
