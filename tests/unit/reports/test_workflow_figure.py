"""Reading and laying out the rule graph."""

from __future__ import annotations

import pytest

from lumbar.reports.figures.workflow_figure import depths, draw_workflow, parse_rule_graph

DOT = """digraph snakemake_dag {
    graph[bgcolor=white, margin=0];
    0[label = "all", color = "0.22 0.6 0.85", style="rounded"];
    1[label = "fit", color = "0.44 0.6 0.85", style="rounded"];
    2[label = "measure", color = "0.00 0.6 0.85", style="rounded"];
    3[label = "measure", color = "0.00 0.6 0.85", style="rounded"];
    1 -> 0
    2 -> 1
    3 -> 1
    2 -> 0
}
"""


def test_edges_are_read_once_and_sorted():
    assert parse_rule_graph(DOT) == [("fit", "all"), ("measure", "all"), ("measure", "fit")]


def test_depth_is_the_longest_path():
    assert depths(parse_rule_graph(DOT)) == {"measure": 0, "fit": 1, "all": 2}


def test_only_rules_of_chapters_are_drawn():
    figure = draw_workflow(
        parse_rule_graph(DOT),
        {"fit": "second", "measure": "first"},
        {"first": "1 First", "second": "2 Second"},
    )
    words = {text.get_text() for text in figure.axes[0].texts}
    assert words == {"fit", "measure", "1 First", "2 Second"}
    assert sum(type(patch).__name__ == "FancyArrowPatch" for patch in figure.axes[0].patches) == 1


def test_a_word_that_is_no_graph_has_no_edges():
    assert parse_rule_graph("Building DAG of jobs...\n") == []
    with pytest.raises(KeyError):
        parse_rule_graph("1 -> 2\n")
