"""Pictures of comparison and location show the numbers they are given and can be read in grey."""

from __future__ import annotations

import numpy as np
import pytest
from periodic_records import STEP, multisine, noise, noisy_record, record, relaxing_force

from lumbar.publishing.figures.comparison_figures import comparison_figure, default_segment
from lumbar.publishing.figures.location_figure import location_figure
from lumbar.publishing.figures.style import save
from lumbar.tissue.diagnosis.noise.noise_floor import noise_floor
from lumbar.tissue.diagnosis.residuals.compare import compare_record
from lumbar.tissue.diagnosis.residuals.locate import locate


@pytest.fixture
def tests():
    """A repeating record and another one, and simulations that lack a cubic spring."""
    periodic = noisy_record(6, 0.3, 1, extra=lambda t, f: 0.002 * f**3)
    position = noise(1200, 3, 0.97)
    other = record(position, relaxing_force(position) + 0.3 * noise(1200, 5), "a_record_of_noise")
    return [(item, relaxing_force(item["input"])) for item in (periodic, other)]


def test_comparison_shows_segment_residual_floor_and_shares(tests):
    (periodic, simulated), (other, response) = tests
    floor = noise_floor(periodic)
    found = [compare_record(periodic, simulated, floor), compare_record(other, response, floor, "multisine")]
    figure = comparison_figure(periodic, simulated, found, segment=(6.0, 9.0))
    response_axis, residual_axis, shares = figure.axes
    measured, model = (line.get_ydata() for line in response_axis.lines)
    inside = (periodic.time >= 6.0 - 1e-9) & (periodic.time <= 9.0 + 1e-9)
    assert measured == pytest.approx(periodic["output"][inside])
    assert model == pytest.approx(simulated[inside])
    assert residual_axis.lines[0].get_ydata() == pytest.approx(measured - model)
    assert residual_axis.patches[0].get_height() == pytest.approx(4 * floor.rms)
    heights = [[bar.get_height() for bar in container] for container in shares.containers[:2]]
    left = [100 * item.rms.value**2 / item.output_variance for item in found]
    assert np.sum(heights, axis=0) == pytest.approx(left)
    assert heights[1] == pytest.approx([item.explainable_percent for item in found])
    assert [tick.get_text() for tick in shares.get_xticklabels()] == ["multisine", "a record of noise"]
    texts = " ".join(text.get_text() for text in shares.texts)
    assert f"{found[0].vaf.value:.4g} %" in texts
    assert len({line.get_linestyle() for line in response_axis.lines}) == 2


def test_comparison_without_a_floor(tests):
    other, response = tests[1]
    figure = comparison_figure(other, response, [compare_record(other, response)], "HO")
    assert not figure.axes[1].patches
    assert [text.get_text() for text in figure.axes[2].get_legend().get_texts()] == [
        "noise and error of the model"
    ]


def test_the_default_segment_is_typical():
    error = np.concatenate([np.full(2000, 5.0), np.full(6000, 1.0), np.full(1000, 9.0)])
    test = record(np.arange(9000.0), error)
    low, high = default_segment(test, np.zeros(9000), 0.5)
    assert 2000 * STEP <= low < high <= 8000 * STEP + STEP


def test_location_has_nine_panels_with_what_was_found(tests):
    periodic, simulated = tests[0]
    location = locate(periodic, simulated, noise_floor(periodic))
    figure = location_figure(location)
    time, cycles, frequency, depth, turning, plane, whiteness, odd, even, *_ = figure.axes
    for axis in figure.axes[:9]:
        assert axis.get_xlabel() and axis.get_ylabel()
    assert time.patches[0].get_data().values == pytest.approx(location.views["time"].table["rms"])
    shown = np.concatenate([line.get_ydata() for line in frequency.lines[:-1]])
    assert len(shown) == len(location.views["frequency"].table["rms"]) - 1  # without the constant
    colours = plane.collections[0].get_array().ravel()
    assert np.allclose(
        np.ma.filled(colours, np.nan), location.views["position and velocity"].table["mean"], equal_nan=True
    )
    assert depth.lines[0].get_ydata() == pytest.approx(location.views["depth"].table["mean"], nan_ok=True)
    assert turning.lines[0].get_ydata() == pytest.approx(location.views["reversals"].table["mean"])
    assert cycles.lines[0].get_ydata() == pytest.approx(location.views["cycles"].table["rms"])
    assert whiteness.lines[0].get_ydata() == pytest.approx(location.views["whiteness"].table["correlation"])
    for axis, names in ((odd, {"with z", "with v"}), (even, {"with z²", "with |v|"})):
        curves = [line for line in axis.lines if not line.get_label().startswith("_")]
        assert names <= {line.get_label() for line in curves}
        assert len({str(line._dash_pattern) for line in curves}) == len(curves)
    assert len({str(line._dash_pattern) for line in depth.lines[:3]}) == 3
    assert f"map: {100 * location.views['position and velocity'].share:.0f} %" in plane.get_title(loc="right")
    assert f"noise {location.residual.floor.rms:.3g} N" in figure.get_suptitle()


def test_location_of_noise_says_so(tests):
    other, response = tests[1]
    figure = location_figure(locate(other, response, noise_floor(tests[0][0]), "multisine"))
    assert figure.axes[0].get_title(loc="right") == "time: no relation"


def test_location_without_reversals_or_floor():
    position = np.linspace(0.0, 10.0, 600)
    test = record(position, 0.5 * position + 0.1 * noise(600, 1), "ramp")
    figure = location_figure(locate(test, 0.4 * position))
    assert "too few reversals" in [text.get_text() for text in figure.axes[4].texts]
    assert "too few cycles" in [text.get_text() for text in figure.axes[1].texts]
    assert "noise unknown" in figure.get_suptitle()


def test_figures_are_saved(tests, tmp_path):
    periodic, simulated = tests[0]
    floor = noise_floor(periodic)
    save(location_figure(locate(periodic, simulated, floor)), tmp_path / "location", "synthetic twin")
    found = [compare_record(periodic, simulated, floor)]
    save(comparison_figure(periodic, simulated, found), tmp_path / "comparison", "synthetic twin")
    assert {path.name for path in tmp_path.iterdir()} == {
        f"{name}.{ending}" for name in ("location", "comparison") for ending in ("svg", "pdf")
    }


def test_a_panel_that_sees_no_relation_says_nothing_of_the_errors_size():
    position = multisine(10)
    test = record(position, relaxing_force(position) + 0.05 * noise(len(position), 1))
    location = locate(test, 0.9 * relaxing_force(position), noise_floor(test))
    assert location.residual.variance > (10 * location.residual.floor.rms) ** 2
    titles = [axis.get_title(loc="right") for axis in location_figure(location).axes]
    assert "time: all repeats" in titles and not any("only noise" in title for title in titles)


def test_a_map_whose_pattern_counts_marks_no_cell_as_chance():
    position = multisine(10)
    test = record(position, relaxing_force(position) + 0.05 * noise(len(position), 1))
    location = locate(test, 0.9 * relaxing_force(position), noise_floor(test))
    view = location.views["position and velocity"]
    view.table["z_score"][:] = 1.0
    figure = location_figure(location)
    axis = next(axis for axis in figure.axes if axis.get_title(loc="right").startswith("map"))
    assert axis.get_title(loc="right").endswith("as a whole")
    assert not [line for line in axis.lines if line.get_marker() == "x"]
