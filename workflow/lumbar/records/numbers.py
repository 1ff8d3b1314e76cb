"""Numbers as files write them."""

from __future__ import annotations


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
