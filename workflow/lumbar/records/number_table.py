"""Reader of numbers under a header, for text tables and the cells of sheets.

Lines (`stream_lines`, `decode_lines`) are split into rows of cells by a dialect (`split_rows`), and the cells of columns are
converted to numbers (`read_numbers`). `read_format_numbers` does both for a table of numbers only, with pandas.
"""

import codecs
import csv
import io
import itertools
import re
from array import array
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lumbar.base.errors import MAX_PROBLEMS, InputError, Problems

ENCODINGS = "gbk (Chinese), shift_jis (Japanese), cp1251 (Cyrillic), cp1250 (Central Europe) or cp1252 (Western Europe)"
"""Examples of encodings, for messages."""
MAX_LINE_CHARACTERS = 1_000_000
MAX_PLAIN_COLUMNS = 1000
_PLAIN_MISSING = ("", "nan", "NaN", "NAN")
"""Cells without a number in a plain table."""
MAX_SHOWN_CHARACTERS = 60
"""Largest number of characters of a cell in a message."""


class Row(NamedTuple):
    """Cells of one row."""

    line: int
    """Number of the row's first line in the file, from 1."""
    cells: list[str]


@dataclass(frozen=True)
class Dialect:
    """Form of a table's rows."""

    delimiter: str | None = ","
    """Character between cells; None for any blanks."""
    decimal: str = "."
    comment: str | None = None
    """Beginning of lines that are skipped."""
    quotes_span_lines: bool = False
    """True if a cell in quotes may contain line breaks, as in answers of a survey; in tables of numbers this is an error."""

    def split(self, line: str) -> list[str]:
        """Return the cells of one line. Quotes protect delimiters.

        Parameters
        ----------
        line : str
            Line without its end.
        """
        if self.delimiter is None:
            return line.split()
        cells = line.split(self.delimiter)
        if '"' in line:
            with suppress(csv.Error):  # a cell of more than 131072 characters
                cells = next(csv.reader([line], **self.csv_options), [])
        return [cell.strip() for cell in cells]

    def number(self, cell: str) -> float:
        """Return the number in a cell.

        Parameters
        ----------
        cell : str
            Text of the cell.

        Raises
        ------
        ValueError
            The text is not a number.
        """
        return parse_number(cell if self.decimal == "." else cell.replace(self.decimal, "."))

    @property
    def csv_options(self) -> dict[str, Any]:
        """Options of `csv.reader`."""
        return {"delimiter": self.delimiter, "skipinitialspace": self.delimiter != " "}


@dataclass(frozen=True)
class NumberTable:
    """Numeric rows of a file, with the line of each row."""

    values: np.ndarray
    """Numbers in the cells, shape (rows, columns)."""
    lines: Sequence[int]
    """Line of each row in the file, from 1."""


