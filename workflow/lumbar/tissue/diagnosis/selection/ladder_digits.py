"""Digits of an error ladder: as few as tell neighbouring errors apart."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

_MOST = 7
"""Digits: errors that differ by less are alike."""


def told_apart(values: Sequence[float], fewest: int) -> list[str]:
    """Return numbers in words with so many digits that neighbours which differ read differently.

    Parameters
    ----------
    fewest : int
        Digits that are given at least.

    Examples
    --------
    >>> told_apart([1.42, 1.404, 1.398], 2)
    ['1.42', '1.404', '1.398']
    >>> told_apart([8700.0, 1796.0], 3)
    ['8700', '1800']
    """
    wanted = sum(f"{a:.{_MOST}g}" != f"{b:.{_MOST}g}" for a, b in pairwise(values))
    for digits in range(fewest, _MOST + 1):
        words = [_written(value, digits) for value in values]
        if sum(a != b for a, b in pairwise(words)) == wanted:
            break
    return words


def _written(value: float, digits: int) -> str:
    """A number to so many digits; thousands without an exponent."""
    rounded = float(f"{value:.{digits}g}")
    return f"{rounded:.0f}" if 10.0**digits <= abs(rounded) < 1e6 else f"{value:.{digits}g}"
