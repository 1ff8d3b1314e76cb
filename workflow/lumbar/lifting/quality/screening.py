"""Reading a marker file through the checks: frames that cannot be a body become gaps, and a quality sheet reports them.

An alias of a single label defines that label's meaning; a rule such as ``L_WRIST: {mean: [RWRA, RWRB]}`` defines the side of its
labels. So labels that the user has exchanged in the layout's aliases are not reported as exchanged again.
"""

import os
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.quality.body import check_unaliased_axes
from lumbar.lifting.quality.findings import ERROR, LEFT_OUT, MarkerFinding
from lumbar.lifting.quality.gate import examine, mask_findings, unchecked_properties
from lumbar.lifting.quality.marker_sets import landmarks
from lumbar.records.marker_file import RecordedEvent
from lumbar.records.markers import MarkerRecording, Repair, read_markers
from lumbar.records.sampling import runs
from lumbar.settings.layout import Alias, MarkerLayout, MeanOfMarkers, OffsetPoint, PointBetween
from lumbar.tables.table import Table, table_from_schema

_MAX_SHOWN = 5
"""Largest number of markers with gaps, markers with findings of one kind, and events in the text of the report."""


@dataclass(frozen=True)
class OpenGap:
    """Gaps of one marker of the file."""

    marker: str
    missing_share: float
    """Share of the frames in which the marker is not seen."""
    longest_s: float
    """Length of the longest gap."""
    from_s: float
    """Start of the longest gap on the recording's clock."""


@dataclass(frozen=True)
class QualitySheet:
    """Report on a recording before anything is computed from it."""

    file: str
    rate_Hz: float
    start_s: float
    duration_s: float
    n_frames: int
    markers: tuple[str, ...]
    """Measured markers, by the file's labels."""
    gaps: tuple[OpenGap, ...]
    """Gaps in the file before any check, worst first."""
    findings: tuple[MarkerFinding, ...]
    estimated: dict[str, str]
    """Standard names without a marker that a rule estimates, with the rule."""
    absent: dict[str, str]
    """Standard names without marker and rule, with the reason."""
    left_out: dict[str, str]
    """Points of the file that are not markers, and markers left out of all frames by findings, with the reason."""
    unused: tuple[str, ...]
    """Markers without a standard name."""
    events: tuple[RecordedEvent, ...]
    notes: tuple[str, ...]
    """Contradictions in the file."""
    unchecked: dict[str, str] = field(default_factory=dict)
    """Properties that could not be compared with a body, with the reason."""

    @property
    def missing_share(self) -> float:
        """Return the share of all samples of all markers that were not seen."""
        return sum(gap.missing_share for gap in self.gaps) / max(1, len(self.markers))

    def to_dict(self) -> dict:
        """Return the sheet as data for JSON."""
        return asdict(self) | {"missing_share": self.missing_share}

    def lines(self, details: bool = False) -> list[str]:
        """Return the sheet in sentences, with one line for each finding or, without details, for each kind.

        Parameters
        ----------
        details : bool, default False
            True lists each finding; False counts those of one kind.
        """
        stop = self.start_s + self.duration_s
        lines = [
            f"{Path(self.file).name}: {self.n_frames} frames at {self.rate_Hz:g} Hz, {self.start_s:.2f} to {stop:.2f} s, "
            f"{len(self.markers)} markers"
        ]
        reasons = Counter(self.left_out.values())
        if reasons:
            counted = "; ".join(f"{count} × {reason}" for reason, count in reasons.most_common())
            lines.append(f"points that are not markers: {counted}")
        if self.events:
            times = [f"{event.full_label} {event.time:.2f} s" for event in self.events]
            counts = Counter(event.full_label for event in self.events)
            if not details and len(times) > _MAX_SHOWN:
                times = [f"{label} × {count}" for label, count in counts.items()]
            lines.append(f"events in the file: {', '.join(times)}")
        lines += [f"note: {note}" for note in self.notes]
        worst = [
            f"{gap.marker} {gap.longest_s:.2f} s from {gap.from_s:.2f} s ({gap.missing_share:.1%})"
            for gap in self.gaps[:_MAX_SHOWN]
        ]
        more = f", and {len(self.gaps) - _MAX_SHOWN} more" if len(self.gaps) > _MAX_SHOWN else ""
        share = f"{self.missing_share:.2%} of all samples; longest of each: {', '.join(worst)}{more}"
        lines.append(f"gaps: {share if self.gaps else 'none'}")
        none = "findings: none" + (" in what could be checked" if self.unchecked else "")
        kinds: dict[object, list[MarkerFinding]] = {}
        for finding in self.findings:
            kinds.setdefault(finding if details else (finding.outcome, finding.kind), []).append(finding)
        lines += [_describe_findings(found) for found in kinds.values()] or [none]
        if self.unchecked:
            properties = "; ".join(f"{name} ({reason})" for name, reason in self.unchecked.items())
            lines.append(f"not checked: {properties}")
        return lines


