"""The workflow, drawn from its own dependency graph."""

from __future__ import annotations

from collections import defaultdict
from graphlib import TopologicalSorter
from itertools import cycle
from textwrap import fill

from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from matplotlib.path import Path

from lumbar.publishing.figures.style import DOUBLE_COLUMN, SERIES, house_style, new_figure


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
def draw_workflow(
    edges: list[tuple[str, str]], chapter_of: dict[str, str], chapters: dict[str, str]
) -> Figure:
    """Draw every rule as a box in its chapter's band and every dependency as an arrow in its chapter's colour.

    Arrows run between the boxes, never behind them; those of one rule share their lines.

    Parameters
    ----------
    edges : list of (str, str)
        Rules ``(made by, used by)``.
    chapter_of : dict of str to str
        Chapter of each rule; edges of rules that are not named here are left out.
    chapters : dict of str to str
        Chapters from top to bottom, with their titles.
    """
    edges = [edge for edge in edges if edge[0] in chapter_of and edge[1] in chapter_of]
    rank = depths(edges)
    rows = {
        name: sorted((rule for rule in rank if chapter_of[rule] == name), key=lambda rule: (rank[rule], rule))
        for name in chapters
    }
    lines = _wrap({name: rules for name, rules in rows.items() if rules})
    places = {
        rule: (column, line) for line, (_, rules) in enumerate(lines) for column, rule in enumerate(rules)
    }
    figure, axis = new_figure(DOUBLE_COLUMN, 0.5 * len(lines) + 0.3)
    axis.set_axis_off()
    axis.set(xlim=(0, 100 + _CHANNEL / 2), ylim=(-len(lines) + 0.3, 0.6))
    colours = dict(zip(chapters, cycle(_COLOURS), strict=False))
    _draw_boxes(axis, lines, chapters, colours)
    for source, path in routes(edges, places).items():
        for points in path:
            axis.add_patch(
                FancyArrowPatch(
                    path=Path(points),
                    arrowstyle="-|>,head_length=2.4,head_width=1.2",
                    linewidth=0.8,
                    color=colours[chapter_of[source]],
                    capstyle="butt",
                    joinstyle="round",
                    zorder=2,
                )
            )
    return figure


_COLOURS = (*SERIES, "#882255", "#332288", "#999933")
"""As many as the thesis has chapters, so that no two look alike."""
_PER_LINE = 4
_LEFT, _PITCH = 21.0, 79.0 / _PER_LINE
_HALF_WIDTH, _HALF_HEIGHT = 0.37 * _PITCH, 0.21
_CHANNEL = _PITCH - 2 * _HALF_WIDTH
"""Width of the free space between two boxes of a line."""


def _wrap(rows: dict[str, list[str]]) -> list[tuple[str, list[str]]]:
    """Split chapters with many rules over several lines."""
    return [
        (name, rules[start : start + _PER_LINE])
        for name, rules in rows.items()
        for start in range(0, len(rules), _PER_LINE)
    ]


def _centre(place: tuple[int, int]) -> tuple[float, float]:
    column, line = place
    return _LEFT + (column + 0.5) * _PITCH, -float(line)


def box(column: int, line: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return from where to where a box reaches, along and across its line."""
    x, y = _centre((column, line))
    return (x - _HALF_WIDTH, x + _HALF_WIDTH), (y - _HALF_HEIGHT, y + _HALF_HEIGHT)


def routes(
    edges: list[tuple[str, str]], places: dict[str, tuple[int, int]]
) -> dict[str, list[list[tuple[float, float]]]]:
    """Return the corners of every arrow, by the rule that it leaves.

    An arrow goes down from its box into the space below its line, along it to the channel between two columns, through
    that to the space beside the line of its goal, and from there into the box. In every space and channel each rule has a
    track of its own.

    Parameters
    ----------
    edges : list of (str, str)
    places : dict of str to (int, int)
        Column and line of every rule.
    """
    ports, legs = _ports(edges, places), []
    for source, target in edges:
        (column, line), goal = places[source], places[target][1]
        below = goal > line
        legs.append((source, target, line, goal - 1 if below else goal, column + 1, below))
    spaces = _tracks([(space, source) for source, _, first, last, _, _ in legs for space in (first, last)])
    channels = _tracks([(channel, source) for source, _, first, last, channel, _ in legs if first != last])
    found: dict[str, list[list[tuple[float, float]]]] = {source: [] for source, _ in edges}
    for source, target, first, last, channel, below in legs:
        x, y = _centre(places[source])
        x += 0.85 * _HALF_WIDTH
        into, top = ports[source, target], _centre(places[target])[1]
        levels = [
            -space - _HALF_HEIGHT - (1 - 2 * _HALF_HEIGHT) * (0.12 + 0.7 * spaces[space, source])
            for space in (first, last)
        ]
        middle = []
        if first != last:
            across = _LEFT + channel * _PITCH + _CHANNEL * 0.9 * (channels[channel, source] - 0.5)
            middle = [(across, levels[0]), (across, levels[1])]
        end = top + _HALF_HEIGHT if below else top - _HALF_HEIGHT
        found[source].append([(x, y - _HALF_HEIGHT), (x, levels[0]), *middle, (into, levels[1]), (into, end)])
    return found


def _tracks(users: list[tuple[int, str]]) -> dict[tuple[int, str], float]:
    """Return where across a space each of its users runs, from 0 to 1."""
    of: dict[int, list[str]] = defaultdict(list)
    for space, user in dict.fromkeys(users):
        of[space].append(user)
    return {
        (space, user): (number + 0.5) / len(names)
        for space, names in of.items()
        for number, user in enumerate(names)
    }


def _ports(edges, places) -> dict[tuple[str, str], float]:
    """Return where along the edge of its goal each arrow ends: in the order of the boxes, the right end left to what leaves."""
    into = defaultdict(list)
    for source, target in edges:
        into[target].append(source)
    found = {}
    for target, sources in into.items():
        centre = _centre(places[target])[0]
        sources.sort(key=lambda rule: places[rule])
        for number, source in enumerate(sources):
            share = 1.5 * (number + 0.5) / len(sources) - 0.9
            # What comes from above and from below runs in one space with what the boxes above and below send and get.
            aside = 0.06 if places[source][1] >= places[target][1] else 0.0
            found[source, target] = centre + _HALF_WIDTH * (share + aside)
    return found


def _draw_boxes(axis, lines, chapters, colours) -> None:
    titled = set()
    for row, (name, rules) in enumerate(lines):
        shade = 0.10 if list(chapters).index(name) % 2 else 0.05
        axis.axhspan(-row - 0.5, -row + 0.5, color=colours[name], alpha=shade, lw=0)
        if name not in titled:
            axis.text(0.5, -row, chapters[name], va="center", fontsize=7, fontweight="bold")
            titled.add(name)
        for column, rule in enumerate(rules):
            (x, y), ((left, right), (low, high)) = _centre((column, row)), box(column, row)
            axis.add_patch(
                FancyBboxPatch(
                    (left, low),
                    right - left,
                    high - low,
                    boxstyle="round,pad=0,rounding_size=0.1",
                    facecolor="white",
                    edgecolor=colours[name],
                    linewidth=1.2,
                    zorder=3,
                )
            )
            words = fill(rule.replace("_", " "), 20)
            axis.text(x, y, words, ha="center", va="center", fontsize=6, linespacing=0.95, zorder=4)
