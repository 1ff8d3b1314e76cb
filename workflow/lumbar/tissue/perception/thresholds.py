"""Thresholds of a hand, from ``thresholds.yaml`` beside this module or a study's own, and the table of their sources."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import product
from pathlib import Path

import pandas as pd

from lumbar.base.yaml_file import shipped_yaml
from lumbar.settings.perception import PerceptionSettings
from lumbar.tables.described import described
from lumbar.tables.table import Table

_SHIPPED = shipped_yaml(Path(__file__).with_suffix(".yaml"))
NEWTONS: dict[str, float] = _SHIPPED["newtons"]
"""N of one unit of a force."""
VIBRATION_HZ = float(_SHIPPED["vibration_from_Hz"])
"""Frequency from which on another sense tells: Pacinian corpuscles (Brisben, Hsiao and Johnson 1999)."""
FASTEST_HZ = float(_SHIPPED["vibration_to_Hz"])
"""Frequency beyond which the sources have no threshold of an amplitude, and nothing counts."""


@dataclass(frozen=True)
class Hand:
    """One hand: what it just notices (d′ = 1) of a difference of two forces."""

    force_weber: float
    """As a share of the force."""
    force_floor_N: float
    """The least, however small the force is."""
    vibration_weber: float
    vibration_floor_N: float
    """`vibration_weber`, `vibration_floor_N`: the same of what is faster than `VIBRATION_HZ`."""
    window_s: float
    """Time over which it averages the power of what it feels."""


@dataclass(frozen=True)
class Hands:
    """The usual hand, and the keenest and dullest ones with the shortest and the longest window."""

    usual: Hand
    keen: tuple[Hand, Hand]
    dull: tuple[Hand, Hand]

    @property
    def all(self) -> tuple[Hand, ...]:
        """Every hand, the usual one first."""
        return self.usual, *self.keen, *self.dull

    @classmethod
    def of(cls, settings: PerceptionSettings | None = None) -> Hands:
        """Hands of a study; what its settings leave open is as in the literature."""
        chosen = {
            item.name: getattr(settings, item.name, None) or _SHIPPED["hand"][item.name]
            for item in fields(Hand)
        }
        ends = (0, 2)
        windows = [chosen["window_s"][end] for end in ends]
        keen, dull = ({name: values[end] for name, values in chosen.items()} for end in ends)
        usual = Hand(**{name: values[1] for name, values in chosen.items()})
        made = [Hand(**{**values, "window_s": window}) for values, window in product((keen, dull), windows)]
        return cls(usual, (made[0], made[1]), (made[2], made[3]))


def thresholds_table() -> Table:
    """What the thresholds rest on: quantity, what was found, where, by whom, and what of the source was read."""
    return described(__file__, "thresholds", pd.DataFrame(_SHIPPED["literature"]), "literature")
