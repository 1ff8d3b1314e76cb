"""Differences between groups of people: all measures of a study."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from lumbar.lifting.measures.lift_values import print_measure
from lumbar.publishing.figures.style import DOUBLE_COLUMN, house_style, new_figure

if TYPE_CHECKING:
    from lumbar.lifting.measures.compare_groups import GroupComparison

FIRST, SECOND, UNDECIDED = "#0072B2", "#D55E00", "#8c8c8c"
_MARKERS = ("o", "s", "D", "^", "v")
MAX_ROWS = 36
"""The table has all rows."""


@house_style
def group_comparison_figure(comparisons: Sequence[GroupComparison], groups: tuple[str, str]) -> Figure:
    """Draw the differences between two groups in standard deviations between people, with the safer group's side.

    Only comparisons between the groups are drawn.
    """
    between = [item for item in comparisons if not item.paired]
    boxes = list(dict.fromkeys(item.box for item in between))
    known = [item for item in between if not item.difference.remark]
    rows, hidden = _sorted_rows(known)
    figure, axes = new_figure(DOUBLE_COLUMN, 1.5 + 0.19 * max(len(rows), 4))
    height = {row: -number for number, row in enumerate(rows)}
    offsets = 0.5 * (np.arange(len(boxes)) - (len(boxes) - 1) / 2) / max(len(boxes), 2)
    for item in known:
        box = boxes.index(item.box)
        if (item.measure, item.plane) in height:
            place = height[item.measure, item.plane] - offsets[box]
            _draw(axes, item, place, _MARKERS[box % len(_MARKERS)])
    axes.axvline(0, color="black", linewidth=0.8)
    labels = [name if plane in ("all", "") else f"{name}, {plane}" for name, plane in rows]
    axes.set_yticks([height[row] for row in rows], list(map(print_measure, labels)))
    axes.set_ylim(-len(rows) + 0.4, 0.6)
    limit = 1.05 * min(max([1.0, *(np.abs(_effect(item)).max() for item in known)]), 6.0)
    axes.set_xlim(-limit, limit)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("Difference of the groups / standard deviation between people")
    bold = {"transform": axes.transAxes, "fontweight": "bold"}
    axes.text(0.0, 1.01, f"← {groups[1]} safer", color=SECOND, **bold)
    axes.text(1.0, 1.01, f"{groups[0]} safer →", color=FIRST, ha="right", **bold)
    for number, box in enumerate(boxes):
        axes.plot([], [], _MARKERS[number % len(_MARKERS)], color="black", markersize=4, label=f"{box} kg")
    axes.plot([], [], "o", color=UNDECIDED, markersize=4, label="not decided: the 95 % interval contains 0")
    if not all(item.safer for item in known):
        white = {"color": "black", "markerfacecolor": "white", "markersize": 4}
        axes.plot([], [], "o", label="no side is the safer one", **white)
    figure.legend(loc="outside lower left", ncols=2 + len(boxes))
    figure.suptitle(_title(between, known, hidden), fontsize=9)
    return figure


def _sorted_rows(known: Sequence[GroupComparison]) -> tuple[list[tuple[str, str]], int]:
    """Return measures and planes, from the largest effect for the first group to that for the second, and the number hidden.

    Rows without a safer side come last.
    """
    effects: dict[tuple[str, str], list[float]] = {}
    for item in known:
        effects.setdefault((item.measure, item.plane), []).append(_effect(item)[0])
    sided = {(item.measure, item.plane): bool(item.safer) for item in known}
    drawn = sorted(effects, key=lambda row: -np.abs(effects[row]).mean())[:MAX_ROWS]
    ordered = sorted(drawn, key=lambda row: (not sided[row], -np.mean(effects[row])))
    return ordered, len(effects) - len(drawn)


def _effect(item: GroupComparison) -> np.ndarray:
    """Return the difference and its interval in standard deviations, positive if the first group is safer."""
    found, sign = item.difference, -1 if item.safer == "lower" else 1
    return sign * np.array([found.difference, found.low, found.high]) / found.person_sd


def _draw(axes, item: GroupComparison, height: float, marker: str) -> None:
    effect, *ends = _effect(item)
    low, high = sorted(ends)
    colour = UNDECIDED if low <= 0 <= high else FIRST if effect > 0 else SECOND
    if not item.safer and colour != UNDECIDED:
        colour = "black"
    axes.plot([low, high], [height, height], color=colour, linewidth=1.3, solid_capstyle="butt")
    face = colour if item.safer else "white"
    axes.plot(effect, height, marker, color=colour, markerfacecolor=face, markersize=4.2)


def _title(between: Sequence[GroupComparison], known: Sequence[GroupComparison], hidden: int) -> str:
    if not known:
        reason = between[0].difference.remark if between else "the groups have no box in common"
        return f"Nothing can be compared: {reason}"
    persons = " and ".join(
        f"{count} {name}" for count, name in zip(known[0].difference.persons, known[0].sides, strict=True)
    )
    more = f"; {hidden} measures with smaller differences are in the table alone" if hidden else ""
    first, second = known[0].sides
    return f"What tells {first} from {second} lifters? {persons} lifters, 95 % intervals over persons{more}"
