"""Reading a marker file through the gate: what cannot be a body becomes a gap, and the reader of the results is told."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.quality.axes import check_unaliased_axes
from lumbar.lifting.quality.finding import ERROR, LEFT_OUT, PROPOSED, Finding
from lumbar.lifting.quality.gate import examine, hidden, unchecked, usable
from lumbar.lifting.quality.rule_labels import meant_in_rules
from lumbar.lifting.quality.sheet import QualitySheet, quality_sheet
from lumbar.records.markers import MarkerRecording, Mend, read_markers
from lumbar.settings.layout import Alias, MarkerLayout


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
        self.unchecked = unchecked(points, self.height_m, meant)
        errors = [finding for finding in self.findings if finding.outcome == ERROR]
        if errors and self.refuse:
            raise InputError("; ".join(map(str, errors)))
        screened = hidden(points, self.findings)
        left_out = {
            label: f"{finding.kind} in all frames"
            for finding in self.findings
            for label in finding.markers
            if np.isnan(screened[label]).all()
        }
        return screened, left_out


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


def read_screened(
    path: str | os.PathLike,
    layout: MarkerLayout | None = None,
    name: str | None = None,
    height_m: float | None = None,
    mend: Mend | None = None,
) -> tuple[MarkerRecording, QualitySheet]:
    """Read a marker file, leaving out what cannot be a body.

    Parameters
    ----------
    path : path
    height_m : float, optional
        Stature of the person.
    mend : callable, optional
        As of `read_markers`: mends what is left.

    Returns
    -------
    recording : MarkerRecording
        Gaps where a marker was left out; one left out altogether is among `MarkerRecording.dropped`.
    sheet : QualitySheet

    Raises
    ------
    InputError
        As `read_markers`; and where the unit, the rate or the sides of the whole recording are impossible.
    """
    screening = Screening(height_m, layout.aliases if layout else {})
    try:
        recording = read_markers(path, layout, name=name, screen=screening, mend=mend)
        sound = usable(screening.points, screening.findings)
        check_unaliased_axes(sound, recording, layout or MarkerLayout())
    except InputError as error:
        text = str(error)
        raise error if text.startswith(str(path)) else InputError(f"{path}: {text}") from error
    return recording, quality_sheet(recording, screening.points, _concerning(screening), screening.unchecked)


def _concerning(screening: Screening) -> list[Finding]:
    """The findings with the standard names whose frames they leave out."""
    kept = hidden(screening.points, screening.findings)
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
