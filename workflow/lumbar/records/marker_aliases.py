"""Standard marker names from the labels of a file: subject prefixes and the alias table of a laboratory.

An alias is

- a label of the file, or the name of another alias: ``R_TOE: RTOE``
- a list of alternatives; the first one in the file is used: ``C7: [C7, CV7]``
- the mean of several: ``L_WRIST: {mean: [LWRA, LWRB]}``
- a point on the line between two, as a share of the distance: ``T12: {between: [C7, SACRUM], share: 0.66}``
- a point at a fixed offset (metres; lateral, forward, up): ``L5: {from: SACRUM, offset_m: [0, 0.06, 0.02]}``

A single name or a name in a list is first a label of the file, then another alias. In a rule the order is reversed:
``{mean: [L_HIP, R_HIP]}`` uses the aliases L_HIP and R_HIP. All points that are not measured are listed with their rule.
"""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.marker_file import MarkerFile
from lumbar.settings.layout import Alias, MeanOfMarkers, PointBetween

KEEP, STRIP = "keep", "strip"
_MAX_LISTED = 60


@dataclass(frozen=True)
class ResolvedMarkers:
    """Markers with standard names; `lumbar.records.markers.MarkerRecording` explains the fields."""

    positions: dict[str, np.ndarray]
    derived: dict[str, str]
    absent: dict[str, str]
    unused: tuple[str, ...]


class _UnresolvedError(Exception):
    """Error for an alias, or part of an alias, that is not in the file; its text is the reason."""


def select_subject(file: MarkerFile, prefix: str) -> MarkerFile:
    """Remove subject prefixes (``Subject:C7``) from the labels of a file.

    Parameters
    ----------
    file : MarkerFile
        The file.
    prefix : str
        ``"strip"`` removes every prefix, ``"keep"`` none; a subject's name only its prefix, so that equal labels of two
        subjects stay distinct.

    Raises
    ------
    InputError
        If two subjects have the same label, or no label has the prefix.
    """
    subjects = file.subjects
    if prefix == KEEP or (prefix == STRIP and not subjects):
        return file
    if prefix != STRIP and prefix not in subjects:
        raise InputError(
            f"{file.source}: no label has the prefix {prefix + ':'!r}; "
            f"markers.subject_prefix may be {', '.join((STRIP, KEEP, *subjects))}"
        )
    chosen = subjects if prefix == STRIP else [prefix]

    def strip(label: str) -> str:
        subject, colon, rest = label.partition(":")
        return rest if colon and subject in chosen else label

    def duplicates(names: list[str]) -> list[str]:
        return sorted({name for name in names if names.count(name) > 1})

    names, computed = list(map(strip, file.positions)), list(map(strip, file.model_points))
    if shared := duplicates(names):
        raise InputError(
            f"{file.source}: {', '.join(shared)}: labels of several subjects; set markers.subject_prefix to one of "
            f"{', '.join(subjects)}"
        )
    ambiguous = duplicates(computed)
    dropped = {strip(label): reason for label, reason in file.dropped.items() if strip(label) not in names}
    dropped |= dict.fromkeys(ambiguous, "computed for several subjects")
    model_points = dict(zip(computed, file.model_points.values(), strict=True))
    return replace(
        file,
        positions=dict(zip(names, file.positions.values(), strict=True)),
        model_points={name: points for name, points in model_points.items() if name not in ambiguous},
        dropped=dropped,
    )


def labels_of(name: str, aliases: Mapping[str, Alias | None]) -> tuple[str, ...]:
    """Return the labels from which a standard name may come: the name itself, and all labels in its alias.

    Parameters
    ----------
    name : str
        Standard name.
    aliases : dict of str to Alias
        Alias by standard name, or None for none.

    Examples
    --------
    >>> labels_of("SACRUM", {"SACRUM": ("SACR", MeanOfMarkers(mean=("LPSI", "RPSI")))})
    ('SACRUM', 'SACR', 'LPSI', 'RPSI')
    """
    labels: list[str] = []

    def visit(term) -> None:
        if isinstance(term, MeanOfMarkers):
            term = term.mean
        if isinstance(term, tuple):
            for part in term:
                visit(part)
        elif isinstance(term, str) and term not in labels:
            labels.append(term)
            visit(aliases.get(term))

    visit(name)
    return tuple(labels)