def parse_number(text: str) -> float:
    """Return the number in a text, also with Fortran's exponents.

    Unlike Python's ``float``, reject ``1_000`` and the digits of other scripts, which are mistakes in a file.

    Parameters
    ----------
    text : str
        Number with a decimal point.

    Raises
    ------
    ValueError
        The text is not a number.

    Examples
    --------
    >>> parse_number("-1.5e3"), parse_number("2.5D-01")
    (-1500.0, 0.25)
    >>> parse_number("1_000")
    Traceback (most recent call last):
        ...
    ValueError: could not convert string to float: '1_000'
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"could not convert string to float: {text!r}")
    try:
        return float(text)
    except ValueError:
        return float(re.sub("(?<=[0-9.])[dD](?=[-+0-9])", "e", text))


def stream_lines(path: Path) -> Iterator[str]:
    """Yield the lines of a file of UTF-8 text, with a byte-order mark or without.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    InputError
        If the text is not UTF-8, or a line has more than `MAX_LINE_CHARACTERS`.
    """
    with path.open(encoding="utf-8-sig") as stream:
        try:
            for number in itertools.count(1):
                line = stream.readline(MAX_LINE_CHARACTERS + 1)
                if len(line) > MAX_LINE_CHARACTERS:
                    raise InputError(
                        f"{path}: line {number} has more than {MAX_LINE_CHARACTERS} characters; rows of numbers are needed"
                    )
                if not line:
                    return
                yield line
        except UnicodeDecodeError as error:
            raise InputError(f"{path}: not UTF-8 text ({error}); save it as UTF-8") from error


def decode_lines(
    content: bytes, source: str, encoding: str | None = None, lenient: bool = False
) -> tuple[list[str], str]:
    """Return the lines of a text, split as in an editor, and its encoding.

    Parameters
    ----------
    content : bytes
        The text.
    source : str
        The file, for messages.
    encoding : str, optional
        Encoding by Python's name. Default: UTF-16, UTF-8 or Windows-1252, detected from the bytes.
    lenient : bool
        Whether bytes that are not western text are also read as Windows-1252.

    Raises
    ------
    InputError
        If a line cannot be decoded, with the first such line.
    """
    if encoding:
        try:
            text = content.decode(encoding).removeprefix("\ufeff")
        except UnicodeDecodeError as error:
            line = len(_split_lines(content[: error.start].decode(encoding, "ignore")))
            shown = ascii(content[error.start : error.start + 20])[1:]
            raise InputError(
                f"{source}: line {line} cannot be read by --encoding {encoding} ({shown})"
            ) from error
    else:
        text, encoding = _detect_encoding(content)
        if encoding == "Windows-1252" and not lenient:
            _check_western(text, content, source)
    return _split_lines(text.replace("\N{MINUS SIGN}", "-")), encoding


def _split_lines(text: str) -> list[str]:
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _detect_encoding(content: bytes) -> tuple[str, str]:
    """Return the text and its encoding."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", errors="replace"), "UTF-16"
    # In UTF-16 without a mark, every second byte of western text is zero.
    beginning = content[:2000]
    for encoding, first in (("utf-16-le", 1), ("utf-16-be", 0)):
        if len(beginning) > 8 and beginning[first::2].count(0) > 0.4 * len(beginning):
            return content.decode(encoding, errors="replace"), encoding.upper()
    try:
        return content.decode("utf-8-sig"), "UTF-8"
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace"), "Windows-1252"


_WESTERN = re.compile(r"[À-ÖØ-öø-ÿŒœŸ°±²³µ·×§®©€‘’“”–—…]|[äöüÄÖÜ]ß|éé|ç[ãõ]")
"""Runs of characters beyond ASCII in western words; words of other alphabets have longer or other runs."""


def _check_western(text: str, content: bytes, source: str) -> None:
    """Raise unless all characters beyond ASCII occur in western words in Windows-1252."""
    for run in re.finditer(r"[^\x00-\x7f]+", text):
        before, after = text[: run.start()][-1:], text[run.end() :][:1]
        if _WESTERN.fullmatch(run[0]) and not (run[0] in "°²³" and before.isalpha() and after.isalpha()):
            continue
        lines = _split_lines(text[: run.start()])
        start = run.start() - len(lines[-1])
        line = re.split(rb"[\r\n]", content[start : start + 60])[0]
        raise InputError(
            f"{source}: line {len(lines)} is not UTF-8 ({ascii(line)[1:]}); give its encoding, as in --encoding {ENCODINGS}"
        )


def split_rows(lines: Iterable[str], dialect: Dialect, source: str, first: int = 1) -> Iterator[Row]:
    """Yield the rows of a table without blank lines and comments.

    Parameters
    ----------
    lines : iterable of str
        Lines of the file.
    dialect : Dialect
        Form of the rows.
    source : str
        The file, for messages.
    first : int
        Number of the first line in the file, from 1.

    Raises
    ------
    InputError
        If a cell that spans lines has more than 131072 characters.
    """
    number, begins = first - 1, 0

    def counted() -> Iterator[str]:
        nonlocal number, begins
        for line in lines:
            number += 1
            text = line.strip()
            if text and not (dialect.comment and text.startswith(dialect.comment)):
                begins = begins or number
                yield line

    if not dialect.quotes_span_lines:
        yield from (Row(number, dialect.split(line)) for line in counted())
        return
    try:
        for cells in csv.reader(counted(), **dialect.csv_options):
            yield Row(begins, [cell.strip() for cell in cells])
            begins = 0
    except csv.Error as error:
        raise InputError(f"{source}: line {begins}: not a row of a table ({error})") from error


