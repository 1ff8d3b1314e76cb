"""Text files as rows of numbers: how they are decoded, what counts as a number, when reading stops; and clocks that are even."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.record import CLOCK_TOLERANCE, LARGEST

MOST_PROBLEMS = 20
"""Problems of one file that are told; a file of another kind has one in every line."""


def number(text: str) -> float:
    """Return the number that a text is, by what every program writes.

    Python's own ``float`` also takes ``1_000`` and the digits of other scripts, which in a file are mistakes.

    Raises
    ------
    ValueError
        The text is no number.

    Examples
    --------
    >>> number("-1.5e3")
    -1500.0
    >>> number("1_000")
    Traceback (most recent call last):
        ...
    ValueError: could not convert string to float: '1_000'
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"could not convert string to float: {text!r}")
    return float(text)


def read_lines(path: Path) -> list[str]:
    """Lines of a text file in UTF-8, or else in the code page that Windows programs write."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        text = path.read_text(encoding="cp1252", errors="replace")
    return text.splitlines()


def read_rows(
    path: Path, rows: Iterable[tuple[int, list[str]]], width: int, decimal: str = ".", empty: bool = True
) -> np.ndarray:
    """Numbers of rows, each given with its line, shape (rows, width).

    Parameters
    ----------
    width : int
        Cells of every row.
    empty : bool
        Whether a cell may be empty, or say that it is no number: NaN.

    Raises
    ------
    InputError
        With the lines that have more or fewer cells, or one that is no number, or no finite one.
    """
    problems, lines, table = Problems(str(path)), [], []
    for line, cells in rows:
        if len(cells) != width:
            problems.add(f"line {line}", f"{len(cells)} cells", f"{width} are needed, one per column")
        else:
            try:
                table.append(
                    [number(cell.replace(decimal, ".")) if cell or not empty else np.nan for cell in cells]
                )
            except ValueError as error:
                problems.add(f"line {line}", str(error), "numbers are needed")
            lines.append(line)
        stop_at_many(problems)
    problems.raise_if_any()
    found = np.array(table)
    wrong = np.argwhere(~(np.abs(found) <= LARGEST) & ~(np.isnan(found) & empty))
    if len(wrong):
        row, column = wrong[0]
        raise InputError(
            f"{path}: line {lines[row]}: {found[row, column]:g} in column {column + 1}; finite numbers of at most {LARGEST:g} in "
            "size are needed"
        )
    return found


def check_even(path: Path, printed: np.ndarray, even: np.ndarray, rate: float, blur: float = 0.0) -> None:
    """Raise where a frame is printed, shape (n_frames,) in seconds, elsewhere than on an even clock.

    Parameters
    ----------
    blur : float
        Seconds by which what is printed may differ from it beyond `CLOCK_TOLERANCE` of a frame.

    Raises
    ------
    InputError
        With the frame that is farthest from it.
    """
    away = np.abs(printed - even)
    worst = int(away.argmax())
    if away[worst] > CLOCK_TOLERANCE / rate + blur:
        raise InputError(
            f"{path}: frame {worst + 1} is at {printed[worst]:g} s; at {rate:g} Hz it would be at {even[worst]:g} s: the clock "
            "is not even, the rate is another, or frames are missing"
        )


def stop_at_many(problems: Problems) -> None:
    """Raise where a file has so many problems that no more need to be looked for."""
    if len(problems.entries) >= MOST_PROBLEMS:
        problems.add("", f"reading stopped after {MOST_PROBLEMS} problems")
        problems.raise_if_any()