def _describe_findings(findings: list[MarkerFinding]) -> str:
    """Return one line on findings of one kind: the finding, or the number of findings, markers and times."""
    first, *others = findings
    if not others:
        return f"{first.outcome}: {first}"
    markers = Counter(marker for finding in findings for marker in finding.markers)
    shown = [
        f"{marker} × {count}" if count > 1 else marker for marker, count in markers.most_common(_MAX_SHOWN)
    ]
    more = f" and {len(markers) - len(shown)} more" if len(markers) > len(shown) else ""
    start, stop = (min(one.start_s for one in findings), max(one.start_s + one.length_s for one in findings))
    where = f"{', '.join(shown) or 'all markers'}{more}, {start:.2f} to {stop:.2f} s"
    return f"{first.outcome}: {first.kind} × {len(findings)}: {where}; first: {first.evidence}"


@dataclass
class Screening:
    """Check of marker files for `lumbar.records.markers.read_markers`, with the findings in the last file."""

    height_m: float | None = None
    aliases: Mapping[str, Alias | None] = field(default_factory=dict)
    """Aliases of the layout, which define the laboratory's labels."""
    refuse: bool = True
    """True if a finding with outcome `ERROR` raises `InputError`; False if it is only listed."""
    findings: list[MarkerFinding] = field(default_factory=list)
    """Findings in the file read last."""
    points: dict[str, np.ndarray] = field(default_factory=dict)
    """Shape (n_frames, 3): measured markers of the file by label, before anything was left out."""
    unchecked: dict[str, str] = field(default_factory=dict)
    """Properties that could not be compared with a body, with the reason."""

    def __call__(
        self, points: dict[str, np.ndarray], time: np.ndarray, rate: float
    ) -> tuple[dict[str, np.ndarray], dict[str, str]]:
        """Return the points with NaN in frames left out, and the reasons for markers left out of all frames."""
        meant = meant_labels(self.aliases, points)
        meant = meant_in_rules(self.aliases, points, meant) | meant
        self.points, self.findings = points, examine(points, time, rate, self.height_m, meant)
        self.unchecked = unchecked_properties(points, self.height_m, meant)
        if self.refuse:
            self.raise_errors()
        screened = mask_findings(points, self.findings)
        left_out = {
            label: f"{finding.kind} in all frames"
            for finding in self.findings
            for label in finding.markers
            if np.isnan(screened[label]).all()
        }
        return screened, left_out

    def raise_errors(self) -> None:
        """Raise `InputError` if a finding is an error."""
        errors = [finding for finding in self.findings if finding.outcome == ERROR]
        if errors:
            raise InputError("; ".join(map(str, errors)))


