"""Conventions for building and running an FMU: paths of its files, names, units."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

REFERENCE = ("resources/reference_input.csv", "resources/reference_output.csv")
"""Files with the reference signals, for a test of an importer."""
WITHOUT_EVENT_MODE = "resources/reference_output_without_event_mode.csv"
"""File with the output that an importer without event mode reads from an FMI 3.0 FMU; an FMI 2.0 FMU gives the same output."""
ANNOTATION = "lumbar"
"""Name of the annotation of this project in the model description."""
PUSH_S = 0.2
"""Duration in seconds of the push that shows which force resists."""
ELEMENT = 16
"""Difference between the value references of two successive elements, as in ``sampled_force.h``."""
_BASE_UNITS = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
"""Exponents of the SI base units and factor, as in FMI's BaseUnit."""


def slow_push(sampling_time: float) -> np.ndarray:
    """Return positions of a slow push from 0 to 1; its mean response has the resisting sign despite relaxation and friction."""
    return np.linspace(0.0, 1.0, max(10, round(PUSH_S / sampling_time)))


def element_names(name: str, axes: int) -> tuple[str, ...]:
    """Return the names of the elements of a vector in FMI 2.0: ``position[1]`` …."""
    return tuple(f"{name}[{number}]" for number in range(1, axes + 1))


def along_axes(path, axes: int) -> np.ndarray:
    """Return positions in space from a path along a line; each axis moves half as far as the axis before it."""
    return np.multiply.outer(path, 0.5 ** np.arange(axes)) if axes else path


def base_unit(unit: str) -> dict[str, float] | None:
    """Return exponents and factor of a unit, which may end in ``/s``; None for an unknown unit."""
    known = _BASE_UNITS.get(unit.removesuffix("/s"))
    return {**known, "s": known.get("s", 0) - 1} if known and unit.endswith("/s") else known


@dataclass(frozen=True)
class WorkUnits:
    """Units of a position and a force. Their product is an energy except with the defaults."""

    position: float = 1.0
    """One unit of the position in m or rad."""
    force: float = 1.0
    """One unit of the force in N or N·m."""
    damping: str = "1"
    """Unit of the damping."""

    @property
    def has_energy(self) -> bool:
        """True if position times force is an energy."""
        return self != WorkUnits()

    @property
    def is_of_length(self) -> bool:
        """True if the position is a length and the force not a torque."""
        return self.damping == "N·s/m"


@cache
def work_units(position: str, force: str) -> WorkUnits:
    """Return position and force in SI units and the unit of damping.

    `position` and `force` are unit names, of a length and a force or of an angle and a torque.
    """
    x, y = ({**(base_unit(unit) or {})} for unit in (position, force))
    factors = float(x.pop("factor", 1.0)), float(y.pop("factor", 1.0))
    if x == {"m": 1} and y == _BASE_UNITS["N"]:
        return WorkUnits(*factors, "N·s/m")
    if x == {"rad": 1} and y == _BASE_UNITS["N·m"]:
        return WorkUnits(*factors, "N·m·s/rad")
    return WorkUnits()
