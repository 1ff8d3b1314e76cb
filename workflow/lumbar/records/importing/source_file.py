"""A foreign file as a raw table: its kind follows from its first bytes, not from its name.

Text of any dialect and sheets of workbooks are columns of numbers, with names, units and the sampling rate from the lines
around them; `lumbar.records.importing.variables` reads MATLAB and HDF5 files.
"""

import hashlib
import io
import re
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.child_process import read_in_child
from lumbar.records.importing.dialect import (
    CLOCK,
    FEWEST_ROWS,
    MISSING,
    TableDialect,
    find_blocks,
    find_dialect,
)
from lumbar.records.importing.raw_table import (
    RawColumn,
    RawTable,
    ReadOptions,
    StatedRate,
    find_unit,
    name_and_unit,
)
from lumbar.records.importing.recording import record_name
from lumbar.records.number_table import (
    NumberTable,
    decode_lines,
    read_numbers,
    read_plain_numbers,
    split_rows,
)
from lumbar.records.unpacking import MOST_NUMBERS, check_zip, ending_of, stem_of, unpack

_HDF5 = b"\x89HDF\r\n\x1a\n"
_OLD_EXCEL = b"\xd0\xcf\x11\xe0"
_GZIP = b"\x1f\x8b"

_MAX_LABEL_CHARACTERS = 1000
"""Beginning of a line that may state a rate."""
_MAX_HEADER_LINES = 4
"""Lines above a table that may hold names and units."""
_DAY_S = 86400.0
_MAX_WORDS = 1000
"""Different words of a column that are distinguished."""
_COMMENT = re.compile(r"^\s*[#%!;]+\s*")


def file_name(path: Path) -> str:
    """Return the name of a file's record: the file's name without endings, with ``_`` for signs that no name may hold."""
    return record_name(stem_of(path))


