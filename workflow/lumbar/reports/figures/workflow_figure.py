"""Figures 1.1 and 3.1: the workflow, drawn from its own dependency graph."""

from __future__ import annotations

import re
from collections import defaultdict
from graphlib import TopologicalSorter

from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from lumbar.reports.figures.style import DOUBLE_COLUMN, SERIES, house_style, new_figure

_NODE = re.compile(r'^\s*(\d+)\[label = "([^"\\]+)')
_EDGE = re.compile(r"^\s*(\d+) -> (\d+)")


def parse_rule_graph(dot: str) -> list[tuple[str, str]]:
    """Return the edges ``(made by, used by)`` of a rule graph in the DOT language, sorted and without repetition."""
    names = {match[1]: match[2] for line in dot.splitlines() if (match := _NODE.match(line))}
    edges = {(names[match[1]], names[match[2]]) for line in dot.splitlines() if (match := _EDGE.match(line))}
    return sorted(edges)


def depths(edges: list[tuple[str, str]]) -> dict[str, int]:
    """Longest path from any source to each node.

    Raises
    ------
    graphlib.CycleError
        If the graph has a cycle.
    """
    before = defaultdict(set)
    for source, target in edges:
        before[target].add(source)
    found: dict[str, int] = {}
    for node in TopologicalSorter(before).static_order():
        found[node] = 1 + max((found[item] for item in before[node]), default=-1)
    return found


@house_style
def draw_workflow(edges: list[tuple[str, str]], chapter_of: dict[str, str], chapters: dict[str, str]):
    """Draw every rule as a box in its chapter's band and every dependency as an arrow.

    Parameters
    ----------
    edges : list of (str, str)
        Rules ``(made by, used by)``.
    chapter_of : dict of str to str
        Chapter of each rule; edges of rules that are not named here are left out.
    chapters : dict of str to str
        Chapters from top to bottom, with their titles.

    Returns
    -------
    matplotlib.figure.Figure
    """
    edges = [edge for edge in edges if edge[0] in chapter_of and edge[1] in chapter_of]
    rank = depths(edges)
    rows = {
        name: sorted((rule for rule in rank if chapter_of[rule] == name), key=lambda rule: (rank[rule], rule))
        for name in chapters
    }
    rows = {name: rules for name, rules in rows.items() if rules}
    lines = _wrap(rows)
    figure, axis = new_figure(DOUBLE_COLUMN, 0.42 * len(lines) + 0.3)
    axis.set_axis_off()
    axis.set_xlim(0, 100)
    axis.set_ylim(-len(lines) + 0.3, 0.75)
    places = _draw_boxes(axis, lines, chapters)
    _draw_arrows(axis, edges, places)
    return figure


_PER_LINE = 4


def _wrap(rows: dict[str, list[str]]) -> list[tuple[str, list[str]]]:
    """Split chapters with many rules over several lines."""
    return [
        (name, rules[start : start + _PER_LINE])
        for name, rules in rows.items()
        for start in range(0, len(rules), _PER_LINE)
    ]


def _draw_boxes(axis, lines, chapters) -> dict[str, tuple[float, float]]:
    places: dict[str, tuple[float, float]] = {}
    order = list(chapters)
    left, width = 21.0, 79.0 / _PER_LINE
    titled = set()
    for row, (name, rules) in enumerate(lines):
        colour = SERIES[order.index(name) % len(SERIES)]
        axis.axhspan(
            -row - 0.5, -row + 0.5, color=colour, alpha=0.10 if order.index(name) % 2 else 0.05, lw=0
        )
        if name not in titled:
            axis.text(0.5, -row, chapters[name], va="center", fontsize=7, fontweight="bold")
            titled.add(name)
        for column, rule in enumerate(rules):
            x = left + (column + 0.5) * width
            box = FancyBboxPatch(
                (x - 0.44 * width, -row - 0.22),
                0.88 * width,
                0.44,
                boxstyle="round,pad=0,rounding_size=0.12",
                mutation_aspect=1,
                facecolor="white",
                edgecolor=colour,
                linewidth=1.2,
                zorder=3,
            )
            axis.add_patch(box)
            axis.text(
                x,
                -row,
                rule.replace("_", " "),
                ha="center",
                va="center",
                fontsize=6 if len(rule) < 24 else 5.2,
                zorder=4,
            )
            places[rule] = (x, -row)
    return places


def _draw_arrows(axis, edges, places) -> None:
    for source, target in edges:
        (x0, y0), (x1, y1) = places[source], places[target]
        same_line = y0 == y1
        start = (x0 + (8.7 if x1 > x0 else -8.7), y0) if same_line else (x0, y0 - 0.22)
        stop = (x1 + (-8.7 if x1 > x0 else 8.7), y1) if same_line else (x1, y1 + 0.22)
        if not same_line and y1 > y0:
            start, stop = (x0, y0 + 0.22), (x1, y1 - 0.22)
        axis.add_patch(
            FancyArrowPatch(
                start,
                stop,
                arrowstyle="-|>",
                mutation_scale=6,
                linewidth=0.7,
                color="#555555",
                alpha=0.75,
                connectionstyle="arc3,rad=0.0" if same_line and abs(x1 - x0) < 25 else "arc3,rad=0.12",
                shrinkA=0,
                shrinkB=0,
                zorder=2,
            )
        )
