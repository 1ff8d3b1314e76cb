"""Figures of the survey: ratings of the models and best picks."""

import textwrap
from collections.abc import Sequence

import matplotlib.colors as colours
import numpy as np
from matplotlib.figure import Figure

from lumbar.publishing.figures.palette import MODELS, SERIES
from lumbar.publishing.figures.style import SINGLE_COLUMN, house_style, new_figure

_DISAGREE, _NEUTRAL, _AGREE = ("#D55E00", "#F0B27A"), "#DDDDDD", ("#7FB8DB", "#0072B2")
_LINE = 105
"""Characters that fit in one line of a title."""
_HATCHES = {"disagree": ("xxx", "//"), "neutral": "", "agree": ("..", "")}


@house_style
def likert_figure(models: Sequence[str], counts: np.ndarray, labels: Sequence[str], statement: str) -> Figure:
    """Draw diverging bars of the ratings: disagreement to the left of zero, agreement to the right.

    The middle point of an odd scale straddles zero.

    Parameters
    ----------
    models : sequence of str
        Names of the models.
    counts : numpy.ndarray of int, shape (models, points)
        Number of answers by point, from the least to the greatest agreement.
    labels : sequence of str
        Names of the points.
    statement : str
        Statement that the participants rated.
    """
    percent = 100 * counts / counts.sum(axis=1, keepdims=True)
    points = counts.shape[1]
    left = -(percent[:, : points // 2].sum(axis=1) + (percent[:, points // 2] / 2 if points % 2 else 0))
    starts = left[:, None] + np.cumsum(percent, axis=1) - percent
    figure, axes = new_figure(height=0.9 + 0.38 * len(models))
    rows = np.arange(len(models))[::-1]
    for point, (colour, hatch) in enumerate(_point_styles(points)):
        axes.barh(
            rows, percent[:, point], left=starts[:, point], height=0.68, color=colour, hatch=hatch,
            edgecolor="#333333", linewidth=0.4, label=f"{point + 1} {labels[point]}",
        )  # fmt: skip
        for row, start, width, count in zip(
            rows, starts[:, point], percent[:, point], counts[:, point], strict=True
        ):
            if width >= 4:  # narrower bars have no room for a number
                axes.text(
                    start + width / 2, row, str(count), ha="center", va="center", fontsize=7,
                    bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.2, "alpha": 0.85},
                )  # fmt: skip
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


def _point_styles(points: int) -> list[tuple[str, str]]:
    """Return colour and hatch of each point, distinguishable in grey."""
    half = points // 2

    def ramp(ends: tuple[str, str]) -> list[str]:
        first, last = (np.array(colours.to_rgb(end)) for end in ends)
        return [colours.to_hex(first + (last - first) * share) for share in np.linspace(0, 1, half)]

    def hatches(kinds: tuple[str, str], outermost: int) -> list[str]:
        return [kinds[0 if place == outermost else 1] for place in range(half)]

    lower = list(zip(ramp(_DISAGREE), hatches(_HATCHES["disagree"], 0), strict=True))
    upper = list(zip(ramp(_AGREE), hatches(_HATCHES["agree"], half - 1), strict=True))
    middle = [(_NEUTRAL, _HATCHES["neutral"])] if points % 2 else []
    return [*lower, *middle, *upper]


@house_style
def best_picks_figure(best_picks: dict[str, dict], confidence: float) -> Figure:
    """Draw the share of best picks of every model with its interval and its simultaneous interval.

    Parameters
    ----------
    best_picks : dict of str to dict
        By model, in percent of the participants: ``percent``, and the ends ``wilson_percent`` and
        ``goodman_percent``.
    confidence : float
        Of the intervals, e.g. 0.95.
    """
    models = list(best_picks)
    percent, wilson, goodman = (
        np.array([best_picks[model][key] for model in models])
        for key in ("percent", "wilson_percent", "goodman_percent")
    )
    figure, axes = new_figure(width=max(SINGLE_COLUMN, 0.8 + 0.5 * len(models)), height=2.6)
    places = np.arange(len(models))
    for place, model in enumerate(models):
        colour = MODELS[model]["color"] if model in MODELS else SERIES[place % len(SERIES)]
        axes.bar(
            place, percent[place], width=0.7, color=colour, alpha=0.6, edgecolor="#333333", linewidth=0.4
        )
    intervals = ((-0.12, wilson, "o", "each alone (Wilson)"), (0.12, goodman, "D", "all together (Goodman)"))
    for offset, ends, shape, name in intervals:
        axes.errorbar(
            places + offset, percent, yerr=np.abs(ends.T - percent), fmt=shape, color="black",
            markersize=3, capsize=2.5, linewidth=1, markerfacecolor="white",
            label=f"{100 * confidence:g} % interval, {name}",
        )  # fmt: skip
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