def read_content(stored: bytes, path: Path, asked: ReadOptions) -> tuple[RawTable, str]:
    """Read the table of a file from its content. Return it, and the SHA-256 of the file.

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
    return _read_table(content, path, asked), hashlib.sha256(stored).hexdigest()


def _read_table(content: bytes, path: Path, asked: ReadOptions) -> RawTable:
    source, kind = str(path), ending_of(path)
    if content.startswith(_HDF5) or content[512:520] == _HDF5:  # MATLAB 7.3 puts 512 bytes before
        _require_package("h5py", "an HDF5 file (MATLAB 7.3 writes them too)", path)
        from lumbar.records.importing.variables import read_hdf5

        return read_hdf5(content, source, asked)
    if content.startswith(b"MATLAB 5.0 MAT-file") or kind == ".mat":
        from lumbar.records.importing.variables import read_matlab

        return read_matlab(content, source, asked)
    if content.startswith(b"PK\x03\x04"):
        _require_package("openpyxl", "an Excel workbook", path)
        return _read_workbook(content, source, asked)
    if content.startswith(_OLD_EXCEL):
        raise InputError(f"{path}: an Excel file of before 2007; save it as .xlsx or .csv")
    if kind in (".c3d", ".trc", ".bvh"):
        raise InputError(f"{path}: a file of markers, which needs no import: lumbar lift reads it")
    lines, encoding = decode_lines(content, source, asked.encoding)
    return _table_of_lines(lines, source, encoding, asked.table)


def _require_package(package: str, kind: str, path: Path) -> None:
    if find_spec(package) is None:
        raise InputError(f"{path}: {kind} needs the package {package}: pip install 'lumbar[import]'")


def _read_workbook(content: bytes, source: str, asked: ReadOptions) -> RawTable:
    """Read one sheet; raise if several sheets hold something and none is chosen."""
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
    return _table_of_lines(filled[title], source, f"sheet {title!r}")


def _sheets(source: str, content: bytes) -> dict[str, list[str]]:
    """Return the lines of every sheet, cells separated by tabs, by its title."""
    import openpyxl

    check_zip(content, source)
    sheets: dict[str, list[str]] = {}
    left = MOST_NUMBERS  # one cell far away stands for all the empty ones before it
    try:
        for sheet in openpyxl.load_workbook(io.BytesIO(content), read_only=True, data_only=True):
            lines = sheets[sheet.title] = []
            for row in sheet.iter_rows(values_only=True):
                left -= max(len(row), 1)
                if left < 0:
                    raise InputError(
                        f"{source}: more than {MOST_NUMBERS} cells; save the recording by itself"
                    )
                lines.append("\t".join("" if cell is None else str(cell).replace("\t", " ") for cell in row))
    except InputError:
        raise
    except Exception as error:  # a zip that is no workbook, or a broken one, leads to errors of many kinds
        raise InputError(f"{source}: not an Excel workbook that can be read ({error})") from error
    return sheets


def _table_of_lines(lines: list[str], source: str, encoding: str, table: str | None = None) -> RawTable:
    """Return the table in lines of text; of several tables, the one with this number (from 1)."""
    dialect = find_dialect(lines)
    plain = _plain_rows(lines, dialect) if dialect else None
    if plain is not None:
        blocks = runs = [(plain.lines[0] - 1, plain.lines[-1] - 1)]
    else:
        runs = find_blocks(lines, dialect) if dialect else []
        blocks = [(first, last) for first, last in runs if last - first + 1 >= FEWEST_ROWS]
    if dialect is None or not blocks:
        raise InputError(
            f"{source}: no table of numbers in these {len(lines)} lines ({encoding}); at least {FEWEST_ROWS} rows with two "
            "numbers or more are needed"
        )
    first, last = _choose_block(blocks, table, source)
    before = [stop for _, stop in blocks if stop < first]
    above = lines[before[-1] + 1 if before else 0 : first]
    names, units = _header(above, dialect)
    remarks = [] if any(names) else _remarks_on_names(above, lines[first], dialect, source)
    remarks += _remarks_on_other_rows(lines, last, runs, dialect)
    # Columns of numbers and of times of day.
    cells = dialect.split(lines[first])
    labels = {
        column: f"column {column + 1}{f' {name!r}' if name else ''}" for column, name in enumerate(names)
    }
    positions = {
        labels[column]: column for column in range(dialect.width) if column not in dialect.text_columns
    }
    numbers = plain or read_numbers(
        split_rows(lines[first : last + 1], dialect, source, first + 1),
        positions,
        source,
        dialect,
        dialect.width,
    )
    columns = []
    for column, values in zip(positions.values(), numbers.values.T, strict=True):
        is_clock = bool(CLOCK.match(cells[column]))
        if is_clock:  # seconds since the first one; a day that ends between two of them is counted on
            midnights = np.concatenate([[0], np.cumsum(np.diff(values) < -_DAY_S / 2)])
            values = values - values[0] + _DAY_S * midnights
        columns.append(RawColumn(column + 1, names[column], "s" if is_clock else units[column], values))
    # Columns of words, which may name trials.
    words = []
    for column in sorted(dialect.text_columns):
        remarks.append(f"column {column + 1} is no number ({cells[column]!r})")
        words.append(
            _column_of_words(
                column, names[column], [dialect.split(lines[n - 1])[column] for n in numbers.lines]
            )
        )
    form = "; ".join([f"{encoding}, {dialect}, lines {first + 1} to {last + 1}", *remarks])
    rates = tuple(_stated_rates(lines[:first]))
    return RawTable(source, form, tuple(columns), numbers.lines, rates, tuple(words))


def _plain_rows(lines: list[str], dialect: TableDialect) -> NumberTable | None:
    """Return the table of a text that is nothing but lines above it and rows of numbers to its end."""
    last = next((n for n in range(len(lines), 0, -1) if lines[n - 1].strip()), 0)
    first = next((n for n in range(last) if dialect.is_row(lines[n])), last)
    if last - first < FEWEST_ROWS or dialect.text_columns or dialect.decimal == dialect.delimiter:
        return None
    return read_plain_numbers(lines[first:last], dialect, dialect.width, first + 1)


def _column_of_words(column: int, name: str, cells: Sequence[str]) -> RawColumn:
    """Return a column of words, numbered; NaN if a cell is empty, or if there are too many different words."""
    number = {word: at for at, word in enumerate(dict.fromkeys(cells)) if at < _MAX_WORDS}
    values = [np.nan if cell.casefold() in MISSING else number.get(cell, np.nan) for cell in cells]
    return RawColumn(column + 1, name, "", np.array(values, dtype=float), "", tuple(number))


def _choose_block(blocks: list[tuple[int, int]], table: str | None, source: str) -> tuple[int, int]:
    """Return first and last line (from 0) of the only table, or of the one with this number."""
    found = ", ".join(f"{number}: lines {a + 1} to {b + 1}" for number, (a, b) in enumerate(blocks, start=1))
    if table is None:
        if len(blocks) > 1:
            raise InputError(
                f"{source}: {len(blocks)} tables of numbers ({found}); choose one, e.g. --table 1"
            )
        return blocks[0]
    if not table.isdigit() or not 1 <= int(table) <= len(blocks):
        raise InputError(f"{source}: no table {table!r}; there are {found}")
    return blocks[int(table) - 1]


def _remarks_on_other_rows(
    lines: list[str], last: int, runs: list[tuple[int, int]], dialect: TableDialect
) -> list[str]:
    """Return sentences on rows that are in no table: too few rows, and an incomplete row at the end."""
    remarks = [
        f"lines {a + 1} to {b + 1} are too few rows for a table" for a, b in runs if b - a + 1 < FEWEST_ROWS
    ]
    if last + 1 < len(lines) and dialect.is_torn_row(lines[last + 1]):
        remarks.append(f"line {last + 2} is no whole row ({lines[last + 1].strip()[:60]!r})")
    return remarks


def _header(above: list[str], dialect: TableDialect) -> tuple[list[str], list[str]]:
    """Return names and units of the columns from the rows above the table; empty if they are not stated."""
    near = _join_quoted([line for line in above if line.strip()])[-_MAX_HEADER_LINES:]
    rows = [cells for line in near if (cells := _header_cells(line, dialect))]
    names, units = [""] * dialect.width, [""] * dialect.width
    # Units for the last columns from a line such as ``Y_Unit_Label<tab>mm<tab>N``.
    for line in reversed(above):
        label, *cells = [cell for cell in dialect.split(line) if cell] or [""]
        if "unit" in label.casefold() and 0 < len(cells) <= dialect.width and _is_unit_row(cells):
            units = [""] * (dialect.width - len(cells)) + cells
    unit_row = next((cells for cells in reversed(rows[-2:]) if _is_unit_row(cells)), None)
    if unit_row:
        units = [cell.strip("[](){}<> ") for cell in unit_row]
    name_row = next((cells for cells in reversed(rows) if cells is not unit_row), None)
    if name_row:
        parted = [name_and_unit(cell) for cell in name_row]
        names = [name for name, _ in parted]
        units = [unit or stated for (_, unit), stated in zip(parted, units, strict=True)]
    return names, units


def _join_quoted(lines: list[str]) -> list[str]:
    """Join lines that a cell in quotes spans."""
    whole: list[str] = []
    for line in lines:
        if whole and whole[-1].count('"') % 2:
            whole[-1] += f" {line}"
        else:
            whole.append(line)
    return whole


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
            f"{source}: {len(names)} names, but rows of {dialect.width} cells such as {row!r}: commas part both columns and "
            "decimals; write the file with another delimiter"
        )
    return [f"no names: above the table stands {line.strip()[:60]!r}"] if names else []


def _header_cells(line: str, dialect: TableDialect) -> list[str] | None:
    """Return the cells of a header row, one per column; None if the line is no header.

    If blanks separate the columns, a name may hold a blank before its unit, or between words if two blanks separate names.
    """
    line = _COMMENT.sub("", line)
    ways = [dialect.split(line)]
    if dialect.delimiter is None:
        ways += [
            re.split(r"\s{2,}|\t", line.strip()),
            re.findall(r"[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?", line),
        ]
        ways += [re.findall(r"[\[(][^\])]*[\])]|\S+", line)]
    for cells in ways:
        cells = [cell.strip().strip('"') for cell in cells]
        surplus = cells[dialect.width :]
        # A header may name a column of comments, or end in delimiters, which the rows leave out.
        if (
            len(cells) >= dialect.width
            and all(not cell or cell.casefold().startswith("comment") for cell in surplus)
            and sum(bool(cell) for cell in cells) >= min(2, dialect.width)
        ):
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
_SAYS_RATE = re.compile(r"rate|fre[qc]|fr[ée]q|\bfs\b", re.IGNORECASE)
"""Label of a rate in hertz without a unit, as opposed to a number of samples."""
_INTERVAL = re.compile(
    r"sampl\w*[\s_-]*(?:interval|period|time)|abtastintervall|abtastzeit|delta_?x|\bdt\b", re.IGNORECASE
)
_VALUE = re.compile(r"([+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)\s*\"?[\t;,]?\"?\s*([a-zA-Zµ]+(?:/s(?:ec)?)?)?")
_HERTZ = {"hz": 1.0, "khz": 1e3, "s/s": 1.0, "sps": 1.0, "samples/s": 1.0, "samples/sec": 1.0}
_PERIODS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}


def _stated_rates(above: list[str]) -> list[StatedRate]:
    """Sampling rates and intervals that the lines above the table state."""
    found = []
    for number, line in enumerate(above, start=1):
        line = line[:_MAX_LABEL_CHARACTERS]
        interval, rate = _INTERVAL.search(line), _RATE.search(line)
        label = interval or rate
        if label is None:
            continue
        value = _VALUE.search(line, label.end())
        if not value or value.start() - label.end() > 25:
            continue
        size, unit = float(value[1].replace(",", ".")), (value[2] or "").casefold()
        if size <= 0:
            continue
        if interval and (unit in _PERIODS or not unit or unit not in _HERTZ):
            found.append(StatedRate(1.0 / (size * _PERIODS.get(unit, 1.0)), f"line {number}"))
        elif unit in _HERTZ or (not unit and _SAYS_RATE.search(label[0])):
            found.append(StatedRate(size * _HERTZ.get(unit, 1.0), f"line {number}"))
    return found
