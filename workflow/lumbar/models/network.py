"""Networks of springs and dashpots: the mechanical analogue of a viscoelastic model.

A network is built from `Spring`, `Dashpot`, `Series` and `Parallel`. Its transfer function from displacement
to force follows from two rules: forces add in parallel, displacements add in series.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Spring:
    """Force proportional to elongation.

    Attributes
    ----------
    symbol : str
        Symbol of its stiffness, e.g. ``"k1"``.
    """

    symbol: str


@dataclass(frozen=True)
class Dashpot:
    """Force proportional to the rate of elongation.

    Attributes
    ----------
    symbol : str
        Symbol of its viscosity, e.g. ``"b"``.
    """

    symbol: str


@dataclass(frozen=True)
class Series:
    """Parts that carry the same force; their displacements add."""

    parts: tuple[Network, ...]


@dataclass(frozen=True)
class Parallel:
    """Parts that share the same displacement; their forces add."""

    parts: tuple[Network, ...]


Network = Spring | Dashpot | Series | Parallel


def transfer_polynomials(network: Network, values: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of force over displacement in the Laplace variable.

    Parameters
    ----------
    network : Network
        The mechanical analogue.
    values : dict of str to float
        Stiffness or viscosity of every element by its symbol.

    Returns
    -------
    numerator, denominator : numpy.ndarray
        Descending powers of s; the denominator's constant term is 1 where it is not zero.
    """
    numerator, denominator = _polynomials(network, values)
    scale = denominator[-1] if denominator[-1] != 0 else 1.0
    return numerator / scale, denominator / scale


def _polynomials(network: Network, values: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    match network:
        case Spring(symbol):
            return np.array([values[symbol]]), np.array([1.0])
        case Dashpot(symbol):
            return np.array([values[symbol], 0.0]), np.array([1.0])
        case Parallel(parts):
            return _sum([_polynomials(part, values) for part in parts])
        case Series(parts):  # compliances add: 1/H = sum of 1/H_i
            compliance = _sum([_polynomials(part, values)[::-1] for part in parts])
            return compliance[1], compliance[0]


def _sum(fractions) -> tuple[np.ndarray, np.ndarray]:
    numerator, denominator = fractions[0]
    for other_numerator, other_denominator in fractions[1:]:
        numerator = np.polyadd(
            np.polymul(numerator, other_denominator), np.polymul(other_numerator, denominator)
        )
        denominator = np.polymul(denominator, other_denominator)
    return numerator, denominator


def in_words(network: Network) -> str:
    """Put the network into words, e.g. ``"(spring k1 parallel to dashpot b) in series with spring k2"``."""
    match network:
        case Spring(symbol):
            return f"spring {symbol}"
        case Dashpot(symbol):
            return f"dashpot {symbol}"
        case Series(parts) | Parallel(parts):
            joint = " in series with " if isinstance(network, Series) else " parallel to "
            return joint.join(
                f"({in_words(part)})" if isinstance(part, Series | Parallel) else in_words(part)
                for part in parts
            )
