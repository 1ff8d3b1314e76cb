"""Which mistakes of a recording a diagnosis would have told, and from what size on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.doctor.faults import Fault
from lumbar.tissue.diagnosis.doctor.outcome import Diagnose, Kind, Outcome, diagnosed
from lumbar.tissue.diagnosis.selection.verdict import Verdict

_NOTABLE = 0.5
"""Share by which the size of a finding must differ from that of the same finding without the fault."""
_TELLING = (Kind.TOLD, Kind.NAMED, Kind.TIED, Kind.REFUSED)


@dataclass(frozen=True, eq=False)
class FaultTold:
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
    def not_told(self) -> tuple[float, Outcome] | None:
        """Largest size that was not told, and what was said instead; None where all were."""
        found = ((size, item) for size, item in self.outcomes.items() if item.kind not in _TELLING)
        return next(found, None)

    @property
    def as_told(self) -> Outcome | None:
        """What was said of the smallest size that was told."""
        return None if self.smallest is None else self.outcomes[self.smallest]


def faults_told(
    records: Sequence[Record],
    reference: Verdict,
    faults: Sequence[Fault],
    diagnose: Diagnose,
    quick: bool,
    seed: int,
) -> Iterator[FaultTold]:
    """Put every mistake into the records, from its largest size down to the first that is not told.

    Parameters
    ----------
    reference : Verdict
        Of the records as they are.
    diagnose : callable
        Blind diagnosis.
    quick : bool
        Only the largest size.
    seed : int
        Of what is random in a mistake.
    """
    most = len(reference.selected) + 1
    for fault in faults:
        outcomes: dict[float, Outcome] = {}
        for size in fault.sizes[: 1 if quick else None]:
            spoilt = fault.put_into(list(records), size, seed)
            outcomes[size] = judge_fault(diagnosed(spoilt, most, diagnose), fault, reference)
            if outcomes[size].kind not in _TELLING:
                break
        yield FaultTold(fault, outcomes)


def judge_fault(found: Verdict | str, fault: Fault, reference: Verdict) -> Outcome:
    """Say what became of a mistake that was put into records.

    Parameters
    ----------
    found : Verdict or str
        Of the records with it, or the message of their refusal.
    reference : Verdict
        Of the records without it.
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
