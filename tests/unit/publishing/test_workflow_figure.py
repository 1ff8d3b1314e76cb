"""Laying out the rule graph."""

from __future__ import annotations

import itertools

from lumbar.publishing.figures.workflow_figure import box, depths, draw_workflow, routes

EDGES = [("fit", "all"), ("measure", "all"), ("measure", "fit")]


def test_depth_is_the_longest_path():
    assert depths(EDGES) == {"measure": 0, "fit": 1, "all": 2}


def test_only_rules_of_chapters_are_drawn():
    figure = draw_workflow(
        EDGES,
        {"fit": "second", "measure": "first"},
        {"first": "1 First", "second": "2 Second"},
    )
    words = {text.get_text() for text in figure.axes[0].texts}
    assert words == {"fit", "measure", "1 First", "2 Second"}
    assert sum(type(patch).__name__ == "FancyArrowPatch" for patch in figure.axes[0].patches) == 1


def test_no_arrow_runs_behind_a_box():
    rules = {f"{chapter}_{number}": chapter for chapter in "abc" for number in range(6)}
    names = list(rules)
    edges = [(first, second) for number, first in enumerate(names) for second in names[number + 1 :: 3]]
    edges.append((names[-1], names[0]))  # upwards, as no rule graph has it: the drawing must not care
    places = {name: (number % 4, number // 4) for number, name in enumerate(names)}
    ends = []
    for source, paths in routes(edges, places).items():
        for path in paths:
            ends.append((source, path[-1]))
            assert all(a[0] == b[0] or a[1] == b[1] for a, b in itertools.pairwise(path))
            for (x0, y0), (x1, y1) in itertools.pairwise(path):
                for column, line in places.values():
                    (left, right), (low, high) = box(column, line)
                    apart = (
                        max(x0, x1) <= left
                        or min(x0, x1) >= right
                        or max(y0, y1) <= low
                        or min(y0, y1) >= high
                    )
                    assert apart, (source, column, line)
    assert len({end for _, end in ends}) == len(ends) == len(edges)
