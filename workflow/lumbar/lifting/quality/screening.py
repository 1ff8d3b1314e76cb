"""Reading a marker file through the gate: what cannot be a body becomes a gap, and the reader of the results is told.

A label that alone fills a standard name says what it means. One inside a rule does not; but ``T12: {between: [T1, SACRUM],
share: 0.26}`` can only be meant of a marker at T10: the rule's level along the trunk, and its side, tell. So labels that
somebody has let change places in the layout's aliases are not called exchanged again.
"""

import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality.body import check_unaliased_axes
from lumbar.lifting.quality.gate import examine, mask_findings, unchecked_properties, usable_markers
from lumbar.lifting.quality.landmarks import landmarks, level
from lumbar.lifting.quality.sheet import ERROR, LEFT_OUT, PROPOSED, Finding, QualitySheet, quality_sheet
from lumbar.records.markers import MarkerRecording, Mend, read_markers
from lumbar.settings.layout import Alias, MarkerLayout, MeanOfMarkers, OffsetPoint, PointBetween

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "screening")


@dataclass
class Screening:
    """A screen for `lumbar.records.markers.read_markers` that keeps what it found."""

    height_m: float | None = None
    """Stature of the person."""
    aliases: Mapping[str, Alias | None] = field(default_factory=dict)
    """Of the layout: what the laboratory's labels mean."""
    refuse: bool = True
    """Raise for findings that are errors; otherwise they are only kept."""
    others: Mapping[str, dict[str, np.ndarray]] = field(default_factory=dict)
    """Other trials of the person, as of `lumbar.lifting.quality.other_trials.other_trials`."""
    findings: list[Finding] = field(default_factory=list)
    """Of the file read last."""
    points: dict[str, np.ndarray] = field(default_factory=dict)
    """Shape (n_frames, 3): its measured markers by label, as they were before anything was left out."""
    unchecked: dict[str, str] = field(default_factory=dict)
    """What could not be compared with a body, with the reason."""

    def __call__(
        self, points: dict[str, np.ndarray], time: np.ndarray, rate: float, joints: bool = False
    ) -> tuple[dict[str, np.ndarray], dict[str, str]]:
        """Return the points without what the findings leave out, and why a marker is left out altogether."""
        meant = meant_labels(self.aliases, points)
        meant = meant_in_rules(self.aliases, points, meant) | meant
        others = tuple(self.others.values())
        self.points, self.findings = points, examine(points, time, rate, self.height_m, meant, joints, others)
        self.unchecked = unchecked_properties(points, time, rate, self.height_m, meant, self.findings, others)
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
    others: Mapping[str, dict[str, np.ndarray]] | None = None,
) -> tuple[MarkerRecording, QualitySheet]:
    """Read a marker file, leaving out what cannot be a body; with the sheet that says so.

    There are gaps where a marker was left out; one left out altogether is among `MarkerRecording.dropped`. `others` are other
    trials of the person, as of `lumbar.lifting.quality.other_trials.other_trials`.

    Raises
    ------
    InputError
        As `read_markers`; and where the unit, the rate or the sides of the whole recording are impossible.
    """
    layout = layout or MarkerLayout()
    screening = Screening(height_m, layout.aliases, others=others or {})
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
    return quality_sheet(
        recording, screening.points, _concerning(screening), screening.unchecked, screening.others
    )


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
    """Return, by landmark, the labels inside rules that stand for another landmark than usual; `meant` as of `meant_labels`."""
    usual = {label: landmark for landmark, label in landmarks(labels).items()}
    alone = {label: name for name, label in meant.items()}
    means = {**usual, **alone}
    parts = {label for alias in aliases.values() for label in _labels(alias, aliases, inside=False)}
    inside = sorted(label for label in parts if label in usual and label not in alone)
    others = sorted({*inside, *(label for label in alone if label in usual and alone[label] != usual[label])})
    found: dict[str, str] = {}
    while True:
        trials = [
            {one: usual[other]} | ({other: usual[one]} if other in inside else {})
            for one in inside
            for other in others
            if one != other and not {one, other} & found.keys()
        ]
        best = min(trials, key=lambda trial: _misfit(aliases, means | trial), default={})
        if not best or _misfit(aliases, means | best) > _misfit(aliases, means) - _AT.clear:
            return {landmark: label for label, landmark in found.items()}
        means |= best
        found |= best


def _labels(alias: Alias | None, aliases: Mapping[str, Alias | None], inside: bool) -> list[str]:
    """Labels inside the rules of an alias; names of other aliases are none."""
    if isinstance(alias, str):
        return [alias] if inside and alias not in aliases else []
    if isinstance(alias, tuple):
        return [label for part in alias for label in _labels(part, aliases, inside)]
    return [label for part, _ in _parts(alias) for label in _labels(part, aliases, True)]


def _parts(rule) -> list[tuple[Alias, float]]:
    """Parts of a rule with their shares in its level."""
    if isinstance(rule, MeanOfMarkers):
        return [(part, 1 / len(rule.mean)) for part in rule.mean]
    if isinstance(rule, PointBetween):
        return [(rule.between[0], 1 - rule.share), (rule.between[1], rule.share)]
    return [(rule.start, 1.0)] if isinstance(rule, OffsetPoint) else []


def _misfit(aliases: Mapping[str, Alias | None], means: Mapping[str, str]) -> float:
    """Sum over the rules of the distance between the level of the name and that of its parts, and of parts of the other side."""
    total = 0.0
    for name, alias in aliases.items():
        for rule in alias if isinstance(alias, tuple) else (alias,):
            parts = [(_landmark(part, aliases, means), share) for part, share in _parts(rule)]
            total += sum({name[:2], landmark[:2]} == {"L_", "R_"} for landmark, _ in parts)
            levels = [level(landmark) for landmark, _ in parts]
            if parts and level(name) is not None and None not in levels and not isinstance(rule, OffsetPoint):
                found = sum(height * share for height, (_, share) in zip(levels, parts, strict=True))
                total += abs(found - level(name))
    return total


def _landmark(part: Alias, aliases: Mapping[str, Alias | None], means: Mapping[str, str]) -> str:
    """Landmark of a part of a rule; empty where it is a rule itself, or a label that is not known."""
    if not isinstance(part, str):
        return ""
    return part if part in aliases else means.get(part, "")
