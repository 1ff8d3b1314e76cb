"""Figures: the same bytes at every run, and each shows the numbers that it is given."""

import re
from html import unescape
from itertools import pairwise
from urllib.parse import unquote

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from periodic_records import STEP, noise, noisy_record, record, relaxing_force

import lumbar
from lumbar.publishing.figures.comparison_figures import default_segment, record_comparison_figure
from lumbar.publishing.figures.lifting_figures import events_figure, pendulum_figure, segments_figure
from lumbar.publishing.figures.location_figures import location_figure
from lumbar.publishing.figures.people_figures import best_picks_figure, likert_figure
from lumbar.publishing.figures.stability_figures import compare_with_regulator
from lumbar.publishing.figures.style import house_style, new_figure, save
from lumbar.publishing.figures.tissue_figures import analogue_picture
from lumbar.settings.lifting import PendulumSettings
from lumbar.tissue.diagnosis.noise.noise_floor import noise_floor
from lumbar.tissue.diagnosis.residuals.candidate_causes import rank_causes
from lumbar.tissue.diagnosis.residuals.compare import compare_record
from lumbar.tissue.diagnosis.residuals.locate import Location, residual_after
from lumbar.tissue.identification.model_tables import table_2_1
from lumbar.tissue.models.tissue_models import REFERENCES, TABLE_2_1
from study_settings import study_settings, subject_settings


@house_style
def draw():
    figure, axes = new_figure(height=2.0)
    axes.plot(np.linspace(0, 1, 20), np.random.default_rng(0).normal(size=20), label="x")
    axes.set_xlabel("Time (s)")
    axes.legend()
    return figure


def test_figure_embeds_the_shipped_font_and_fallbacks(tmp_path, caplog):
    figure = draw()
    figure.axes[0].set_xlabel(r"√x ≤ θ, Müller, Запись, $\theta_0$ (rad)")
    figure.axes[0].set_ylabel("√x ≤ θ")
    save(figure, tmp_path / "font", "synthetic twin")
    fonts = set(re.findall(rb"/BaseFont /(?:[A-Z]{6}\+)?([\w-]+)", (tmp_path / "font.pdf").read_bytes()))
    assert {b"Arimo-Regular", b"Arimo-Italic", b"STIXGeneral-Regular", b"DejaVuSans"} <= fonts
    assert "dummy symbol" not in caplog.text  # which Matplotlib draws instead of a letter that no font has


