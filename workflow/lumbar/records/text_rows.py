"""Text files as rows of numbers: how they are decoded, what counts as a number, and when reading stops."""

from __future__ import annotations

from pathlib import Path

from lumbar.base.errors import Problems

MOST_PROBLEMS = 20
"""Problems of one file that are told; a file of another kind has one in every line."""
RATES_HZ = (1e-3, 1e6)
"""Rates of recording that are read."""


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


def stop_at_many(problems: Problems) -> None:
    """Raise where a file has so many problems that no more need to be looked for."""
    if len(problems.entries) >= MOST_PROBLEMS:
        problems.add("", f"reading stopped after {MOST_PROBLEMS} problems")
        problems.raise_if_any()
