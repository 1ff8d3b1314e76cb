"""Gap filling, of single markers and rigid bodies: closed forms, trajectories with gaps cut into them, what is never filled."""

from dataclasses import replace

import numpy as np
import pytest
from lifting_cases import missing_share, true_recording
from scipy.spatial.transform import Rotation

from lumbar.base.errors import InputError
from lumbar.lifting.movement.cleaning import (
    ALONE,
    AT_END,
    AT_START,
    FILLED,
    TOO_LONG,
    fill_gaps,
    remove_islands,
)
from lumbar.lifting.movement.joint_centres import trunk_points
from lumbar.lifting.movement.lift_analysis import refuse_open_gaps
from lumbar.lifting.movement.rigid_filling import body_shape, fill_from_body, fill_rigid, fit_shape
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.settings.layout import MarkerLayout
from refusing import refusal

RATE = 100.0
TIME = 3.2 + np.arange(200) / RATE


def recording(**positions):
    return MarkerRecording("lift", TIME, RATE, positions, source="lift.c3d")


def with_gaps(points, *gaps):
    points = np.array(points, dtype=float)
    for gap in gaps:
        points[gap] = np.nan
    return points


CUBIC = np.stack([TIME**3 - 2 * TIME, 0.5 - TIME**2, 0.1 * TIME**3 + TIME], axis=1)


@pytest.mark.parametrize("gap", [slice(50, 51), slice(50, 70), slice(2, 12), slice(190, 198)])
def test_cubic_motion_is_restored_exactly(gap):
    """A cubic spline reproduces cubics; the gaps reach within two frames of the ends."""
    filled, gaps = fill_gaps(recording(C7=with_gaps(CUBIC, gap)))
    np.testing.assert_allclose(filled["C7"], CUBIC, atol=1e-9)
    assert [(found.first_frame, found.n_frames, found.outcome) for found in gaps] == [
        (gap.start, gap.stop - gap.start, FILLED)
    ]
    assert gaps[0].start_s == pytest.approx(TIME[gap.start])
    assert gaps[0].length_s == pytest.approx((gap.stop - gap.start) / RATE)


def test_seen_frames_stay_as_they_are():
    noisy = CUBIC + np.random.default_rng(0).normal(0, 0.001, CUBIC.shape)
    holes = with_gaps(noisy, slice(20, 25), slice(100, 118))
    filled, gaps = fill_gaps(recording(C7=holes, L5=noisy))
    seen = np.isfinite(holes[:, 0])
    np.testing.assert_array_equal(filled["C7"][seen], holes[seen])
    np.testing.assert_array_equal(filled["L5"], noisy)
    assert np.isfinite(filled["C7"]).all()
    assert {gap.marker for gap in gaps} == {"C7"}
    assert np.isnan(holes[20]).all(), "the input is not changed"


@pytest.mark.parametrize(
    ("gap", "outcome"),
    [
        (slice(50, 71), TOO_LONG),
        (slice(0, 3), AT_START),
        (slice(199, 200), AT_END),
        (slice(1, 5), ALONE),
        (slice(0, 200), AT_START),
    ],
)
def test_gaps_that_are_never_filled(gap, outcome):
    holes = with_gaps(CUBIC, gap)
    kept, gaps = fill_gaps(recording(C7=holes))
    np.testing.assert_array_equal(kept["C7"], holes)
    assert [found.outcome for found in gaps] == [outcome]
    said = refusal(refuse_open_gaps, recording(C7=holes), gaps, 0.2)
    assert f"lift.c3d: 2 problems\n  - C7: not seen for {gaps[0].length_s:.3g} s" in said
    assert f"({outcome})" in said


def test_longest_gap_is_filled_at_every_rate():
    for rate in (50.0, 60.0, 100.0, 120.0, 240.0, 1000.0):
        frames = round(0.2 * rate)
        time = np.arange(6 * frames) / rate
        points = np.stack([time**2] * 3, axis=1)
        holes = with_gaps(points, slice(2 * frames, 3 * frames))
        filled, _ = fill_gaps(MarkerRecording("lift", time, rate, {"C7": holes}))
        np.testing.assert_allclose(filled["C7"], points, atol=1e-9)


