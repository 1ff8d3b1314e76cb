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
    """Return color and hatch of each point, distinguishable in grey."""
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