def resolve_aliases(
    aliases: Mapping[str, Alias | None],
    points: dict[str, np.ndarray],
    model_points: dict[str, np.ndarray],
    dropped: dict[str, str],
    source: str,
    required: Sequence[str] | None = None,
) -> ResolvedMarkers:
    """Resolve every alias with the markers of a file.

    Parameters
    ----------
    aliases : dict of str to Alias
        Alias by standard name, or None for none; see the module's description. Empty: every marker keeps its label.
    points, model_points : dict of str to ndarray, shape (n_frames, 3)
        Markers and computed points by label; metres, standard axes.
    dropped : dict of str to str
        Other labels of the file with the reason why they are not markers.
    source : str
        The file, for messages.
    required : list of str, optional
        Required names; default every alias.

    Raises
    ------
    InputError
        If required names are missing, with all names that are not in the file, similar labels, and the labels of the file.
    """
    aliases = {name: alias for name, alias in aliases.items() if alias is not None}
    required = list(aliases or points) if required is None else required
    if not aliases:
        missing = [name for name in required if name not in points]
        _raise_unresolved(dict.fromkeys(missing, "no such label, and no aliases"), points, source)
        return ResolvedMarkers(dict(points), {}, {}, ())
    unknown = [name for name in required if name not in aliases]
    if unknown:
        raise InputError(f"markers.required names {', '.join(unknown)}; there are {', '.join(aliases)}")
    resolver = _Resolver(aliases, points, model_points, dropped)
    positions, derived, absent = {}, {}, {}
    for name in aliases:
        try:
            values, rule = resolver.resolve_alias(name)
        except _UnresolvedError as reason:
            absent[name] = str(reason)
            continue
        if np.isnan(values).all():
            absent[name] = f"never seen: {rule}"
            continue
        positions[name] = values
        if rule:
            derived[name] = rule
    _raise_unresolved({name: absent[name] for name in required if name in absent}, points, source)
    unused = tuple(label for label in points if label not in resolver.used)
    return ResolvedMarkers(positions, derived, absent, unused)


def _raise_unresolved(unresolved: dict[str, str], points: dict[str, np.ndarray], source: str) -> None:
    """Raise with all unresolved names and the reasons, if there are any."""
    problems = Problems(source)
    for name, reason in unresolved.items():
        # Laboratories' labels differ most often in case and underscores.
        spellings = {label.lower().replace("_", ""): label for label in points}
        close = difflib.get_close_matches(name.lower().replace("_", ""), spellings, n=3, cutoff=0.5)
        hint = f"similar in the file: {', '.join(spellings[label] for label in close)}" if close else ""
        problems.add(f"markers.aliases.{name}", reason, hint)
    if unresolved:
        more = f" and {len(points) - _MAX_LISTED} more" if len(points) > _MAX_LISTED else ""
        problems.add("", f"markers of the file: {', '.join(list(points)[:_MAX_LISTED])}{more}")
    problems.raise_if_any()


class _Resolver:
    """Recursive resolver of aliases; an alias that refers to itself can only be a label."""

    def __init__(self, aliases, points, model_points, dropped):
        self.aliases, self.points, self.model_points, self.dropped = aliases, points, model_points, dropped
        self.used: set[str] = set()
        self.open: list[str] = []

    def resolve_alias(self, name: str) -> tuple[np.ndarray, str]:
        """Return the positions of an alias and its rule; the rule is empty for a measured marker."""
        self.open.append(name)
        try:
            return self.resolve(self.aliases[name])
        finally:
            self.open.pop()

    def resolve(self, term) -> tuple[np.ndarray, str]:
        """Return the positions of a label, of the first possible alternative, or of a rule."""
        if isinstance(term, str):
            return self.resolve_label(term)
        if isinstance(term, tuple):
            reasons = []
            for alternative in term:
                try:
                    return self.resolve(alternative)
                except _UnresolvedError as reason:
                    reasons.append(str(reason))
            raise _UnresolvedError("; ".join(reasons) or "the list of labels is empty")
        if isinstance(term, MeanOfMarkers):
            values = np.mean([self.resolve_part(part) for part in term.mean], axis=0)
        elif isinstance(term, PointBetween):
            first, last = (self.resolve_part(part) for part in term.between)
            values = first + term.share * (last - first)
        else:
            values = self.resolve_part(term.start) + np.array(term.offset_m)
        return values, _describe(term)

    def resolve_part(self, term) -> np.ndarray:
        """Return the positions of a part of a rule."""
        if isinstance(term, str) and term in self.aliases and term not in self.open:
            return self.resolve_alias(term)[0]
        return self.resolve(term)[0]

    def resolve_label(self, label: str) -> tuple[np.ndarray, str]:
        if label in self.points:
            self.used.add(label)
            return self.points[label], ""
        if label in self.aliases and label not in self.open:
            return self.resolve_alias(label)
        if label in self.model_points:
            return self.model_points[label], f"{label}: {self.dropped[label]}"
        if label in self.dropped:
            raise _UnresolvedError(f"{label} is left out: {self.dropped[label]}")
        raise _UnresolvedError(f"no {label} in the file")


def _describe(term) -> str:
    """Return the text of an alias, for messages."""
    if isinstance(term, str):
        return term
    if isinstance(term, tuple):
        return " or ".join(map(_describe, term))
    if isinstance(term, MeanOfMarkers):
        return f"mean of {' and '.join(map(_describe, term.mean))}"
    if isinstance(term, PointBetween):
        start, end = map(_describe, term.between)
        return f"{term.share:g} of the way from {start} to {end}"
    offset = ", ".join(f"{value:g}" for value in term.offset_m)
    return f"{_describe(term.start)}, moved by ({offset}) m to the right, forward and up"
