"""Reading a marker file through the gate: what cannot be a body becomes a gap, and the reader of the results is told.

A label that alone fills a standard name says what it means; in a rule such as ``L_WRIST: {mean: [RWRA, RWRB]}`` the side
does. So labels that the user has exchanged in the layout's aliases are not reported as exchanged again.
"""

import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.quality.body import check_unaliased_axes
from lumbar.lifting.quality.gate import examine, mask_findings, unchecked_properties, usable_markers
from lumbar.lifting.quality.landmarks import landmarks
from lumbar.lifting.quality.sheet import ERROR, LEFT_OUT, PROPOSED, Finding, QualitySheet, quality_sheet
from lumbar.records.markers import MarkerRecording, Mend, read_markers
from lumbar.settings.layout import Alias, MarkerLayout, MeanOfMarkers, OffsetPoint, PointBetween


@dataclass
class Screening:
    """A screen for `lumbar.records.markers.read_markers` that keeps what it found."""

    height_m: float | None = None
    """Stature of the person."""
    aliases: Mapping[str, Alias | None] = field(default_factory=dict)
    """Of the layout: what the laboratory's labels mean."""
    refuse: bool = True
    """Raise for findings that are errors; otherwise they are only kept."""
    findings: list[Finding] = field(default_factory=list)
    """Of the file read last."""
    points: dict[str, np.ndarray] = field(default_factory=dict)
    """Shape (n_frames, 3): its measured markers by label, as they were before anything was left out."""
    unchecked: dict[str, str] = field(default_factory=dict)
    """What could not be compared with a body, with the reason."""

    def __call__(
        self, points: dict[str, np.ndarray], time: np.ndarray, rate: float
    ) -> tuple[dict[str, np.ndarray], dict[str, str]]:
        """Return the points without what the findings leave out, and why a marker is left out altogether."""
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
        """Raise `InputError` where a finding is an error."""
        errors = [finding for finding in self.findings if finding.outcome == ERROR]
        if errors:
            raise InputError("; ".join(map(str, errors)))


def read_screened(
    path: str | os.PathLike,
    layout: MarkerLayout | None = None,
    name: str | None = None,
    height_m: float | None = None,
    mend: Mend | None = None,
) -> tuple[MarkerRecording, QualitySheet]:
    """Read a marker file, leaving out what cannot be a body; with the sheet that says so.

    There are gaps where a marker was left out; one left out altogether is among `MarkerRecording.dropped`.

    Raises
    ------
    InputError
        As `read_markers`; and where the unit or the sides of the whole recording are impossible.
    """
    layout = layout or MarkerLayout()
    screening = Screening(height_m, layout.aliases)
    with naming(path):
        recording = read_markers(path, layout, name=name, screen=screening, mend=mend)
        return recording, sheet_of(recording, screening, layout)


@contextmanager
def naming(path: str | os.PathLike) -> Iterator[None]:
    """Put the file's name before errors that do not begin with it."""
    try:
        yield
    except InputError as error:
        text = str(error)
        raise error if text.startswith(str(path)) else InputError(f"{path}: {text}") from error


def sheet_of(recording: MarkerRecording, screening: Screening, layout: MarkerLayout) -> QualitySheet:
    """Return the sheet of a recording that was read through a screening, after its axes are checked by the body.

    Raises
    ------
    InputError
        For axes that are not those of the body.
    """
    check_unaliased_axes(usable_markers(screening.points, screening.findings), recording, layout)
    return quality_sheet(recording, screening.points, _concerning(screening), screening.unchecked)


def _concerning(screening: Screening) -> list[Finding]:
    """The findings with the standard names whose frames they leave out."""
    kept = mask_findings(screening.points, screening.findings)
    labels = [label for label, points in kept.items() if np.isfinite(points).any()]
    return [
        replace(finding, concerns=_filled_by(finding.markers, labels, screening.aliases))
        if finding.outcome in (LEFT_OUT, PROPOSED)
        else finding
        for finding in screening.findings
    ]


def _filled_by(
    markers: Collection[str], labels: Collection[str], aliases: Mapping[str, Alias | None]
) -> tuple[str, ...]:
    """Standard names that are not seen where `markers` are not."""
    from lumbar.records.marker_aliases import resolve_aliases

    # Two frames: all labels are seen in the first, all but the markers in the second.
    points = {label: np.zeros((2, 3)) for label in labels}
    for label in markers:
        points[label] = np.array([[0.0] * 3, [np.nan] * 3])
    resolved = resolve_aliases(aliases, points, {}, {}, "", ())
    return tuple(name for name, positions in resolved.positions.items() if np.isnan(positions[1]).any())


def meant_labels(aliases: Mapping[str, Alias | None], labels: Collection[str]) -> dict[str, str]:
    """Return, by standard name, the label of the file that alone fills an alias."""
    meant = {}
    for name, alias in aliases.items():
        for choice in alias if isinstance(alias, tuple) else (alias,):
            if not isinstance(choice, str):
                break  # a rule: no one marker
            if choice in labels:
                meant[name] = choice
                break
    return meant


def meant_in_rules(
    aliases: Mapping[str, Alias | None], labels: Collection[str], meant: Mapping[str, str]
) -> dict[str, str]:
    """Return, by landmark, the labels in rules of the other side; `meant` is the result of `meant_labels`."""
    usual = {label: landmark for landmark, label in landmarks(labels).items()}
    found: dict[str, str] = {}
    for name, alias in aliases.items():
        for rule in alias if isinstance(alias, tuple) else (alias,):
            sided = {part: usual[part] for part in _parts(rule) if usual.get(part, "")[:2] in ("L_", "R_")}
            if sided and {name[:2], *(landmark[:2] for landmark in sided.values())} == {"L_", "R_"}:
                mirrored = {part: name[:2] + landmark[2:] for part, landmark in sided.items()}
                found |= {
                    landmark: part
                    for part, landmark in mirrored.items()
                    if landmark != usual[part] and part not in meant.values()
                }
    return found


def _parts(rule: Alias | None) -> list[str]:
    """Labels that a rule names directly."""
    if isinstance(rule, MeanOfMarkers):
        parts = rule.mean
    elif isinstance(rule, PointBetween):
        parts = rule.between
    else:
        parts = (rule.start,) if isinstance(rule, OffsetPoint) else ()
    return [part for part in parts if isinstance(part, str)]
