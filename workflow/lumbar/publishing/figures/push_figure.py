"""ROC of the measures: who must step after a push, all sizes and equal pushes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.pushes.levels import BACKWARD, FORWARD
from lumbar.lifting.pushes.prediction import ALL_SIZES, BOTH, EQUAL, rows_of, scores_of
from lumbar.lifting.pushes.roc import curve
from lumbar.publishing.figures.style import DOUBLE_COLUMN, SERIES, house_style, new_figure

if TYPE_CHECKING:
    import pandas as pd

PANELS = (
    (ALL_SIZES, BOTH, "All sizes, both directions"),
    (EQUAL, FORWARD, "Equal pushes forward"),
    (EQUAL, BACKWARD, "Equal pushes backward"),
)
DRAWN = (
    "viability_margin",
    "capture_margin",
    "margin_of_stability",
    "trunk_inclination",
    "l5s1_moment",
    "basin_abdomen_inverted",
    "basin_area_abdomen_hanging",
    "push_alone",
)
"""Measures that a picture can hold; all stand in the table. The smallest impulse lies on the margin of stability's curve."""
POINTS = 1000
"""Of a curve at most: those of a thousand lifters would have a point for each of 70,000 pushes."""
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "")
_STYLES = (
    "-",
    (0, (6, 1.5)),
    (0, (2, 1)),
    (0, (1, 1)),
    (0, (6, 1.5, 1, 1.5)),
    (0, (4, 1, 1, 1, 1, 1)),
    (0, (1, 3)),
)


@house_style
def push_figure(frame: pd.DataFrame, table: pd.DataFrame):
    """Draw the curves of some measures in three panels, and below them their areas with intervals.

    Parameters
    ----------
    frame : pandas.DataFrame
        Pushes, columns `lumbar.lifting.pushes.contest.COLUMNS`.
    table : pandas.DataFrame
        Columns `lumbar.lifting.pushes.prediction.COLUMNS`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, axes = new_figure(
        DOUBLE_COLUMN, 4.6, nrows=2, ncols=len(PANELS), sharey="row", gridspec_kw={"height_ratios": [1.5, 1]}
    )
    for column, (contest, direction, title) in enumerate(PANELS):
        rows = table[(table["contest"] == contest) & (table["direction"] == direction)].set_index("measure")
        _curves(axes[0, column], rows_of(frame, direction), contest, rows)
        _areas(axes[1, column], rows)
        axes[0, column].set_title(title)
    axes[0, 0].set_ylabel("Told of those who step")
    return figure


def _look(number: int) -> dict:
    """Colour and line style of a measure; the baseline is thin and grey."""
    if DRAWN[number] == "push_alone":
        return {"color": "#888888", "linestyle": "-", "linewidth": 0.9}
    return {"color": SERIES[number % len(SERIES)], "linestyle": _STYLES[number % len(_STYLES)]}


def _curves(axis, part: pd.DataFrame, contest: str, rows: pd.DataFrame) -> None:
    axis.plot([0, 1], [0, 1], color="#bbbbbb", linewidth=0.8, zorder=0)
    for number, name in enumerate(DRAWN):
        if name in rows.index:
            alarms, hits = curve(*scores_of(part, name, contest))
            shown = np.unique(np.linspace(0, len(alarms) - 1, POINTS).astype(int))
            alarms, hits = alarms[shown], hits[shown]
            last = max(1, len(alarms) // 6)
            axis.plot(
                alarms, hits, marker=_MARKERS[number], markersize=3, markevery=(number, last), **_look(number)
            )
    axis.set_xlabel("Told of those who stand")
    axis.set_aspect("equal")


def _areas(axis, rows: pd.DataFrame) -> None:
    """Areas under the curves with their intervals, one line per measure; the name stands at the left alone."""
    axis.axvline(0.5, color="#bbbbbb", linewidth=0.8, zorder=0)
    for number, name in enumerate(DRAWN):
        if name not in rows.index:
            continue
        row, colour = rows.loc[name], _look(number)["color"]
        if row["auc_low"] == row["auc_low"] and row["auc_low"] is not None:
            axis.plot([row["auc_low"], row["auc_high"]], [number] * 2, color=colour, linewidth=1.2)
        axis.plot(row["auc"], number, marker=_MARKERS[number] or "|", color=colour, markersize=4.5)
    axis.set_yticks(range(len(DRAWN)), [name.replace("_", " ") for name in DRAWN])
    axis.set_ylim(len(DRAWN) - 0.5, -0.5)
    axis.set_xlim(-0.03, 1.03)
    axis.set_xticks([0.0, 0.5, 1.0])
    axis.set_xlabel("Area under the curve")
