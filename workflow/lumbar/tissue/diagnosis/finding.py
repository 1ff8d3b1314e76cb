"""What the records say beside missing effects: zeros of sensors, their faults, linear dynamics of higher order."""

from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Self

from lumbar.base.yaml_file import shipped_yaml
from lumbar.records.record import Record

_read = cache(shipped_yaml)


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

    @classmethod
    def of(cls, kind: str, value: float, unit: str, record: str = "", **words) -> Self:
        """A finding with the sentence of its kind in ``findings.yaml``; `words` stand for what is in braces there."""
        sentence = _read(Path(__file__).with_name("findings.yaml"))[kind]
        return cls(kind, sentence.format(value=value, unit=unit, record=record, **words), value, unit, record)


def found_in(record: Record, kind: str, value: float, unit: str, **words) -> Finding:
    """A finding in one record's channels, whose quantities its sentence names."""
    position, force = (record.channels[role].quantity for role in ("input", "output"))
    return Finding.of(kind, value, unit, record.name, position=position, force=force, **words)