def test_a_single_frame_between_two_gaps_is_not_enough():
    holes = with_gaps(CUBIC, slice(50, 55), slice(56, 70))
    kept, gaps = fill_gaps(recording(C7=holes))
    assert [gap.outcome for gap in gaps] == [FILLED, FILLED]  # both within 0.2 s of two seen frames
    np.testing.assert_allclose(kept["C7"], CUBIC, atol=1e-9)
    lone = with_gaps(CUBIC, slice(20, 50), slice(51, 61), slice(62, 100))
    _, gaps = fill_gaps(recording(C7=lone))
    assert [gap.outcome for gap in gaps] == [TOO_LONG, ALONE, TOO_LONG]


def test_an_island_is_what_a_filter_cannot_take():
    points = np.full((200, 3), np.nan)
    points[10], points[40:57], points[100:] = 1.0, 2.0, 3.0
    recording = MarkerRecording("x", np.arange(200) / 100, 100.0, {"C7": points})
    cleaned, islands = remove_islands(recording, 17)
    assert [(item.first_frame, item.n_frames) for item in islands] == [(10, 1), (40, 17)]
    assert np.isnan(cleaned["C7"][:100]).all() and (cleaned["C7"][100:] == 3.0).all()
    with pytest.raises(InputError, match="200 frames; the filter needs more than 200"):
        remove_islands(recording, 200)


@pytest.mark.parametrize("maximum_s", [-0.1, np.nan])
def test_a_longest_gap_that_is_no_length_of_time(maximum_s):
    with pytest.raises(InputError, match="gaps"):
        fill_gaps(recording(C7=CUBIC), maximum_s)


def test_gaps_cut_into_a_real_lift(shared):
    """0.1 s cut out of a real squat comes back within millimetres."""
    path = shared / "real" / "lifting" / "athlete_floor_pickup_squats" / "squat.c3d"
    real = read_markers(path, MarkerLayout(up="+y", forward="+x", aliases={"C7": "C7"}))
    assert missing_share(real) == 0
    holes = real["C7"].copy()
    for start in range(100, 2400, 100):
        holes[start : start + 12] = np.nan
    cut = MarkerRecording("squat", real.time, real.rate, {"C7": holes})
    filled, gaps = fill_gaps(cut)
    assert len(gaps) == 23
    error = np.linalg.norm(filled["C7"] - real["C7"], axis=1)
    assert np.sqrt(np.mean(error[np.isnan(holes[:, 0])] ** 2)) < 0.002
    assert error.max() < 0.01


CORNERS = np.array([[0, 0, 0], [0.4, 0, 0], [0.4, 0.3, 0], [0, 0.3, 0.2], [0.1, 0.1, 0.2]], dtype=float)
LABELS = tuple("ABCDE")


def moving():
    """A body that turns by two thirds of a turn about a skew axis while it flies along a parabola."""
    time = np.arange(300) / RATE
    turns = Rotation.from_rotvec(np.outer(time * 1.4, [0.6, 0.3, np.sqrt(1 - 0.45)]))
    path = np.stack([time, -0.5 * time**2, 1 + 0.2 * time], axis=1)
    points = np.stack([turns.apply(corner) + path for corner in CORNERS], axis=1)
    return {label: points[:, index] for index, label in enumerate(LABELS)}


def hidden(points, label, gap):
    copy = {name: values.copy() for name, values in points.items()}
    copy[label][gap] = np.nan
    return copy


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
    shape = body_shape(hidden(points, "C", gap), LABELS, "this recording")
    assert shape.residual_m < 1e-12
    filled, gaps = fill_rigid(hidden(points, "C", gap), RATE, 3.0, shape, "box", 0.2)
    np.testing.assert_allclose(filled["C"], points["C"], atol=1e-10)
    assert [(item.marker, item.first_frame, item.n_frames, item.filled) for item in gaps] == [
        ("C", gap.start, gap.stop - gap.start, True)
    ]
    assert gaps[0].start_s == pytest.approx(3.0 + gap.start / RATE)
    assert gaps[0].method == "rigid body: box, shape from this recording, 0.0 mm"