def read_numbers(
    rows: Iterable[Row],
    columns: Mapping[str, int],
    source: str,
    dialect: Dialect,
    width: int | None = None,
    may_be_empty: Collection[str] = (),
) -> NumberTable:
    """Return the numbers in columns of rows.

    Parameters
    ----------
    rows : iterable of Row
        The rows.
    columns : mapping of str to int
        Position from 0 by the column's name in messages.
    source : str
        The file, for messages.
    dialect : Dialect
        Form of the cells.
    width : int, optional
        Number of cells in every row; default the number in the first row.
    may_be_empty : collection of str
        Names of columns in which an empty cell is NaN.

    Raises
    ------
    InputError
        If rows have more or fewer cells, or a cell has no number; with the lines.
    """
    problems = Problems(source, most=MAX_PROBLEMS)
    positions = list(columns.values())
    values, lines = array("d"), array("q")
    for line, cells in rows:
        width = width or len(cells)
        if not lines and max(positions) >= width:
            name = max(columns, key=lambda name: columns[name])
            raise InputError(f"{source}: line {line}: {width} columns; {name} is column {columns[name] + 1}")
        if len(cells) != width:
            problems.add(
                f"line {line}", f"{len(cells)} cells", f"{width} are needed: check delimiter and decimal"
            )
            continue
        try:
            numbers = [dialect.number(cells[position]) for position in positions]
        except ValueError:
            numbers = [np.nan] * len(positions)
            for index, (name, position) in enumerate(columns.items()):
                cell = cells[position]
                try:
                    numbers[index] = dialect.number(cell)
                except ValueError:
                    if cell or name not in may_be_empty:
                        comma = " (is the comma a decimal sign?)" if "," in cell else ""
                        shown = (
                            cell if len(cell) <= MAX_SHOWN_CHARACTERS else cell[:MAX_SHOWN_CHARACTERS] + "…"
                        )
                        problems.add(f"line {line}", f"{name} is {shown!r}", f"a number is needed{comma}")
        values.extend(numbers)
        lines.append(line)
    problems.raise_if_any()
    return NumberTable(np.array(values).reshape(len(lines), len(positions)), lines)


def read_format_numbers(
    lines: Sequence[str],
    dialect: Dialect,
    width: int,
    first: int = 1,
    readers: Mapping[int, Callable[[Sequence[str]], np.ndarray]] | None = None,
) -> NumberTable | None:
    """Return all columns of a table that has only numbers; None for any other table, which `read_numbers` reads.

    An empty cell and a cell of ``nan`` is NaN.

    Parameters
    ----------
    lines : sequence of str
        The lines without their ends.
    dialect : Dialect
        Form of the rows.
    width : int
        Cells of every row; None is returned for more than `MAX_PLAIN_COLUMNS`.
    first : int
        Number of the first line in the file.
    readers : mapping of int to callable, optional
        Functions that return the numbers of the cells of other columns, by position from 0.
    """
    readers = readers or {}
    if not lines or len(dialect.split(lines[0])) != width or width > MAX_PLAIN_COLUMNS:
        return None
    text = "\n".join(lines)
    # Pandas fills short rows: with no more cells than in whole rows, no row is short, as no row may be long.
    surplus = text.count(dialect.delimiter) - len(lines) * (width - 1) if dialect.delimiter else 0
    if surplus or '"' in text or "\0" in text:
        return None
    from pandas import read_csv

    types = {column: str if column in readers else float for column in range(width)}
    try:
        frame = read_csv(
            io.BytesIO(text.encode()),
            header=None,
            sep=r"\s+" if dialect.delimiter is None else dialect.delimiter,
            decimal=dialect.decimal,
            dtype=types,
            keep_default_na=False,
            na_values={column: [*_PLAIN_MISSING] for column in types.keys() - readers.keys()},
            skip_blank_lines=False,
            skipinitialspace=True,
        )
        columns = [readers.get(column, np.asarray)(frame.pop(column).to_numpy()) for column in range(width)]
    except (ValueError, KeyError, OverflowError):  # pandas' errors are of ValueError
        return None
    table = np.stack(columns, axis=1)
    ends_short = dialect.delimiter is None and np.isnan(table[:, -1]).any()
    if (
        table.shape != (len(lines), width)
        or ends_short
        or np.isinf(table).any()
        or np.isnan(table).all(1).any()
    ):
        return None
    return NumberTable(table, range(first, first + len(lines)))
