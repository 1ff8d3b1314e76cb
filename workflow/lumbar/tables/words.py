"""Names of columns and of values in words, with units: what a table prints where nothing else is given."""

from __future__ import annotations

import re

UNITS = {
    "percent": "%",
    "s": "s",
    "ms": "ms",
    "Hz": "Hz",
    "mm": "mm",
    "m": "m",
    "kg": "kg",
    "N": "N",
    "rad": "rad",
    "J": "J",
    "mm_s": "mm/s",
    "mm_s2": "mm/s²",
    "rad_s": "rad/s",
    "N_m": "N·m",
    "N_s": "N·s",
    "N_s_m": "N·s/m",
    "N_mm": "N/mm",
    "1_s": "1/s",
}
"""Unit by the end of a column's name."""
_WORDS = {
    "vaf": "VAF",
    "fit": "FIT",
    "mru": "MRU",
    "nmse": "NMSE",
    "rms": "RMS",
    "com": "centre of mass",
    "fmi": "FMI",
    "fmus": "FMUs",
    "sos": "sum-of-squares",
    "cvxpy": "CVXPY",
    "auc": "AUC",
    "alpha": "α",
    "rho": "ρ",
    "sd": "s.d.",
    "df": "d.f.",
}
_VALUES = {"flexion_extension": "flexion/extension"}
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_NAME = re.compile(r"[a-z0-9]+(_[a-z0-9]+)+")


def column_in_words(name: str) -> str:
    """Return a column's name as a header: ``"lowest_passive_rate_Hz"`` is ``"Lowest passive rate (Hz)"``."""
    parts = name.split("_")
    unit = ""
    for count in (3, 2, 1):
        if len(parts) > count and "_".join(parts[-count:]) in UNITS:
            unit = f" ({UNITS['_'.join(parts[-count:])]})"
            parts = parts[:-count]
            break
    words = " ".join(_WORDS.get(part, part) for part in parts)
    # A symbol keeps its case: p value, a0, α.
    small = (len(parts[0]) < 3 and parts[0] not in ("no", "at", "of", "up")) or not words.isascii()
    return (words if small else words[:1].upper() + words[1:]) + unit


def value_in_words(text: str) -> str:
    """Return a value that is a name with its words apart: ``"lateral_bending"`` is ``"lateral bending"``."""
    return _VALUES.get(text, text.replace("_", " ")) if _NAME.fullmatch(text) else text


def unit_in_print(unit: str) -> str:
    """Return a unit as journals print it; a broken exponent stays, as no raised signs hold it.

    >>> unit_in_print("N s^2/mm^3"), unit_in_print("N/mm^1.5")
    ('N·s²/mm³', 'N/mm^1.5')
    """
    return re.sub(r"\^(-?\d+)(?![.\d])", lambda found: found[1].translate(_RAISED), unit).replace(" ", "·")
