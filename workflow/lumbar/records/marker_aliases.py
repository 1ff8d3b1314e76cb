"""From the labels of a file to standard marker names: subject prefixes and the alias table of a laboratory.

An alias is

- a label of the file, or the name of another alias: ``R_TOE: RTOE``
- a list of alternatives, of which the first that can be resolved is taken: ``C7: [C7, CV7]``
- the mean of several: ``L_WRIST: {mean: [LWRA, LWRB]}``
- a point on the line between two, as a share of the way: ``T12: {between: [C7, SACRUM], share: 0.66}``
- a point at a fixed offset (metres; lateral, forward, up): ``L5: {from: SACRUM, offset_m: [0, 0.06, 0.02]}``

A name that stands alone or in a list is a label of the file before it is another alias. Inside a rule it is
the other way round: ``{mean: [L_HIP, R_HIP]}`` takes what the table calls hips. Everything that is not
measured is listed with its rule, so that results can say so.
"""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.marker_file import MarkerFile
from lumbar.settings.layout import Alias, MeanOfMarkers, PointBetween, Rule

KEEP, STRIP = "keep", "strip"
_LISTED = 60


@dataclass(frozen=True)
class ResolvedMarkers:
    """Markers under standard names; `lumbar.records.markers.MarkerRecording` explains the fields."""

    positions: dict[str, np.ndarray]
    derived: dict[str, str]
    absent: dict[str, str]
    unused: tuple[str, ...]


class _Unresolved(Exception):
    """An alias, or a part of one, that the file cannot fill; the text says why."""


def select_subject(file: MarkerFile, prefix: str) -> MarkerFile:
    """Take subject prefixes (``Subject:C7``) off the labels of a file.

    Parameters
    ----------
    prefix : str
        ``"strip"`` takes every prefix off, ``"keep"`` none; a subject's name takes off that one alone, so
        that equal labels of two subjects stay apart.

    Raises
    ------
    InputError
        When two subjects have the same label, or no label has the prefix named.
    """
    subjects = file.subjects
    if prefix == KEEP or (prefix == STRIP and not subjects):
        return file
    if prefix != STRIP and prefix not in subjects:
        raise InputError(
            f"{file.source}: no label has the prefix {prefix + ':'!r}; "
            "markers.subject_prefix may be strip, keep" + "".join(f", {subject}" for subject in subjects)
        )
    chosen = subjects if prefix == STRIP else [prefix]

    def bare(label: str) -> str:
        subject, colon, rest = label.partition(":")
        return rest if colon and subject in chosen else label

    names = [bare(label) for label in file.positions]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"{file.source}: {', '.join(twice)} stand{'s' if len(twice) == 1 else ''} for several subjects; "
            f"set markers.subject_prefix to one of {', '.join(subjects)}"
        )
    dropped = {bare(label): reason for label, reason in file.dropped.items() if bare(label) not in names}
    computed = [bare(label) for label in file.model_points]
    ambiguous = {name for name in computed if computed.count(name) > 1}
    dropped.update(dict.fromkeys(ambiguous, "computed for several subjects"))
    return replace(
        file,
        positions=dict(zip(names, file.positions.values(), strict=True)),
        model_points={
            name: points
            for name, points in zip(computed, file.model_points.values(), strict=True)
            if name not in ambiguous
        },
        dropped=dropped,
    )


def labels_of(name: str, aliases: Mapping[str, Alias | None]) -> tuple[str, ...]:
    """Labels that a name may be filled from: its own, and all those in its alias.

    Examples
    --------
    >>> labels_of("SACRUM", {"SACRUM": ("SACR", MeanOfMarkers(mean=("LPSI", "RPSI")))})
    ('SACRUM', 'SACR', 'LPSI', 'RPSI')
    """
    found: list[str] = []

    def visit(term) -> None:
        if isinstance(term, str):
            if term not in found:
                found.append(term)
                visit(aliases.get(term))
        elif isinstance(term, tuple):
            for part in term:
                visit(part)
        elif isinstance(term, MeanOfMarkers):
            visit(term.mean)

    visit(name)
    return tuple(found)


