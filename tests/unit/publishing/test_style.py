"""Figures: the same bytes at every run, the data's label on each, readable in grey."""

from __future__ import annotations

import ast
from pathlib import Path

import matplotlib.colors as colours
import numpy as np
import pytest

from lumbar.publishing.figures import style
from lumbar.publishing.figures.style import MODELS, house_style, new_figure, save


@house_style
def draw():
    figure, axes = new_figure(height=2.0)
    axes.plot(np.linspace(0, 1, 20), np.random.default_rng(0).normal(size=20), label="x")
    axes.set_xlabel("Time (s)")
    axes.legend()
    return figure


def test_figures_are_byte_for_byte_the_same(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    for name in ("one", "two"):
        save(draw(), tmp_path / name, "synthetic twin")
    for ending in ("svg", "pdf"):
        assert (tmp_path / f"one.{ending}").read_bytes() == (tmp_path / f"two.{ending}").read_bytes()


def test_the_label_of_the_data_stands_on_the_figure(tmp_path):
    figure = draw()
    save(figure, tmp_path / "figure", "synthetic twin")
    assert any("synthetic twin" in text.get_text() for text in [*figure.texts, figure._supxlabel])
    assert (tmp_path / "figure.svg").stat().st_size > 1000
    other = draw()
    save(other, tmp_path / "other", "laboratory X")
    assert (tmp_path / "figure.svg").read_bytes() != (tmp_path / "other.svg").read_bytes()


def test_a_notebook_keeps_its_own_style_and_windows(tmp_path):
    import matplotlib.pyplot as plt

    with plt.rc_context({"font.size": 17, "axes.grid": False, "svg.hashsalt": "own"}):
        before, backend, windows = dict(plt.rcParams), plt.get_backend(), plt.get_fignums()
        save(draw(), tmp_path / "figure", "synthetic twin")
        assert (dict(plt.rcParams), plt.get_backend(), plt.get_fignums()) == (before, backend, windows)
    save(draw(), tmp_path / "other", "synthetic twin")
    assert (tmp_path / "figure.svg").read_bytes() == (tmp_path / "other.svg").read_bytes()


def test_every_figure_is_drawn_in_the_house_s_style():
    """A function that makes a figure outside of the style would draw with whatever the user has set."""
    for path in Path(style.__file__).parent.glob("*.py"):
        for function in (
            item for item in ast.parse(path.read_text()).body if isinstance(item, ast.FunctionDef)
        ):
            if "new_figure(" in ast.unparse(function.body):
                assert [ast.unparse(item) for item in function.decorator_list] == ["house_style"], (
                    function.name
                )


@pytest.mark.parametrize("kind", ["linestyle", "marker", "hatch"])
def test_models_are_told_apart_without_colour(kind):
    assert len({str(style[kind]) for style in MODELS.values()}) == len(MODELS)


def test_model_colours_differ():
    assert len({colours.to_hex(style["color"]) for style in MODELS.values()}) == len(MODELS)
