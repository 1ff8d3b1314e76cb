"""The quality sheet of a recording: what is in its file, what is wrong with it, what became of its markers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from lumbar.lifting.quality.finding import Finding
from lumbar.lifting.quality.tempo import FINE_RATE
from lumbar.records.marker_file import RecordedEvent
from lumbar.records.markers import MarkerRecording
from lumbar.records.stretches import runs


@dataclass(frozen=True)
class OpenStretch:
    """The longest stretch in which a marker was not seen, and what share of the frames it was not seen in."""

    marker: str
    """Label of the file."""
    missing_share: float
    longest_s: float
    from_s: float
    """`longest_s`, `from_s`: length of the longest stretch and its start, seconds."""


@dataclass(frozen=True)
class QualitySheet:
    """What is known of a recording before anything is computed from it."""

    file: str
    rate_Hz: float
    start_s: float
    duration_s: float
    n_frames: int
    markers: tuple[str, ...]
    """Measured markers, by the file's labels."""
    gaps: tuple[OpenStretch, ...]
    """Of the file itself, worst first."""
    findings: tuple[Finding, ...]
    estimated: dict[str, str]
    """Standard names that no marker fills, with the rule they follow."""
    absent: dict[str, str]
    """Standard names that nothing fills, with the reason."""
    left_out: dict[str, str]
    """Points of the file that are no markers, or that the findings leave out altogether."""
    unused: tuple[str, ...]
    """Markers that no standard name stands for."""
    events: tuple[RecordedEvent, ...]
    notes: tuple[str, ...]
    """What the file contradicts itself in."""
    unchecked: dict[str, str] = field(default_factory=dict)
    """What could not be compared with a body, with the reason."""

    @property
    def missing_share(self) -> float:
        """Share of all samples of all markers that were not seen."""
        return sum(gap.missing_share for gap in self.gaps) / max(1, len(self.markers))

    def told_by_plates(self, rate_factor: float | None) -> QualitySheet:
        """The sheet after a comparison with force plates: by them the rate is known, where they tell it."""
        if rate_factor is None:
            return self
        told = {what: reason for what, reason in self.unchecked.items() if what not in ("rate", FINE_RATE)}
        return replace(self, unchecked=told)

    def as_dict(self) -> dict:
        """Return the sheet as data for JSON."""
        return asdict(self) | {"missing_share": self.missing_share}

    def lines(self) -> list[str]:
        """Return the sheet in sentences."""
        stop = self.start_s + self.duration_s
        lines = [
            f"{Path(self.file).name}: {self.n_frames} frames at {self.rate_Hz:g} Hz, {self.start_s:.2f} to {stop:.2f} s, "
            f"{len(self.markers)} markers"
        ]
        reasons = Counter(self.left_out.values())
        if reasons:
            counted = ", ".join(f"{count} × {reason}" for reason, count in reasons.most_common())
            lines.append(f"no markers: {counted}")
        if self.events:
            shown = ", ".join(f"{_event(event)} {event.time:.2f} s" for event in self.events)
            lines.append(f"events in the file: {shown}")
        lines += [f"note: {note}" for note in self.notes]
        lines.append(self._gaps_in_words())
        lines += [f"{finding.outcome}: {finding}" for finding in self.findings] or [
            "findings: none" + (" in what could be checked" if self.unchecked else "")
        ]
        if self.unchecked:
            reasons = "; ".join(f"{what} ({reason})" for what, reason in self.unchecked.items())
            lines.append(f"not checked: {reasons}")
        return lines

    def _gaps_in_words(self) -> str:
        if not self.gaps:
            return "gaps: none"
        worst = ", ".join(
            f"{gap.marker} {gap.longest_s:.2f} s from {gap.from_s:.2f} s ({gap.missing_share:.1%})"
            for gap in self.gaps[:_SHOWN]
        )
        more = f", and {len(self.gaps) - _SHOWN} more" if len(self.gaps) > _SHOWN else ""
        return f"gaps: {self.missing_share:.2%} of all samples; longest of each: {worst}{more}"


_SHOWN = 5


def _event(event: RecordedEvent) -> str:
    return f"{event.context} {event.label}".strip()


def quality_sheet(
    recording: MarkerRecording,
    points: dict[str, np.ndarray],
    findings: Sequence[Finding],
    unchecked: dict[str, str] | None = None,
) -> QualitySheet:
    """Return the sheet of a recording.

    Parameters
    ----------
    points : dict of str to ndarray, shape (n_frames, 3)
        Measured markers by the file's labels, before anything was left out.
    unchecked : dict of str to str, optional
        As of `lumbar.lifting.quality.gate.unchecked`.
    """
    return QualitySheet(
        file=recording.source,
        rate_Hz=recording.rate,
        start_s=float(recording.time[0]),
        duration_s=len(recording) / recording.rate,
        n_frames=len(recording),
        markers=tuple(points),
        gaps=_open_stretches(points, recording),
        findings=tuple(findings),
        estimated=dict(recording.derived),
        absent=dict(recording.absent),
        left_out=dict(recording.dropped),
        unused=recording.unused,
        events=recording.events,
        notes=recording.notes,
        unchecked=dict(unchecked or {}),
    )


def _open_stretches(points: dict[str, np.ndarray], recording: MarkerRecording) -> tuple[OpenStretch, ...]:
    found = []
    for label, positions in points.items():
        missing = ~np.isfinite(positions).all(axis=1)
        if missing.any():
            longest = max(runs(missing), key=lambda gap: gap.stop - gap.start)
            length = (longest.stop - longest.start) / recording.rate
            start = float(recording.time[longest.start])
            found.append(OpenStretch(label, float(missing.mean()), length, start))
    return tuple(sorted(found, key=lambda gap: -gap.longest_s))