def resolve_aliases(
    aliases: Mapping[str, Alias | None],
    points: dict[str, np.ndarray],
    model_points: dict[str, np.ndarray],
    dropped: dict[str, str],
    source: str,
    required: Sequence[str] | None = None,
) -> ResolvedMarkers:
    """Fill every alias from the markers of a file.

    Parameters
    ----------
    aliases : dict of str to Alias
        Standard name to alias, or None for none; see the module's description. Empty: every marker keeps its label.
    points, model_points : dict of str to ndarray, shape (n_frames, 3)
        Markers and computed points by label; metres, standard axes.
    required : list of str, optional
        Names without which the recording is of no use. Default: every alias.

    Raises
    ------
    InputError
        All required names that cannot be filled, each with labels that look alike, and the labels of the
        file.
    """
    aliases = {name: alias for name, alias in aliases.items() if alias is not None}
    required = list(aliases or points) if required is None else required
    if not aliases:
        missing = [name for name in required if name not in points]
        if missing:
            _raise_unresolved(dict.fromkeys(missing, "no such label, and no aliases"), points, source)
        return ResolvedMarkers(dict(points), {}, {}, ())
    unknown = [name for name in required if name not in aliases]
    if unknown:
        raise InputError(
            f"markers.required names {', '.join(unknown)}; markers.aliases has {', '.join(aliases)}"
        )
    resolver = _Resolver(aliases, points, model_points, dropped)
    positions, derived, absent = {}, {}, {}
    for name in aliases:
        try:
            positions[name], rule = resolver.alias(name)
        except _Unresolved as reason:
            absent[name] = str(reason)
            continue
        if np.isnan(positions[name]).all():
            del positions[name]
            absent[name] = f"never seen: {rule}"
        elif rule:
            derived[name] = rule
    _raise_unresolved({name: absent[name] for name in required if name in absent}, points, source)
    unused = tuple(label for label in points if label not in resolver.used)
    return ResolvedMarkers(positions, derived, absent, unused)


def _raise_unresolved(unresolved: dict[str, str], points: dict[str, np.ndarray], source: str) -> None:
    problems = Problems(source)
    for name, reason in unresolved.items():
        # The labels a laboratory uses differ in case and underscores first of all.
        folded = {label.lower().replace("_", ""): label for label in points}
        close = difflib.get_close_matches(name.lower().replace("_", ""), folded, n=3, cutoff=0.5)
        hint = f"like it in the file: {', '.join(folded[label] for label in close)}" if close else ""
        problems.add(f"markers.aliases.{name}", reason, hint)
    if unresolved:
        more = f" and {len(points) - _LISTED} more" if len(points) > _LISTED else ""
        problems.add("", f"markers of the file: {', '.join(list(points)[:_LISTED])}{more}")
    problems.raise_if_any()


class _Resolver:
    """Fills aliases recursively; an alias that leads back to itself can only mean a label."""

    def __init__(self, aliases, points, model_points, dropped):
        self.aliases, self.points, self.model_points, self.dropped = aliases, points, model_points, dropped
        self.used: set[str] = set()
        self.open: list[str] = []

    def alias(self, name: str) -> tuple[np.ndarray, str]:
        """Positions of an alias and the rule they follow; the rule is empty for a measured marker."""
        self.open.append(name)
        try:
            return self.term(self.aliases[name])
        finally:
            self.open.pop()

    def term(self, term) -> tuple[np.ndarray, str]:
        if isinstance(term, str):
            return self.label(term)
        return self.first(term) if isinstance(term, tuple) else self.rule(term)

    def part(self, term) -> np.ndarray:
        """Positions of a part of a rule."""
        if isinstance(term, str) and term in self.aliases and term not in self.open:
            return self.alias(term)[0]
        return self.term(term)[0]

    def label(self, label: str) -> tuple[np.ndarray, str]:
        if label in self.points:
            self.used.add(label)
            return self.points[label], ""
        if label in self.aliases and label not in self.open:
            return self.alias(label)
        if label in self.model_points:
            return self.model_points[label], f"{label}: {self.dropped[label]}"
        if label in self.dropped:
            raise _Unresolved(f"{label} is left out: {self.dropped[label]}")
        raise _Unresolved(f"no {label} in the file")

    def first(self, alternatives: tuple) -> tuple[np.ndarray, str]:
        reasons = []
        for alternative in alternatives:
            try:
                return self.term(alternative)
            except _Unresolved as reason:
                reasons.append(str(reason))
        raise _Unresolved("; ".join(reasons))

    def rule(self, rule: Rule) -> tuple[np.ndarray, str]:
        if isinstance(rule, MeanOfMarkers):
            return np.mean([self.part(part) for part in rule.mean], axis=0), _described(rule)
        if isinstance(rule, PointBetween):
            first, last = (self.part(part) for part in rule.between)
            return first + rule.share * (last - first), _described(rule)
        return self.part(rule.start) + np.array(rule.offset_m), _described(rule)


def _described(term) -> str:
    """Put an alias in words."""
    if isinstance(term, str):
        return term
    if isinstance(term, tuple):
        return " or ".join(map(_described, term))
    if isinstance(term, MeanOfMarkers):
        return f"mean of {' and '.join(map(_described, term.mean))}"
    if isinstance(term, PointBetween):
        start, end = map(_described, term.between)
        return f"{term.share:g} of the way from {start} to {end}"
    offset = ", ".join(f"{value:g}" for value in term.offset_m)
    return f"{_described(term.start)}, moved by ({offset}) m to the right, forward and up"
