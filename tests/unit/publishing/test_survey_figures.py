"""Pictures of the survey show the numbers they are given."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from lumbar.publishing.figures.survey_figures import best_picks_figure, likert_figure


@pytest.mark.parametrize("points", [2, 4, 5, 7])
def test_bars_of_a_model_add_up_and_diverge_at_the_middle(points):
    counts = np.random.default_rng(points).integers(1, 20, (3, points))
    labels = [f"point {point}" for point in range(points)]
    axes = likert_figure(["A", "B", "C"], counts, labels, "A statement").axes[0]
    assert len(axes.containers) == points
    for row, model in enumerate(counts):
        bars = [container[row] for container in axes.containers]
        widths = [bar.get_width() for bar in bars]
        assert widths == pytest.approx(100 * model / model.sum())
        ends = [bar.get_x() + bar.get_width() for bar in bars]
        assert [bar.get_x() for bar in bars[1:]] == pytest.approx(ends[:-1])
        middle = bars[points // 2]
        centre = middle.get_x() + (middle.get_width() / 2 if points % 2 else 0)
        assert centre == pytest.approx(0, abs=1e-9)
        assert ends[-1] <= axes.get_xlim()[1] + 1e-9


def test_neighbouring_points_are_told_apart_in_grey():
    axes = likert_figure(["A"], np.full((1, 5), 9), list("abcde"), "A statement").axes[0]
    looks = []
    for container in axes.containers:
        red, green, blue, _ = container[0].get_facecolor()
        looks.append((0.299 * red + 0.587 * green + 0.114 * blue, container[0].get_hatch()))
    for (grey, hatch), (other_grey, other_hatch) in pairwise(looks):
        assert abs(grey - other_grey) > 0.1 or hatch != other_hatch
    # The two ends of the scale must not look alike either.
    assert looks[0][1] != looks[-1][1]


def test_intervals_stand_where_they_should():
    picks = {
        "KB": {"percent": 40.0, "wilson_percent": [30.0, 51.0], "goodman_percent": [25.0, 57.0]},
        "HO": {"percent": 60.0, "wilson_percent": [49.0, 70.0], "goodman_percent": [43.0, 75.0]},
    }
    axes = best_picks_figure(picks, 0.95).axes[0]
    assert [bar.get_height() for bar in axes.patches] == [40.0, 60.0]
    segments = [lines.get_segments() for container in axes.containers for lines in _stems(container)]
    ends = [[tuple(segment[:, 1]) for segment in kind] for kind in segments]
    assert ends == [[(30.0, 51.0), (49.0, 70.0)], [(25.0, 57.0), (43.0, 75.0)]]
    assert axes.get_ylim()[1] >= 75


def _stems(container):
    return container[2] if hasattr(container, "has_yerr") else ()
