"""A property of the records that is not a missing physical effect: zeros and faults of sensors, linear dynamics, rates."""

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Finding:
    """One property of the records."""

    kind: str
    """Kind of property, e.g. ``"force_offset"``, ``"position_noise"``, ``"higher_order_linear"``."""
    sentence: str
    """Description of the property with numbers and units, and advice."""
    value: float
    """Size of the property."""
    unit: str
    record: str = ""
    """Name of the record with this property; empty if all have it."""

    def to_json(self) -> dict:
        """Return the entry of ``findings`` in ``diagnosis.json``."""
        return asdict(self)
