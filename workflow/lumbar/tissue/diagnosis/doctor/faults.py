"""Mistakes of a recording that everyone makes once, put into records, and from what size on a diagnosis tells them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.doctor.effect_sizes import Diagnose, Kind, Outcome, diagnosis_or_refusal
from lumbar.tissue.diagnosis.selection.verdict import Verdict

_NOTABLE = 0.5
"""Share by which the size of a finding must differ from that of the same finding without the fault."""
_TELLING = (Kind.TOLD, Kind.NAMED, Kind.TIED, Kind.REFUSED)


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
    change: Callable[[Record, float, np.random.Generator], Record]
    """From a record, size and what is random in it to the record with the mistake."""
    findings: tuple[str, ...] = ()
    """Kinds of findings that tell it."""
    effects: tuple[str, ...] = ()
    """Effects of the catalogue whose naming tells it."""
    one: bool = False
    """Whether it is in the shortest record alone, which no model is fitted to unless it is asked for."""

    def size(self, size: float) -> str:
        """A size in words."""
        return self.size_words.format(f"{size:g}")

    def put_into(self, records: list[Record], size: float, seed: int) -> list[Record]:
        """The records with the mistake."""
        if self.one:
            shortest = min(records, key=len)
            random = np.random.default_rng(seed)
            return [self.change(item, size, random) if item is shortest else item for item in records]
        return [
            self.change(record, size, np.random.default_rng([seed, number]))
            for number, record in enumerate(records)
        ]


@dataclass(frozen=True, eq=False)
class FaultOutcomes:
    """What was said of one mistake."""

    fault: Fault
    outcomes: dict[float, Outcome]
    """By size, the largest first, down to the first that was not told."""

    @property
    def smallest(self) -> float | None:
        """Smallest size that was told; None where none was."""
        told = [size for size, outcome in self.outcomes.items() if outcome.kind in _TELLING]
        return min(told, default=None)

    @property
    def largest_missed(self) -> float | None:
        """Largest size that was not told; None where all were."""
        missed = [size for size, outcome in self.outcomes.items() if outcome.kind not in _TELLING]
        return max(missed, default=None)


def fault_outcomes(
    records: Sequence[Record], reference: Verdict, fault: Fault, diagnose: Diagnose, seed: int
) -> FaultOutcomes:
    """Put a mistake into the records, from its largest size down to the first that is not told.

    `reference` is the verdict on the records as they are, `diagnose` the blind diagnosis; `seed` is that of what is
    random in a mistake.
    """
    outcomes: dict[float, Outcome] = {}
    for size in fault.sizes:
        spoilt = fault.put_into(list(records), size, seed)
        found = diagnosis_or_refusal(spoilt, len(reference.selected) + 1, diagnose)
        outcomes[size] = judge_fault(found, fault, reference)
        if outcomes[size].kind not in _TELLING:
            break
    return FaultOutcomes(fault, outcomes)


def judge_fault(found: Verdict | str, fault: Fault, reference: Verdict) -> Outcome:
    """Say what became of a mistake that was put into records.

    `found` is the verdict on the records with it, or the message of their refusal; `reference` that on the records
    without it.
    """
    if isinstance(found, str):
        return Outcome(Kind.REFUSED, message=found)
    known = {(item.kind, item.record): item.value for item in reference.findings}
    for item in found.findings:
        before = known.get((item.kind, item.record), np.nan)
        new = not abs(item.value - before) <= _NOTABLE * abs(before)
        if item.kind in fault.findings and new:
            return Outcome(Kind.TOLD, message=item.sentence, verdict=found)
    added = tuple(name for name in found.selected if name not in reference.selected)
    if added and set(added) <= set(fault.effects):
        return Outcome(Kind.NAMED, message=f"named: {', '.join(added)}", verdict=found)
    if added:
        return Outcome(Kind.MISTAKEN, added, verdict=found)
    if found.verdict == "unexplained" != reference.verdict:
        return Outcome(Kind.UNEXPLAINED, verdict=found)
    return Outcome(Kind.UNSEEN, verdict=found)


def _flip(record: Record, _size, _random) -> Record:
    return record.with_values(output=-record["output"])


def _exchange(record: Record, _size, _random) -> Record:
    return record.with_values(input=record["output"], output=record["input"])


def _offset(record: Record, percent: float, _random) -> Record:
    return record.with_values(output=record["output"] + percent / 100 * np.ptp(record["output"]))


def _scale_input(record: Record, factor: float, _random) -> Record:
    return record.with_values(input=factor * record["input"])


def _scale_response(record: Record, factor: float, _random) -> Record:
    return record.with_values(output=factor * record["output"])


def _delay(record: Record, samples: float, _random) -> Record:
    count, values = int(samples), record["output"]
    return record.with_values(output=np.concatenate([np.full(count, values[0]), values[:-count]]))


def _add_noise(record: Record, percent: float, random: np.random.Generator) -> Record:
    size = percent / 100 * np.ptp(record["input"])
    return record.with_values(input=record["input"] + size * random.standard_normal(len(record)))


def _round(record: Record, percent: float, _random) -> Record:
    step = percent / 100 * np.ptp(record["input"])
    return record.with_values(input=step * np.round(record["input"] / step))


_OFFSETS, _RESOLUTIONS = (10.0, 3.0, 1.0), (3.0, 1.0, 0.3, 0.1)
_OF_RANGE = "{} % of its range"
FAULTS = {
    fault.name: fault
    for fault in (
        Fault("sign_flip", "sign of the response changed in all records", "", (1.0,), _flip, ("sign",)),
        Fault("one_sign_flip", "sign of the response changed in one record", "", (1.0,), _flip, ("sign",), one=True),
        Fault("exchanged_columns", "input and response exchanged in all records", "", (1.0,), _exchange, ("direction",)),
        Fault("offset", "zero of the response off in all records", _OF_RANGE, _OFFSETS, _offset, ("force_offset",)),
        Fault("one_offset", "zero of the response off in one record", _OF_RANGE, _OFFSETS, _offset, ("force_offset",), one=True),
        Fault(
            "input_unit", "input of one record in another unit", "{} times", (1000.0, 25.4, 10.0), _scale_input, ("unit",),
            one=True,
        ),
        Fault(
            "response_unit", "response of one record in another unit", "{} times", (1000.0, 9.81, 4.448), _scale_response,
            ("unit",), one=True,
        ),
        Fault("lag", "response late in all records", "{} samples", (5.0, 3.0, 2.0, 1.0), _delay, ("clock_skew",), ("delay",)),
        Fault("position_noise", "noise in the input", _OF_RANGE, _RESOLUTIONS, _add_noise, ("position_noise",)),
        Fault("position_step", "input in steps", _OF_RANGE, _RESOLUTIONS, _round, ("position_step",)),
    )
}  # fmt: skip
"""By name."""
