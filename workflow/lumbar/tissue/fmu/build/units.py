"""Units of an FMU's variables: their SI base units, and what energies need of them."""

from __future__ import annotations

from functools import cache

BASE_UNITS = {
    "m": {"m": 1},
    "mm": {"m": 1, "factor": 1e-3},
    "cm": {"m": 1, "factor": 1e-2},
    "rad": {"rad": 1},
    "deg": {"rad": 1, "factor": 0.017453292519943295},
    "N": {"kg": 1, "m": 1, "s": -2},
    "mN": {"kg": 1, "m": 1, "s": -2, "factor": 1e-3},
    "kN": {"kg": 1, "m": 1, "s": -2, "factor": 1e3},
    "N·m": {"kg": 1, "m": 2, "s": -2},
    "Nm": {"kg": 1, "m": 2, "s": -2},
    "N·mm": {"kg": 1, "m": 2, "s": -2, "factor": 1e-3},
    "s": {"s": 1},
    "J": {"kg": 1, "m": 2, "s": -2},
    "N·s/m": {"kg": 1, "s": -1},
    "N·m·s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
}
"""Exponents of the SI base units and factor, as FMI's BaseUnit wants them."""


def base_unit(unit: str) -> dict[str, float] | None:
    """Return exponents and factor of a unit or of one per second, None where it is not known."""
    known = BASE_UNITS.get(unit.removesuffix("/s")) if unit.endswith("/s") else BASE_UNITS.get(unit)
    if known is None or not unit.endswith("/s"):
        return known
    return {**known, "s": known.get("s", 0) - 1}


@cache
def work_units(position: str, force: str) -> tuple[float, float, str] | None:
    """Return position and force in SI units and the unit of damping; None where their product is no energy.

    Parameters
    ----------
    position, force : str
        Units: of a length and a force, or of an angle and a torque.
    """
    x, y = ({**(base_unit(unit) or {})} for unit in (position, force))
    factors = float(x.pop("factor", 1.0)), float(y.pop("factor", 1.0))
    if x == {"m": 1} and y == BASE_UNITS["N"]:
        return *factors, "N·s/m"
    if x == {"rad": 1} and y == BASE_UNITS["N·m"]:
        return *factors, "N·m·s/rad"
    return None
