"""Gaps of rigid bodies, filled from their other markers: closed forms, and a real box."""

import numpy as np
import pytest
from lifting_cases import hide
from scipy.spatial.transform import Rotation

import lumbar
from lumbar.lifting.movement.cleaning import fill_gaps
from lumbar.lifting.movement.rigid_filling import body_shape, fill_from_body, fill_rigid, fit_shape
from lumbar.records.markers import MarkerRecording
from refusing import has_tokens

RATE = 100.0
CORNERS = np.array([[0, 0, 0], [0.4, 0, 0], [0.4, 0.3, 0], [0, 0.3, 0.2], [0.1, 0.1, 0.2]], dtype=float)
LABELS = tuple("ABCDE")


def moving():
    """A body that turns by two thirds of a turn about a skew axis while it flies along a parabola."""
    time = np.arange(300) / RATE
    turns = Rotation.from_rotvec(np.outer(time * 1.4, [0.6, 0.3, np.sqrt(1 - 0.45)]))
    path = np.stack([time, -0.5 * time**2, 1 + 0.2 * time], axis=1)
    points = np.stack([turns.apply(corner) + path for corner in CORNERS], axis=1)
    return {label: points[:, index] for index, label in enumerate(LABELS)}


def test_the_fit_is_the_rotation_that_scipy_finds():
    rng = np.random.default_rng(0)
    turn = Rotation.random(random_state=1)
    frames = turn.apply(CORNERS) + np.array([1, 2, 3]) + rng.normal(0, 0.01, CORNERS.shape)
    expected, _ = Rotation.align_vectors(frames - frames.mean(axis=0), CORNERS - CORNERS.mean(axis=0))
    placed = expected.apply(CORNERS - CORNERS.mean(axis=0)) + frames.mean(axis=0)
    np.testing.assert_allclose(fit_shape(CORNERS, frames[None])[0], placed, atol=1e-12)


@pytest.mark.parametrize("gap", [slice(100, 190), slice(0, 90), slice(220, 300)])
def test_a_rigid_body_is_restored_exactly(gap):
    points = moving()
    shape = body_shape(hide(points, gap, "C"), LABELS, "this recording")
    assert shape.residual_m < 1e-12
    filled, gaps = fill_rigid(hide(points, gap, "C"), RATE, 3.0, shape, "box", 0.2)
    np.testing.assert_allclose(filled["C"], points["C"], atol=1e-10)
    assert [(item.marker, item.first_frame, item.n_frames, item.filled) for item in gaps] == [
        ("C", gap.start, gap.stop - gap.start, True)
    ]
    assert gaps[0].start_s == pytest.approx(3.0 + gap.start / RATE)
    assert has_tokens(gaps[0].method, "box…this recording…0.0 mm")


def test_the_error_at_the_edges_is_spread_over_the_gap():
    """A marker that slid by 1 cm since the shape was taken comes back without a jump."""
    points = moving()
    shape = body_shape(points, LABELS, "the static trial")
    slid = {**points, "C": points["C"] + 0.01}
    filled, _ = fill_rigid(hide(slid, slice(100, 190), "C"), RATE, 0.0, shape, "box", 0.2)
    np.testing.assert_allclose(filled["C"], slid["C"], atol=1e-10)


def test_short_gaps_and_bodies_of_two_markers_are_not_filled():
    points = moving()
    shape = body_shape(points, LABELS, "the static trial")
    short = hide(points, slice(100, 110), "C")
    filled, gaps = fill_rigid(short, RATE, 0.0, shape, "box", 0.2)
    assert not gaps
    np.testing.assert_array_equal(filled["C"], short["C"])
    lonely = hide(hide(points, slice(0, 300), "A", "B"), slice(100, 190), "C")
    filled, gaps = fill_rigid(lonely, RATE, 0.0, shape, "box", 0.2)
    assert np.isnan(filled["C"][100:190]).all()
    assert "C" not in {gap.marker for gap in gaps}


def test_body_with_markers_on_one_line_is_not_restored():
    line = {label: np.tile([0.1 * index, 0.0, 1.0], (50, 1)) for index, label in enumerate("ABC")}
    points = {**line, "D": np.tile([0.0, 0.2, 1.0], (50, 1))}
    shape = body_shape(points, "ABCD", "the static trial")
    filled, gaps = fill_rigid(hide(points, slice(10, 40), "D"), RATE, 0.0, shape, "box", 0.2)
    assert np.isnan(filled["D"][10:40]).all()
    assert not gaps


def test_hidden_corner_of_a_real_box_is_restored_within_5_mm(shared):
    """A spline through the same gap is off by ten times as much: the box is swung onto a shelf meanwhile."""
    file = shared / "real" / "lifting" / "s2m_box_transfer" / "Vicon.c3d"
    recording = lumbar.read(file, layout=lumbar.MarkerLayout(forward="-x", check_axes=False))
    box = [f"{place}_{side}" for place in ("gauche", "droite") for side in ("ext", "int")]
    box += [f"{place}_{side}" for place in ("avant", "arriere") for side in ("gauche", "droit")]
    points, gap = {label: recording[label] for label in box}, slice(230, 330)
    truth = points["avant_droit"][gap]
    cut = hide(points, gap, "avant_droit")
    shape = body_shape(cut, box, "this recording")
    filled, _ = fill_rigid(cut, recording.rate, 0.0, shape, "box", 0.2)
    error = np.linalg.norm(filled["avant_droit"][gap] - truth, axis=1)
    assert np.nanmax(error) < 0.005
    by_spline, _ = fill_gaps(MarkerRecording("box", recording.time, recording.rate, cut), 1.0)
    assert np.nanmax(np.linalg.norm(by_spline["avant_droit"][gap] - truth, axis=1)) > 10 * np.nanmax(error)


@pytest.mark.parametrize("label", LABELS)
def test_a_body_carries_each_of_its_markers(label):
    points = moving()
    filled, frames = fill_from_body(hide(points, slice(20, 40), label))
    assert frames == {label: 20}
    assert filled[label] == pytest.approx(points[label], abs=1e-12)
