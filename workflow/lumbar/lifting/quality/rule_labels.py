"""What labels inside the rules of a layout stand for, where somebody has let two of them change places.

A label that alone fills a standard name says what it means. One inside a rule does not; but ``T12: {between: [T1, SACRUM],
share: 0.26}`` can only be meant of a marker at T10: the rule's level along the trunk, and its side, tell.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from lumbar.lifting.quality.landmarks import landmarks, level
from lumbar.settings.layout import Alias, MeanOfMarkers, OffsetPoint, PointBetween

_CLEAR = 0.3
"""Fall of the misfit of all rules, in lengths of the trunk, from which labels are taken for exchanged on purpose."""


def meant_in_rules(
    aliases: Mapping[str, Alias | None], labels: Collection[str], meant: Mapping[str, str]
) -> dict[str, str]:
    """Return, by landmark, the labels inside rules that stand for another landmark than usual.

    Parameters
    ----------
    aliases : mapping of str to Alias
        Of the layout.
    labels : collection of str
        Of the file.
    meant : mapping of str to str
        Standard name to the label that alone fills it.
    """
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
        if not best or _misfit(aliases, means | best) > _misfit(aliases, means) - _CLEAR:
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
