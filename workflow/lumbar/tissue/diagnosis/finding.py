"""What the records say beside missing effects: zeros of sensors, their faults, linear dynamics of higher order."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Finding:
    """One thing found in the records that is no missing physical effect."""

    kind: str
    """E.g. ``"force_offset"``, ``"position_noise"``, ``"higher_order_linear"``."""
    sentence: str
    """For a reader, with numbers and units, and what to do."""
    value: float
    """Its size."""
    unit: str
    record: str = ""
    """Name of the record that it was found in; empty where it holds for all."""

    def to_json(self) -> dict:
        """Return the entry of ``findings`` in ``diagnosis.json``."""
        return asdict(self)