def test_the_error_at_the_edges_is_spread_over_the_gap():
    """A marker that slid by 1 cm since the shape was taken comes back without a jump."""
    points = moving()
    shape = body_shape(points, LABELS, "the static trial")
    slid = {**points, "C": points["C"] + 0.01}
    filled, _ = fill_rigid(hidden(slid, "C", slice(100, 190)), RATE, 0.0, shape, "box", 0.2)
    np.testing.assert_allclose(filled["C"], slid["C"], atol=1e-10)


def test_short_gaps_are_left_to_splines_and_two_markers_tell_nothing():
    points = moving()
    shape = body_shape(points, LABELS, "the static trial")
    short = hidden(points, "C", slice(100, 110))
    filled, gaps = fill_rigid(short, RATE, 0.0, shape, "box", 0.2)
    assert not gaps
    np.testing.assert_array_equal(filled["C"], short["C"])
    lonely = hidden(hidden(hidden(points, "A", slice(0, 300)), "B", slice(0, 300)), "C", slice(100, 190))
    filled, gaps = fill_rigid(lonely, RATE, 0.0, shape, "box", 0.2)
    assert np.isnan(filled["C"][100:190]).all()
    assert "C" not in {gap.marker for gap in gaps}


def test_markers_on_one_line_do_not_tell_how_the_body_turns():
    line = {label: np.tile([0.1 * index, 0.0, 1.0], (50, 1)) for index, label in enumerate("ABC")}
    points = {**line, "D": np.tile([0.0, 0.2, 1.0], (50, 1))}
    shape = body_shape(points, "ABCD", "the static trial")
    filled, gaps = fill_rigid(hidden(points, "D", slice(10, 40)), RATE, 0.0, shape, "box", 0.2)
    assert np.isnan(filled["D"][10:40]).all()
    assert not gaps


def test_a_corner_hidden_for_a_second_of_a_real_box_comes_back_within_5_mm(shared):
    """A spline through the same gap is off by ten times as much: the box is swung onto a shelf meanwhile."""
    file = shared / "real" / "lifting" / "s2m_box_transfer" / "Vicon.c3d"
    recording = read_markers(file, MarkerLayout(forward="-x", check_axes=False))
    box = [f"{place}_{side}" for place in ("gauche", "droite") for side in ("ext", "int")]
    box += [f"{place}_{side}" for place in ("avant", "arriere") for side in ("gauche", "droit")]
    points, gap = {label: recording[label] for label in box}, slice(230, 330)
    truth = points["avant_droit"][gap]
    cut = hidden(points, "avant_droit", gap)
    shape = body_shape(cut, box, "this recording")
    filled, _ = fill_rigid(cut, recording.rate, 0.0, shape, "box", 0.2)
    error = np.linalg.norm(filled["avant_droit"][gap] - truth, axis=1)
    assert np.nanmax(error) < 0.005
    by_spline, _ = fill_gaps(MarkerRecording("box", recording.time, recording.rate, cut), 1.0)
    assert np.nanmax(np.linalg.norm(by_spline["avant_droit"][gap] - truth, axis=1)) > 10 * np.nanmax(error)


@pytest.mark.parametrize("label", LABELS)
def test_a_body_carries_each_of_its_markers(label):
    points = moving()
    filled, frames = fill_from_body(hidden(points, label, slice(20, 40)))
    assert frames == {label: 20}
    assert filled[label] == pytest.approx(points[label], abs=1e-12)


def test_a_spine_of_the_ilium_hidden_while_bending_does_not_hide_hips_and_loin():
    whole = true_recording("novice_23kg")
    bending = replace(whole, positions=hidden(whole.positions, "L_ASIS", slice(200, 300)))
    points, expected = (trunk_points(body, "inner", "harrington", "male") for body in (bending, whole))
    for name in ("MID_HIP", "L5S1", "L4L5"):
        assert points[name] == pytest.approx(expected[name], abs=1e-6)
        assert "L_ASIS in 100 frames" in points.points[name].rule
    assert "frames" not in expected.points["MID_HIP"].rule
