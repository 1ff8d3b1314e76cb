"""Mistakes of a recording that everyone makes once, put into records: signs, columns, zeros, units, clocks, resolution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lumbar.records.record import Record


@dataclass(frozen=True, eq=False)
class Fault:
    """A mistake, in one or several sizes."""

    name: str
    words: str
    """What it is."""
    size_words: str
    """Its size, as ``{}``; empty where it has none."""
    sizes: tuple[float, ...]
    """The largest first."""
    put_into: Callable[[list[Record], float, int], list[Record]]
    """From records, size and a seed to the records with the mistake."""
    findings: tuple[str, ...] = ()
    """Kinds of findings that tell it."""
    effects: tuple[str, ...] = ()
    """Effects of the catalogue whose naming tells it."""
    several: bool = False
    """Whether it takes more than one record."""

    def size(self, size: float) -> str:
        """A size in words."""
        return self.size_words.format(f"{size:g}")


def _all(change: Callable[[Record, float, np.random.Generator], Record]):
    """Put a mistake into every record."""

    def put_into(records: list[Record], size: float, seed: int) -> list[Record]:
        return [
            change(record, size, np.random.default_rng([seed, number]))
            for number, record in enumerate(records)
        ]

    return put_into


def _shortest(change: Callable[[Record, float, np.random.Generator], Record]):
    """Put a mistake into the shortest record alone, which no model is fitted to unless it is asked for."""

    def put_into(records: list[Record], size: float, seed: int) -> list[Record]:
        shortest = min(records, key=len)
        return [
            change(item, size, np.random.default_rng(seed)) if item is shortest else item for item in records
        ]

    return put_into


def _flipped(record: Record, _size: float, _generator: np.random.Generator) -> Record:
    return record.with_values(output=-record["output"])


def _exchanged(record: Record, _size: float, _generator: np.random.Generator) -> Record:
    return record.with_values(input=record["output"], output=record["input"])


def _offset(record: Record, percent: float, _generator: np.random.Generator) -> Record:
    return record.with_values(output=record["output"] + percent / 100 * np.ptp(record["output"]))


def _position_scaled(record: Record, factor: float, _generator: np.random.Generator) -> Record:
    return record.with_values(input=factor * record["input"])


def _force_scaled(record: Record, factor: float, _generator: np.random.Generator) -> Record:
    return record.with_values(output=factor * record["output"])


def _late(record: Record, samples: float, _generator: np.random.Generator) -> Record:
    count, values = int(samples), record["output"]
    return record.with_values(output=np.concatenate([np.full(count, values[0]), values[:-count]]))


def _noisy(record: Record, percent: float, generator: np.random.Generator) -> Record:
    size = percent / 100 * np.ptp(record["input"])
    return record.with_values(input=record["input"] + size * generator.standard_normal(len(record)))


def _stepped(record: Record, percent: float, _generator: np.random.Generator) -> Record:
    step = percent / 100 * np.ptp(record["input"])
    return record.with_values(input=step * np.round(record["input"] / step))


FAULTS = {
    fault.name: fault
    for fault in (
        Fault(
            "sign_flip", "sign of the response changed in all records", "", (1.0,), _all(_flipped), ("sign",)
        ),
        Fault(
            "one_sign_flip",
            "sign of the response changed in one record",
            "",
            (1.0,),
            _shortest(_flipped),
            ("sign",),
            several=True,
        ),
        Fault(
            "exchanged_columns",
            "input and response exchanged in all records",
            "",
            (1.0,),
            _all(_exchanged),
            ("direction",),
        ),
        Fault(
            "offset",
            "zero of the response off in all records",
            "{} % of its range",
            (10.0, 3.0, 1.0),
            _all(_offset),
            ("force_offset",),
        ),
        Fault(
            "one_offset",
            "zero of the response off in one record",
            "{} % of its range",
            (10.0, 3.0, 1.0),
            _shortest(_offset),
            ("force_offset",),
            several=True,
        ),
        Fault(
            "input_unit",
            "input of one record in another unit",
            "{} times",
            (1000.0, 25.4, 10.0),
            _shortest(_position_scaled),
            ("unit",),
            several=True,
        ),
        Fault(
            "response_unit",
            "response of one record in another unit",
            "{} times",
            (1000.0, 9.81, 4.448),
            _shortest(_force_scaled),
            ("unit",),
            several=True,
        ),
        Fault(
            "lag",
            "response late in all records",
            "{} samples",
            (5.0, 3.0, 2.0, 1.0),
            _all(_late),
            ("clock_skew",),
            ("delay",),
        ),
        Fault(
            "position_noise",
            "noise in the input",
            "{} % of its range",
            (3.0, 1.0, 0.3, 0.1),
            _all(_noisy),
            ("position_noise",),
        ),
        Fault(
            "position_step",
            "input in steps",
            "{} % of its range",
            (3.0, 1.0, 0.3, 0.1),
            _all(_stepped),
            ("position_step",),
        ),
    )
}
"""By name."""