def test_figures_are_byte_for_byte_the_same(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    for name in ("one", "two"):
        save(draw(), tmp_path / name, "synthetic twin")
    for ending in ("svg", "pdf"):
        assert (tmp_path / f"one.{ending}").read_bytes() == (tmp_path / f"two.{ending}").read_bytes()


def test_notebook_keeps_its_style_and_windows(tmp_path):
    with plt.rc_context({"font.size": 17, "axes.grid": False, "svg.hashsalt": "own"}):
        before, backend, windows = dict(plt.rcParams), plt.get_backend(), plt.get_fignums()
        save(draw(), tmp_path / "figure", "synthetic twin")
        assert (dict(plt.rcParams), plt.get_backend(), plt.get_fignums()) == (before, backend, windows)
    save(draw(), tmp_path / "other", "synthetic twin")
    assert (tmp_path / "figure.svg").read_bytes() == (tmp_path / "other.svg").read_bytes()
    save(draw(), tmp_path / "own", "laboratory X")
    assert (tmp_path / "figure.svg").read_bytes() != (tmp_path / "own.svg").read_bytes()


@house_style
def test_save_writes_same_files_as_savefig(tmp_path):
    figure, axes = new_figure()
    axes.plot([0, 1])
    axes.set_title("office, (a)", fontweight="bold")
    axes.set_xlabel(r"Stiffness $k_\mathrm{e}$ in N·mm$^{-1}$")
    axes.pcolormesh([1, 10, 100], [0, 0.5, 1], [[1, 2], [3, 4]], rasterized=True)
    axes.set_xscale("log")
    save(figure, tmp_path / "saved", "")
    description = "Drawing without data"
    figure.savefig(tmp_path / "plain.svg", metadata={"Date": None, "Description": description})
    dates = dict.fromkeys(("CreationDate", "ModDate"))
    figure.savefig(tmp_path / "plain.pdf", metadata={**dates, "Subject": description})
    for ending in ("svg", "pdf"):
        saved = (tmp_path / f"saved.{ending}").read_bytes()
        assert saved == (tmp_path / f"plain.{ending}").read_bytes()
    assert b"/Type3" not in saved


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


def test_intervals_end_at_the_given_shares():
    picks = {
        "KB": {"percent": 40.0, "wilson_percent": [30.0, 51.0], "goodman_percent": [25.0, 57.0]},
        "HO": {"percent": 60.0, "wilson_percent": [49.0, 70.0], "goodman_percent": [43.0, 75.0]},
    }
    axes = best_picks_figure(picks, 0.95).axes[0]
    assert [bar.get_height() for bar in axes.patches] == [40.0, 60.0]
    bars = [container[2] for container in axes.containers if hasattr(container, "has_yerr")]
    segments = [lines.get_segments() for stems in bars for lines in stems]
    ends = [[tuple(segment[:, 1]) for segment in kind] for kind in segments]
    assert ends == [[(30.0, 51.0), (49.0, 70.0)], [(25.0, 57.0), (43.0, 75.0)]]
    assert axes.get_ylim()[1] >= 75


@pytest.fixture(scope="module")
def drawn(twin_lift):
    subject, settings = subject_settings("novice"), study_settings().lifting
    lift = lumbar.lift(twin_lift("novice_23kg"), subject, trial=subject.trials[0], settings=settings)
    files = dict(lift.files())
    frames = {name: files[f"{name}.csv"] for name in ("motion", "landmarks", "body")}
    more = {"states": lift.states, "events": lift.events, "summary": files["pendulum.json"]}
    return {**frames, **more, "centres": files["com.csv"]}


def test_every_event_is_in_every_panel(drawn):
    events = drawn["events"]
    times = sorted([*(event["time_s"] for event in events.values()), events["deposit_start"]["thesis_s"]])
    for axis in events_figure(drawn).axes:
        vertical = [line.get_xdata() for line in axis.lines if len(set(line.get_xdata())) == 1]
        assert sorted(float(place[0]) for place in vertical) == pytest.approx(times)


def test_table_2_1_shows_the_analogues_and_every_reference_it_names(tmp_path):
    pictures = [analogue_picture(model) for model in TABLE_2_1]
    assert len(set(pictures)) == len(TABLE_2_1)
    table = table_2_1("definitions", pictures)
    shown = re.findall(r'<img alt="" src="data:image/svg\+xml,([^"]+)"><br>([^<]+)</td>', table.to_html())
    assert [unquote(picture) for picture, _ in shown] == [text.replace('"', "'") for text in pictures]
    assert [unescape(text) for _, text in shown] == table.frame["mechanical_analogue"].tolist()
    named = re.findall(r"(\w+) (\d{4})", " ".join(table.frame["references"]))
    assert all(any(name in full and year in full for full in REFERENCES) for name, year in named)


def test_figure_4_1_draws_the_pendulum_of_the_total_body(drawn):
    pendulum = PendulumSettings(damping_N_m_s=0.0)
    angles, torques, person = pendulum_figure(drawn, pendulum).axes
    facts, centres = drawn["summary"], drawn["centres"].query("com == 'pelvis' and phase == 'deposit'")
    body = drawn["body"].query("phase == 'deposit'")
    relative = np.stack(
        [body[f"WHOLE_BODY_{axis}_m"].to_numpy() - centres[f"pivot_{axis}_m"].to_numpy() for axis in "yz"], 1
    )
    rod = next(line.get_xydata() for line in person.lines if line.get_linewidth() == 2.0)
    length = np.hypot(*relative.T).mean()
    assert np.hypot(*(rod[1] - rod[0])) == pytest.approx(length, abs=2e-3)
    total = angles.lines[0].get_ydata()
    assert total[-1] == pytest.approx(np.arctan2(*relative[-1]), abs=2e-3)
    assert np.arctan2(*(rod[1] - rod[0])) == pytest.approx(total[-1])
    text = " ".join(text.get_text() for text in person.texts)
    assert all(word in text for word in (f"m = {facts['body_mass_kg']:g} kg", "ℓ = ", "u_0", "θ"))
    # The two signs of gravity differ by 2·m·g·ℓ·sin θ.
    inverted, hanging = (line.get_ydata() for line in torques.lines)
    weight = facts["body_mass_kg"] * pendulum.gravity_m_s2 * np.hypot(*(rod[1] - rod[0]))
    assert hanging - inverted == pytest.approx(2 * weight * np.sin(total))
    states = drawn["states"].set_index(["com", "plane"])["angle_rad"]
    for line, com in zip(angles.lines[1:], ("thorax", "abdomen", "pelvis"), strict=True):
        assert line.get_ydata() == pytest.approx(states[com, "flexion_extension"].to_numpy())


def test_figure_4_2_draws_the_segments_between_the_markers_and_the_ends_in_use(drawn):
    front, back, side = segments_figure(drawn).axes
    at_start = drawn["landmarks"].query("event == 'deposit_start'").set_index("point")
    places = at_start[["x_m", "z_m"]]
    for axis in (front, back):
        pieces = [patch.get_xy() for patch in axis.patches]
        for piece, (upper, lower) in zip(pieces, pairwise(["C7", "T12", "L5"]), strict=False):
            for marker in (upper, lower):
                assert np.isclose(piece, places.loc[marker].to_numpy(float)).all(axis=1).any()
        for marker in ("L_HIP", "R_HIP"):
            assert np.isclose(pieces[2], places.loc[marker].to_numpy(float)).all(axis=1).any()
    names = [[text.get_text() for text in axis.texts] for axis in (front, back)]
    assert "manubrium" in names[0] and "manubrium" not in names[1] and "sacrum" in names[1]
    assert front.xaxis_inverted() and not back.xaxis_inverted()
    bands = [line.get_xydata() for line in side.lines if line.get_linewidth() == 7]
    for band, pair in zip(bands, [("C7T1", "T12L1"), ("T12L1", "L4L5"), ("L4L5", "MID_HIP")], strict=True):
        assert np.allclose(band, at_start.loc[list(pair), ["y_m", "z_m"]].to_numpy(float))


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
    comparisons = [
        compare_record(periodic, simulated, floor),
        compare_record(other, response, floor, "multisine"),
    ]
    figure = record_comparison_figure(periodic, simulated, comparisons)
    low, high = default_segment(periodic, simulated, comparisons[0].start)
    response_axis, residual_axis, shares = figure.axes
    measured, model = (line.get_ydata() for line in response_axis.lines)
    inside = (periodic.time >= low - 1e-9) & (periodic.time <= high + 1e-9)
    assert measured == pytest.approx(periodic["output"][inside])
    assert model == pytest.approx(simulated[inside])
    assert residual_axis.lines[0].get_ydata() == pytest.approx(measured - model)
    assert residual_axis.patches[0].get_height() == pytest.approx(4 * floor.rms)
    heights = [[bar.get_height() for bar in container] for container in shares.containers[:2]]
    left = [100 * item.rms.value**2 / item.output_variance for item in comparisons]
    assert np.sum(heights, axis=0) == pytest.approx(left)
    assert heights[1] == pytest.approx([item.explainable_percent for item in comparisons])
    assert [tick.get_text() for tick in shares.get_xticklabels()] == ["multisine", "a record of noise"]
    texts = " ".join(text.get_text() for text in shares.texts)
    assert f"{comparisons[0].vaf.value:.4g} %" in texts
    assert len({line.get_linestyle() for line in response_axis.lines}) == 2


def test_default_segment_has_typical_error():
    error = np.concatenate([np.full(2000, 5.0), np.full(6000, 1.0), np.full(1000, 9.0)])
    test = record(np.arange(9000.0), error)
    low, high = default_segment(test, np.zeros(9000), 0.5)
    assert 2000 * STEP <= low < high <= 8000 * STEP + STEP


def test_location_figure_shows_depth_and_reversals(tests):
    periodic, simulated = tests[0]
    residual = residual_after(periodic, simulated, noise_floor(periodic))
    location = Location.from_residual(periodic.name, residual, rank_causes([residual]))
    figure = location_figure(location)
    time, depth, turning = figure.axes
    for axis in figure.axes:
        assert axis.get_xlabel() and axis.get_ylabel()
    assert time.patches[0].get_data().values == pytest.approx(location.views["time"].table["rms"])
    assert depth.lines[0].get_ydata() == pytest.approx(
        location.views["position and velocity"].table["mean"], nan_ok=True
    )
    assert turning.lines[0].get_ydata() == pytest.approx(location.views["reversals"].table["mean"])
    assert len({str(line._dash_pattern) for line in depth.lines[:3]}) == 3
    assert f"depth: {100 * location.shares['depth']:.0f} %" in depth.get_title(loc="right")
    assert f"noise {location.residual.floor.rms:.3g} N" in figure.get_suptitle()


@pytest.mark.parametrize(("start", "place"), [(0.6, "inside"), (1.1, "around"), (1.0, "not always inside")])
def test_basin_is_compared_with_the_regulators_ellipse_by_its_points(start, place):
    """Points of V = ρ(0), from a factor of S, against the ellipse V ≤ 1; not by the levels."""
    rows = pd.DataFrame({"com": "pelvis", "plane": "lateral_bending", "rho": [start, 2.0]})
    factor = np.linalg.cholesky(np.array([[3.0, 1.0], [1.0, 0.5]]))
    angle = np.linspace(0, 2 * np.pi, 60)
    points = np.sqrt(start) * np.linalg.solve(factor.T, [np.cos(angle), np.sin(angle)])
    cost = np.sum(points * (factor @ factor.T @ points), axis=0)
    assert {"inside": cost.max() < 1, "around": cost.min() > 1}.get(place, np.allclose(cost, 1))
    assert (
        compare_with_regulator(rows, 1.0)
        == f"at t = 0 {place} the regulator's ellipse, ρ(0) = {start:.2f} to {start:.2f}"
    )
    assert compare_with_regulator(rows.iloc[:0], 1.0) == ""
