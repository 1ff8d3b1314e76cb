"""Table 4.1 as a grid in one picture: every difference under every convention, beside its null control."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.stability.comparison.table_4_1_grid import CHOICES, comparison_cells
from lumbar.publishing.figures.stability_figures import shared_legend
from lumbar.publishing.figures.style import DOUBLE_COLUMN, MEASURED, SEGMENTS, house_style, new_figure

if TYPE_CHECKING:
    import pandas as pd

MARKERS = {"thorax": "o", "abdomen": "s", "pelvis": "^"}
PLANES = {"lateral_bending": "lateral", "flexion_extension": "flexion"}
_WORDS = {
    "mid_ankle": "ankle",
    "with_box": "box",
    "without_box": "no box",
    "real": "real time",
    "unit": "1 s",
}


@house_style
def grid_figure(grid: pd.DataFrame):
    """Draw a panel per comparison, a row per convention; filled lateral bending, open flexion/extension.

    Parameters
    ----------
    grid : pandas.DataFrame
        Of `lumbar.lifting.stability.comparison.table_4_1_grid.grid_differences`. Without a comparison, the movements are drawn.

    Returns
    -------
    matplotlib.figure.Figure
    """
    cells = comparison_cells(grid)
    null = "null control (θ0 = 0)"
    if cells.empty:
        cells = grid[grid["percent"].notna()]
        null = "standing still"
    names = list(dict.fromkeys(cells["comparison"])) or ["nothing to compare"]
    conventions = list(dict.fromkeys(cells[list(CHOICES)].itertuples(index=False, name=None)))
    figure, axes = new_figure(
        DOUBLE_COLUMN, 0.9 + 0.24 * max(len(conventions), 6), ncols=len(names), sharey=True
    )
    axes = np.atleast_1d(axes)
    for axis, name in zip(axes, names, strict=True):
        _panel(axis, cells[cells["comparison"] == name], conventions, null)
        axis.set_title(name.replace("_", " "))
        axis.set_xlabel("Difference of area (%)")
    axes[0].set_yticks(range(len(conventions)), [_words(item) for item in conventions])
    axes[0].set_ylim(len(conventions) - 0.4, -0.6)
    shared_legend(figure, axes[:1], ncols=4)
    return figure


def _words(convention: tuple) -> str:
    return ", ".join(_WORDS.get(part, part) for part in convention)


def _panel(axis, cells: pd.DataFrame, conventions: list[tuple], null: str) -> None:
    axis.axvline(0.0, color=MEASURED, linewidth=0.8)
    for row in range(0, len(conventions), 2):
        axis.axhspan(row - 0.5, row + 0.5, color="#00000008", linewidth=0)
    places = {item: row for row, item in enumerate(conventions)}
    for number, (com, marker) in enumerate(MARKERS.items()):
        for index, (plane, words) in enumerate(PLANES.items()):
            own = cells[(cells["com"] == com) & (cells["plane"] == plane)]
            at = [places[item] for item in own[list(CHOICES)].itertuples(index=False, name=None)]
            height = np.array(at, dtype=float) + 0.11 * (2 * number + index - 2.5)
            colour = SEGMENTS[com]
            axis.plot(
                own["percent"],
                height,
                linestyle="",
                marker=marker,
                markersize=3.2,
                color=colour,
                markerfacecolor=colour if index == 0 else "white",
                markeredgewidth=0.7,
                label=f"{com}, {words}",
            )
            axis.plot(
                own["null_percent"],
                height,
                linestyle="",
                marker="|",
                markersize=5,
                color=MEASURED,
                markeredgewidth=0.7,
                label=null,
                zorder=1.5,
            )
