"""What is wrong with a marker recording, finding by finding; the quality sheet of a recording, and those of a study as a table.

A finding says which markers, when, what was seen, the likely cause, and what is done about it.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_yaml
from lumbar.records.marker_file import RecordedEvent
from lumbar.records.markers import MarkerRecording
from lumbar.records.stretches import runs
from lumbar.tables.described import described
from lumbar.tables.table import Table

ERROR, LEFT_OUT, PROPOSED, NOTED = "error", "left out", "proposed", "noted"
"""What a finding leads to: the trial stops; the stretch becomes a gap; an exchange of labels is proposed, and until somebody
exchanges them the stretch is a gap; nothing, it is said."""
_SAID: dict[str, dict[str, str]] = shipped_yaml(Path(__file__).with_name("findings.yaml"))
_SHOWN = 5


@dataclass(frozen=True)
class Finding:
    """One finding."""

    kind: str
    """E.g. ``"frozen"``; docs/lifting/quality.md explains each."""
    outcome: str
    """``"error"``, ``"left out"``, ``"proposed"`` or ``"noted"``."""
    markers: tuple[str, ...]
    """Labels of the file; empty where the whole recording is meant."""
    first_frame: int
    n_frames: int
    """`first_frame`, `n_frames`: frames count from 0."""
    start_s: float
    """Time of the first frame, on the recording's legend."""
    length_s: float
    """Frames divided by the rate."""
    evidence: str
    """What was seen, in numbers."""
    cause: str = ""
    """What it most likely comes from, or what to do."""
    concerns: tuple[str, ...] = ()
    """Standard names that the markers fill, directly or by a rule."""

    @property
    def remedy(self) -> str:
        """What to do so that its frames can be used."""
        return _SAID[self.kind]["remedy"]

    @property
    def frames(self) -> slice:
        """The frames as a slice."""
        return slice(self.first_frame, self.first_frame + self.n_frames)

    def __str__(self) -> str:
        who = ", ".join(self.markers) or "all markers"
        when = f"{self.start_s:.2f} to {self.start_s + self.length_s:.2f} s"
        when += f" (frames {self.first_frame} to {self.frames.stop - 1})"
        return f"{self.kind}: {who}, {when}: {self.evidence}" + (f"; {self.cause}" if self.cause else "")


@dataclass(frozen=True)
class Legend:
    """Frames of a recording in seconds, and what its labels stand for: makes findings."""

    time: np.ndarray
    """Shape (n_frames,)."""
    rate: float
    """Frames per second."""
    named: dict[str, str] = field(default_factory=dict)
    """Landmark by label."""

    def finding(
        self, name: str, markers: tuple[str, ...] = (), frames: slice | None = None, **words
    ) -> Finding:
        """Return a finding of ``findings.yaml`` about some frames, or about all; `words` stand for what is in braces there."""
        first, stop = (frames.start, frames.stop) if frames else (0, len(self.time))
        seconds = float(self.time[first]), (stop - first) / self.rate
        outcome, *told = (_SAID[name][key].format(**words) for key in ("outcome", "evidence", "cause"))
        kind = _SAID[name].get("kind", name)
        return Finding(kind, outcome, markers, int(first), int(stop - first), *seconds, *told)


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
            shown = ", ".join(f"{event_label(event)} {event.time:.2f} s" for event in self.events)
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


def event_label(event: RecordedEvent) -> str:
    """Label of an event with its side, as the file has them."""
    return f"{event.context} {event.label}".strip()


def quality_sheet(
    recording: MarkerRecording,
    points: dict[str, np.ndarray],
    findings: Sequence[Finding],
    unchecked: dict[str, str] | None = None,
) -> QualitySheet:
    """Return the sheet of a recording.

    The points are its measured markers by the file's labels, before anything was left out; `unchecked` is as of
    `lumbar.lifting.quality.gate.unchecked_properties`.
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


def quality_table(sheets: Sequence[dict], source_label: str) -> Table:
    """Return one row per recording: sheets as of `QualitySheet.as_dict`, with the name of the lift under ``lift``."""
    return described("lifting/quality", "quality", list(map(_row, sheets)), source_label)


def _row(sheet: dict) -> dict:
    findings = [
        f"{finding['kind']} ({finding['outcome']}): {', '.join(finding['markers']) or 'all markers'} "
        f"from {finding['start_s']:.2f} s for {finding['length_s']:.2f} s"
        for finding in sheet["findings"]
    ]
    return {
        "lift": sheet["lift"],
        "file": Path(sheet["file"]).name,
        "markers": len(sheet["markers"]),
        "rate_Hz": float(sheet["rate_Hz"]),
        "duration_s": sheet["duration_s"],
        "missing_percent": 100 * sheet["missing_share"],
        "longest_gap_s": max((gap["longest_s"] for gap in sheet["gaps"]), default=0.0),
        "estimated": ", ".join(sheet["estimated"]) or "none",
        "left_out": sum(finding["outcome"] in ("left out", "proposed") for finding in sheet["findings"]),
        "findings": "; ".join(findings) or "none",
        "not_checked": ", ".join(sheet["unchecked"]) or "none",
    }
