"""Which marker set a file has: the aliases that fit its labels, measured ones first, rules where a landmark lacks."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.yaml_file import shipped_yaml
from lumbar.lifting.quality.body import THIGH, landmarks
from lumbar.records.marker_aliases import resolve_aliases
from lumbar.records.marker_axes import find_axes
from lumbar.settings.layout import Alias, MarkerLayout, MeanOfMarkers, OffsetPoint
from lumbar.settings.lifting import ALIASES

if TYPE_CHECKING:
    from lumbar.records.markers import MarkerRecording

_BOX = re.compile(r"box|bo[iî]te|crate|kiste|caisse|load", re.IGNORECASE)
_SAID = shipped_yaml(Path(__file__).with_suffix(".yaml"))


def _rules(name: str) -> tuple[tuple[Any, str], ...]:
    said = _SAID["rules"][name]
    ways = (MarkerLayout(aliases={name: item["is"]}).aliases[name] for item in said)
    return tuple((way, item.get("because", "")) for way, item in zip(ways, said, strict=True))


RULES = {name: _rules(name) for name in _SAID["rules"]}
REASONS = {(name, term): reason for name, ways in RULES.items() for term, reason in ways if reason}
NOTES = {(name, label): note for name, labels in _SAID["notes"].items() for label, note in labels.items()}
NEEDED: dict[str, str] = _SAID["needed"]


@dataclass(frozen=True)
class MarkerSet:
    """What is recognised in one file."""

    aliases: dict[str, Alias]
    """Standard name to the label or rule that fills it."""
    axes: tuple[str, str] | None
    """Of `lumbar.records.marker_axes.find_axes`."""
    joints: bool = False
    """Whether the file holds joint centres, and no markers on the skin."""


def marker_set(recording: MarkerRecording) -> MarkerSet:
    """Recognise the markers of a file, read with its own labels, subject prefixes among them, and in its own axes."""
    box = [_bare(label) for label in recording.positions if _BOX.search(label)]
    points = {_bare(label): values for label, values in recording.positions.items()}
    known = {name: label for name, label in landmarks(points).items() if label not in (*THIGH, *box)}
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
    return MarkerSet(aliases, find_axes(found.positions), recording.joints)


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
    >>> alias_text(("SACR", MeanOfMarkers(mean=("LPSI", "RPSI"))))
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
