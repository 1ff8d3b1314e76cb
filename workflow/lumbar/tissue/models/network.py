"""Networks of springs and dashpots: the mechanical analogue of a viscoelastic model.

A network is built from `Spring`, `Dashpot`, `Series` and `Parallel`. Its transfer function from displacement
to force follows from two rules: forces add in parallel, displacements add in series.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Spring:
    """Force proportional to elongation."""

    symbol: str
    """Symbol of its stiffness, e.g. ``"k1"``."""


@dataclass(frozen=True)
class Dashpot:
    """Force proportional to the rate of elongation."""

    symbol: str
    """Symbol of its viscosity, e.g. ``"b"``."""


@dataclass(frozen=True)
class Series:
    """Parts that carry the same force; their displacements add."""

    parts: tuple[Network, ...]


@dataclass(frozen=True)
class Parallel:
    """Parts that share the same displacement; their forces add."""

    parts: tuple[Network, ...]


Network = Spring | Dashpot | Series | Parallel


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
