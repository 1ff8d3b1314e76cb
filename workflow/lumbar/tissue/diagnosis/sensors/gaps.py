"""Gaps: rows that the clock says are missing, filled in when the record was read."""

from __future__ import annotations

from dataclasses import dataclass

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding


@dataclass(frozen=True)
class Gaps:
    """Rows that were missing."""

    samples: tuple[int, ...]
    """Where they are filled in."""

    kind = "gap"

    def finding(self, record: Record) -> Finding:
        """Say how many rows are missing, and where the first is."""
        count = len(self.samples)
        return Finding(
            self.kind,
            f"{record.name}: {count} row{'s are' if count > 1 else ' is'} missing, the first at "
            f"{record.time[self.samples[0]]:.4g} s; filled in from beside: look for rows lost while recording",
            count,
            "samples",
            record.name,
        )

    def mended(self, record: Record) -> Record:
        """The record itself: its gaps were filled when it was read."""
        return record


def find_gaps(record: Record) -> Gaps | None:
    """Return the rows that were missing, or None."""
    return Gaps(record.filled) if record.filled else None