def read_screened(
    path: str | os.PathLike,
    layout: MarkerLayout | None = None,
    name: str | None = None,
    height_m: float | None = None,
    repair: Repair | None = None,
) -> tuple[MarkerRecording, QualitySheet]:
    """Read a marker file, leave out frames that cannot be a body, and return the recording and its quality report.

    Frames that are left out become gaps; a marker left out of all frames is in `MarkerRecording.dropped`.

    Parameters
    ----------
    path : str or os.PathLike
        The marker file.
    layout : MarkerLayout, optional
        Labels, unit and axes of the file; default: `MarkerLayout()`.
    name : str, optional
        Name of the recording; default: see `read_markers`.
    height_m : float, optional
        Stature of the subject, to check the unit and the body.
    repair : Repair, optional
        Fills gaps after the screening.

    Raises
    ------
    InputError
        As `read_markers`; and if the unit or the sides of the whole recording are impossible.
    """
    layout = layout or MarkerLayout()
    screening = Screening(height_m, layout.aliases)
    with naming(path):
        recording = read_markers(path, layout, name=name, screen=screening, repair=repair)
        return recording, sheet_of(recording, screening, layout)


@contextmanager
def naming(path: str | os.PathLike) -> Iterator[None]:
    """Put the file's name in front of error messages that do not begin with it."""
    try:
        yield
    except InputError as error:
        text = str(error)
        raise error if text.startswith(str(path)) else InputError(f"{path}: {text}") from error


def sheet_of(recording: MarkerRecording, screening: Screening, layout: MarkerLayout) -> QualitySheet:
    """Check the axes of a recording by the body and return the quality report of its screening.

    Parameters
    ----------
    recording : MarkerRecording
        Recording under standard names.
    screening : Screening
        Screening of this recording.
    layout : MarkerLayout
        Layout with which the recording was read.

    Raises
    ------
    InputError
        If the declared axes contradict the body.
    """
    from lumbar.records.marker_aliases import resolve_aliases

    masked = mask_findings(screening.points, screening.findings)
    labels = [label for label, points in masked.items() if np.isfinite(points).any()]
    unknown = check_unaliased_axes({label: masked[label] for label in labels}, recording, layout)
    axes = dict.fromkeys(unknown, "no known label of the body shows this axis, or the body turns")
    findings = []
    for finding in screening.findings:
        names: tuple[str, ...] = ()
        if finding.outcome == LEFT_OUT:
            # Two frames: all labels are seen in the first, all but the finding's markers in the second.
            frames = {label: np.zeros((2, 3)) for label in labels}
            frames |= {label: np.array([[0.0] * 3, [np.nan] * 3]) for label in finding.markers}
            resolved = resolve_aliases(screening.aliases, frames, {}, {}, "", ()).positions
            names = tuple(name for name, points in resolved.items() if np.isnan(points[1]).any())
        findings.append(replace(finding, concerns=names))
    return quality_sheet(recording, screening.points, findings, screening.unchecked | axes)


def meant_labels(aliases: Mapping[str, Alias | None], labels: Collection[str]) -> dict[str, str]:
    """Return by standard name the first label of its alias that the file has; labels after a rule do not count.

    Parameters
    ----------
    aliases : mapping of str to Alias or None
        Aliases of the layout by standard name.
    labels : collection of str
        Labels of the file.
    """
    meant = {}
    for name, alias in aliases.items():
        choices = alias if isinstance(alias, tuple) else (alias,)
        # A rule names several markers: labels after it do not count.
        named = takewhile(lambda choice: isinstance(choice, str), choices)
        label = next((choice for choice in named if choice in labels), None)
        if isinstance(label, str):
            meant[name] = label
    return meant


