"""Figures of groups of subjects: differences of all measures, and the ratings of the survey."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import matplotlib.colors as colours
import numpy as np
from matplotlib.figure import Figure

from lumbar.lifting.measures.lift_values import print_measure
from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MODELS,
    SERIES,
    SINGLE_COLUMN,
    house_style,
    new_figure,
)

if TYPE_CHECKING:
    from lumbar.lifting.measures.compare_groups import GroupComparison


FIRST, SECOND, UNDECIDED = "#0072B2", "#D55E00", "#8c8c8c"
_MARKERS = ("o", "s", "D", "^", "v")
MAX_ROWS = 36
"""Largest number of rows in the figure; the table has all rows."""


@house_style
def group_comparison_figure(comparisons: Sequence[GroupComparison], groups: tuple[str, str]) -> Figure:
    """Draw the differences between two groups, in units of the standard deviation between people, and name the safer sides.

    Comparisons of boxes within a group are not drawn.
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
    """Return measures and planes, sorted from effects in favour of the first group to the second, and the number of hidden rows.

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


_DISAGREE, _NEUTRAL, _AGREE = ("#D55E00", "#F0B27A"), "#DDDDDD", ("#7FB8DB", "#0072B2")
_LINE = 105
"""Largest number of characters in one line of a title."""


@house_style
def likert_figure(models: Sequence[str], counts: np.ndarray, labels: Sequence[str], statement: str) -> Figure:
    """Draw diverging bars of the ratings: disagreement to the left of zero, agreement to the right.

    The bar of the middle point of an odd scale is centred on zero.

    `counts` are the numbers of answers, shape (models, points), from the least to the greatest agreement; `labels` names
    the points; `models` names the models, and `statement` is what the participants rated.
    """
    percent = 100 * counts / counts.sum(axis=1, keepdims=True)
    points = counts.shape[1]
    left = -(percent[:, : points // 2].sum(axis=1) + (percent[:, points // 2] / 2 if points % 2 else 0))
    starts = left[:, None] + np.cumsum(percent, axis=1) - percent
    figure, axes = new_figure(height=0.9 + 0.38 * len(models))
    rows = np.arange(len(models))[::-1]
    edge = {"edgecolor": "#333333", "linewidth": 0.4, "height": 0.68}
    on_white = {"facecolor": "white", "edgecolor": "none", "pad": 1.2, "alpha": 0.85}
    for point, look in enumerate(_point_looks(points)):
        widths, lefts, label = percent[:, point], starts[:, point], f"{point + 1} {labels[point]}"
        axes.barh(rows, widths, left=lefts, label=label, **look, **edge)
        for row, start, width, count in zip(rows, lefts, widths, counts[:, point], strict=True):
            if width >= 4:  # narrower bars have no room for a number
                centred = {"ha": "center", "va": "center", "fontsize": 7, "bbox": on_white}
                axes.text(start + width / 2, row, str(count), **centred)
    axes.axvline(0, color="black", linewidth=0.8)
    axes.set_yticks(rows, models)
    axes.grid(axis="y", visible=False)
    axes.set_axisbelow(True)
    limit = 10 * np.ceil(np.abs([left.min(), (left + percent.sum(axis=1)).max()]).max() / 10)
    axes.set_xlim(-limit, limit)
    axes.xaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
    axes.set_xlabel("Share of participants (%), numbers of participants in the bars")
    axes.set_title(textwrap.fill(f"“{statement}”", _LINE), loc="left", style="italic")
    figure.legend(loc="outside upper center", ncols=points, handlelength=1.4, columnspacing=1.2)
    return figure


def _point_looks(points: int) -> list[dict[str, str]]:
    """Return colour and hatch of each point, distinguishable in grey."""
    half = points // 2
    looks = []
    for (first, last), hatches in (
        (_DISAGREE, ["xxx", *["//"] * (half - 1)]),
        (_AGREE, [*[""] * (half - 1), ".."]),
    ):
        start, end = np.array(colours.to_rgb(first)), np.array(colours.to_rgb(last))
        ramp = [colours.to_hex(start + (end - start) * share) for share in np.linspace(0, 1, half)]
        looks += [{"color": color, "hatch": hatch} for color, hatch in zip(ramp, hatches, strict=True)]
    middle = [{"color": _NEUTRAL, "hatch": ""}] if points % 2 else []
    return [*looks[:half], *middle, *looks[half:]]


@house_style
def best_picks_figure(best_picks: dict[str, dict], confidence: float) -> Figure:
    """Draw the share of best picks of every model, with a single and a simultaneous interval.

    `best_picks` has by model, in percent of the participants, ``percent`` and the ends ``wilson_percent`` and
    ``goodman_percent`` of its intervals at a `confidence`, e.g. 0.95.
    """
    models = list(best_picks)
    percent, wilson, goodman = (
        np.array([best_picks[model][key] for model in models])
        for key in ("percent", "wilson_percent", "goodman_percent")
    )
    figure, axes = new_figure(width=max(SINGLE_COLUMN, 0.8 + 0.5 * len(models)), height=2.6)
    places = np.arange(len(models))
    bars = {"width": 0.7, "alpha": 0.6, "edgecolor": "#333333", "linewidth": 0.4}
    for place, model in enumerate(models):
        colour = MODELS[model]["color"] if model in MODELS else SERIES[place % len(SERIES)]
        axes.bar(place, percent[place], color=colour, **bars)
    look = {"color": "black", "markersize": 3, "capsize": 2.5, "linewidth": 1, "markerfacecolor": "white"}
    intervals = ((-0.12, wilson, "o", "each alone (Wilson)"), (0.12, goodman, "D", "all together (Goodman)"))
    for offset, ends, shape, name in intervals:
        label, distance = f"{100 * confidence:g} % interval, {name}", np.abs(ends.T - percent)
        axes.errorbar(places + offset, percent, yerr=distance, fmt=shape, label=label, **look)
    equal = 100 / len(models)
    axes.axhline(equal, color="black", linewidth=0.8, linestyle=(0, (4, 3)))
    axes.text(len(models) - 0.5, equal, "equal", ha="left", va="center", fontsize=6)
    axes.set_xticks(places, models)
    axes.grid(axis="x", visible=False)
    axes.set_axisbelow(True)
    axes.set_ylim(0, 5 * np.ceil(max(goodman.max(), wilson.max()) / 5) + 5)
    axes.set_ylabel("Picked as the closest model\n(% of participants)")
    figure.legend(loc="outside upper center")
    return figure
