"""Which marker set a file has: the aliases that fit its labels, measured ones first, rules where a landmark lacks."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from lumbar.lifting.quality.landmarks import landmarks
from lumbar.records.marker_aliases import resolve_aliases
from lumbar.records.marker_axes import find_axes
from lumbar.settings.layout import Alias, MeanOfMarkers, OffsetPoint, PointBetween
from lumbar.settings.lifting import ALIASES

if TYPE_CHECKING:
    from lumbar.records.markers import MarkerRecording

_BOX = re.compile(r"box|bo[iî]te|crate|kiste|caisse|load", re.IGNORECASE)
RULES: dict[str, tuple[tuple[Alias, str], ...]] = {
    "L_WRIST": ((MeanOfMarkers(("LWRR", "LWRU")), ""), (MeanOfMarkers(("L_RSP", "L_UHE")), "")),
    "R_WRIST": (
        (MeanOfMarkers(("RWRR", "RWRU")), ""),
        (MeanOfMarkers(("R_RSP", "R_UHE")), ""),
        ("WRIST", ""),
    ),
    "SACRUM": ((MeanOfMarkers(("L_PSIS", "R_PSIS")), "midpoint of the PSIS"),),
    "C7": (
        (PointBetween(("T10", "T1"), 1.11), "one vertebra above T1, nine above T10 to T1"),
        ("T1", "T1 lies one vertebra lower"),
    ),
    "T12": (
        (
            PointBetween(("T10", "SACRUM"), 0.263),
            "where it lies in a static trial of an athlete with T6, T12 and both PSIS",
        ),
        (PointBetween(("C7", "SACRUM"), 0.71), "where it lies in a static trial of an athlete"),
    ),
    "L5": (
        (PointBetween(("T12", "SACRUM"), 0.65), "four and a half of seven levels from T12 to S2, assumed"),
    ),
}
"""Further ways to a landmark, the best first, each with what it rests on where the landmark is not measured."""
REASONS = {(name, term): reason for name, ways in RULES.items() for term, reason in ways if reason}
NOTES = dict.fromkeys(
    [("XIPHOID", "STRN")],
    "the xiphoid in Plug-in Gait, higher on the sternum in other marker sets: compare with a picture",
)
"""What is to be known of a label that means one thing in one marker set and another in the next."""
NEEDED = {
    "C7": "the thorax needs it",
    "T12": "thorax and abdomen need it",
    "L5": "abdomen and pelvis need it",
    **dict.fromkeys(("SACRUM", "L_ASIS", "R_ASIS"), "the joint centres need it"),
    **dict.fromkeys(("L_ANKLE", "R_ANKLE"), "the pivot mid_ankle needs it"),
    **dict.fromkeys(("L_TOE", "R_TOE"), "the toe-off needs it"),
}
"""Landmarks that are asked for where they are not recognised, with what needs them."""
_THIGH = ("LHIP", "RHIP")
"""Labels that some laboratories give to markers on the thigh."""


@dataclass(frozen=True)
class MarkerSet:
    """What is recognised in one file."""

    aliases: dict[str, Alias]
    """Standard name to the label or rule that fills it."""
    axes: tuple[str, str, float] | None
    """Of `lumbar.records.marker_axes.find_axes`."""


def marker_set(recording: MarkerRecording) -> MarkerSet:
    """Recognise the markers of a file, read with its own labels, subject prefixes among them, and in its own axes."""
    box = [_bare(label) for label in recording.positions if _BOX.search(label)]
    points = {_bare(label): values for label, values in recording.positions.items()}
    known = {name: label for name, label in landmarks(points).items() if label not in (*_THIGH, *box)}
    aliases: dict[str, Alias] = {}
    for name in (*ALIASES, *known):
        if name in aliases or name.startswith("BOX_"):
            continue
        ways = [*_alternatives(ALIASES.get(name)), *([known[name]] if name in known else [])]
        ways = [*[way for way, _ in RULES.get(name, ()) if (name, way) not in REASONS], *ways]
        ways += [way for way, _ in RULES.get(name, ()) if (name, way) in REASONS]
        term = next((way for way in ways if _fills(way, points, aliases)), None)
        if term is not None:
            aliases[name] = term
    aliases |= _derived(aliases, points)
    aliases |= {f"BOX_{number}": label for number, label in enumerate(box, start=1)}
    # Labels that are landmarks but no standard names stay labels.
    aliases = {name: term for name, term in aliases.items() if name in ALIASES or name.startswith("BOX_")}
    found = resolve_aliases(aliases, points, {}, {}, recording.source, [])
    return MarkerSet(aliases, find_axes(found.positions))


def _derived(aliases: dict[str, Alias], points: Iterable[str]) -> dict[str, Alias]:
    """Landmarks that others give, each after those it is derived from."""
    found: dict[str, Alias] = {}
    for name in ("SACRUM", "C7", "T12", "L5"):
        if name in aliases:
            continue
        term = next((way for way, _ in RULES[name] if _fills(way, points, {**aliases, **found})), None)
        if term is not None:
            found[name] = term
    return found


def _bare(label: str) -> str:
    return label.rpartition(":")[2]


def _alternatives(alias: Alias | None) -> tuple:
    if alias is None:
        return ()
    return alias if isinstance(alias, tuple) else (alias,)


def _fills(term: Alias, points: Iterable[str], aliases: dict[str, Alias]) -> bool:
    """Whether every marker that a term needs is there."""
    if isinstance(term, str):
        return term in points or term in aliases
    if isinstance(term, tuple):
        return any(_fills(part, points, aliases) for part in term)
    if isinstance(term, OffsetPoint):
        return _fills(term.start, points, aliases)
    parts = term.mean if isinstance(term, MeanOfMarkers) else term.between
    return all(_fills(part, points, aliases) for part in parts)


def joined_aliases(sets: Sequence[MarkerSet]) -> dict[str, tuple]:
    """Aliases of several files: every way that one of them needs, the best first, whichever file was read first."""
    joined: dict[str, dict] = {}
    for item in sets:
        for name, term in item.aliases.items():
            joined.setdefault(name, {})[term] = None
    return {name: tuple(sorted(terms, key=partial(_rank, name))) for name, terms in joined.items()}


def _rank(name: str, term: Alias) -> tuple[int, int]:
    """Order of the ways to a landmark: measured as a rule or label of the table, by another label, by a guess."""
    rules = [way for way, _ in RULES.get(name, ())]
    usual = _alternatives(ALIASES.get(name))
    if (name, term) in REASONS:
        return 3, rules.index(term)
    if term in rules:
        return 0, rules.index(term)
    return (1, usual.index(term)) if term in usual else (2, 0)


def alias_text(term: Alias) -> str:
    """An alias as YAML has it on one line.

    Examples
    --------
    >>> alias_text(("SACR", MeanOfMarkers(("LPSI", "RPSI"))))
    '[SACR, {mean: [LPSI, RPSI]}]'
    """
    if isinstance(term, str):
        # Words such as NO and ON are no text to YAML.
        plain = re.fullmatch(r"[A-Za-z_]\w+", term) and term.lower() not in ("no", "on", "off", "yes", "null")
        return term if plain else json.dumps(term, ensure_ascii=False)
    if isinstance(term, tuple):
        return f"[{', '.join(map(alias_text, term))}]"
    if isinstance(term, MeanOfMarkers):
        return f"{{mean: [{', '.join(map(alias_text, term.mean))}]}}"
    if isinstance(term, OffsetPoint):
        return f"{{from: {alias_text(term.start)}, offset_m: {list(term.offset_m)}}}"
    return f"{{between: [{', '.join(map(alias_text, term.between))}], share: {term.share:g}}}"
