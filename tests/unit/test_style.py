"""Figures: the same bytes at every run, the data's label on each, readable in grey."""

from __future__ import annotations

import matplotlib.colors as colours
import numpy as np
import pytest

from lumbar.reports.figures.style import MODELS, new_figure, save


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


def test_figures_do_not_stay_open(tmp_path):
    import matplotlib.pyplot as plt

    open_before = plt.get_fignums()
    save(draw(), tmp_path / "figure", "")
    assert plt.get_fignums() == open_before


@pytest.mark.parametrize("kind", ["linestyle", "marker", "hatch"])
def test_models_are_told_apart_without_colour(kind):
    assert len({str(style[kind]) for style in MODELS.values()}) == len(MODELS)


def test_model_colours_differ():
    assert len({colours.to_hex(style["color"]) for style in MODELS.values()}) == len(MODELS)