def meant_in_rules(
    aliases: Mapping[str, Alias | None], labels: Collection[str], meant: Mapping[str, str]
) -> dict[str, str]:
    """Return label by landmark, for labels named after one side in a rule for the other side.

    Parameters
    ----------
    aliases : mapping of str to Alias or None
        Aliases of the layout by standard name.
    labels : collection of str
        Labels of the file.
    meant : mapping of str to str
        Result of `meant_labels`.
    """
    usual = {label: landmark for landmark, label in landmarks(labels).items()}
    corrected: dict[str, str] = {}
    for name, alias in aliases.items():
        for rule in alias if isinstance(alias, tuple) else (alias,):
            # Labels that the rule names directly.
            parts = {MeanOfMarkers: "mean", PointBetween: "between"}.get(type(rule))
            named = getattr(rule, parts) if parts else (rule.start,) if isinstance(rule, OffsetPoint) else ()
            sided = {
                part: usual[part]
                for part in named
                if isinstance(part, str) and usual.get(part, "")[:2] in ("L_", "R_")
            }
            if sided and {name[:2], *(landmark[:2] for landmark in sided.values())} == {"L_", "R_"}:
                for part, landmark in sided.items():
                    mirrored = name[:2] + landmark[2:]
                    if mirrored != landmark and part not in meant.values():
                        corrected[mirrored] = part
    return corrected


def quality_sheet(
    recording: MarkerRecording,
    points: dict[str, np.ndarray],
    findings: Sequence[MarkerFinding],
    unchecked: dict[str, str] | None = None,
) -> QualitySheet:
    """Return the quality report of a recording.

    Parameters
    ----------
    recording : MarkerRecording
        Recording under standard names.
    points : dict of str to numpy.ndarray, shape (n_frames, 3)
        Measured markers by the file's labels in m, before anything was left out.
    findings : sequence of MarkerFinding
        Findings in the recording.
    unchecked : dict of str to str, optional
        Result of `lumbar.lifting.quality.gate.unchecked_properties`.
    """
    gaps = []
    for label, positions in points.items():
        missing = ~np.isfinite(positions).all(axis=1)
        if missing.any():
            longest = max(runs(missing), key=lambda gap: gap.stop - gap.start)
            length = (longest.stop - longest.start) / recording.rate
            start = float(recording.time[longest.start])
            gaps.append(OpenGap(label, float(missing.mean()), length, start))
    return QualitySheet(
        file=recording.source,
        rate_Hz=recording.rate,
        start_s=float(recording.time[0]),
        duration_s=len(recording) / recording.rate,
        n_frames=len(recording),
        markers=tuple(points),
        gaps=tuple(sorted(gaps, key=lambda gap: -gap.longest_s)),
        findings=tuple(findings),
        estimated=dict(recording.derived),
        absent=dict(recording.absent),
        left_out=dict(recording.dropped),
        unused=recording.unused,
        events=recording.events,
        notes=recording.notes,
        unchecked=dict(unchecked or {}),
    )


def quality_table(sheets: Sequence[dict], source_label: str) -> Table:
    """Return a table with one row per recording.

    Parameters
    ----------
    sheets : sequence of dict
        Results of `QualitySheet.to_dict`, with the name of the lift under ``lift``.
    source_label : str
        Source of the recordings, for the table's caption.
    """
    rows = []
    for sheet in sheets:
        findings = [
            f"{finding['kind']} ({finding['outcome']}): {', '.join(finding['markers']) or 'all markers'} "
            f"from {finding['start_s']:.2f} s for {finding['length_s']:.2f} s"
            for finding in sheet["findings"]
        ]
        rows.append(
            {
                "lift": sheet["lift"],
                "file": Path(sheet["file"]).name,
                "markers": len(sheet["markers"]),
                "rate_Hz": float(sheet["rate_Hz"]),
                "duration_s": sheet["duration_s"],
                "missing_percent": 100 * sheet["missing_share"],
                "longest_gap_s": max((gap["longest_s"] for gap in sheet["gaps"]), default=0.0),
                "estimated": ", ".join(sheet["estimated"]) or "none",
                "left_out": sum(finding["outcome"] == LEFT_OUT for finding in sheet["findings"]),
                "findings": "; ".join(findings) or "none",
                "not_checked": ", ".join(sheet["unchecked"]) or "none",
            }
        )
    return table_from_schema("lifting/quality", "quality", rows, source_label)
