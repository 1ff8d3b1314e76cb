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
    values : sequence of float
    fewest : int
        Digits that are given at least.

    Examples
    --------
    >>> told_apart([1.42, 1.404, 1.398], 2)
    ['1.42', '1.404', '1.398']
    """
    wanted = sum(f"{a:.{_MOST}g}" != f"{b:.{_MOST}g}" for a, b in pairwise(values))
    for digits in range(fewest, _MOST + 1):
        words = [f"{value:.{digits}g}" for value in values]
        if sum(a != b for a, b in pairwise(words)) == wanted:
            break
    return words
