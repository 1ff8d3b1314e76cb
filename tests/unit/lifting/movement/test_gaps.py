"""Gaps of single markers: closed forms, trajectories with gaps cut into them, gaps that are never filled."""

from dataclasses import replace

import numpy as np
import pytest
from lifting_cases import ANN, hide, recording_of, true_recording

import lumbar
from refusing import has_tokens
from study_settings import changed

LIFTING = lumbar.load_settings().lifting
RATE = 100.0
TIME = np.arange(200) / RATE
FILLED, TOO_LONG, AT_START, AT_END = "filled", "longer than allowed", "at the start", "at the end"
ALONE, ISLAND = "too few frames next to it", "seen too briefly to be filtered: left out"
TRUNK = {"T12": 1.2, "L5": 1.0, "L_HIP": 0.9, "R_HIP": 0.9}


def clean(points, rate=RATE, **markers):
    """A marker C7 after gaps were filled, without filter, and its gaps."""
    rest = {name: np.tile([0.0, 0.0, height], (len(points), 1)) for name, height in TRUNK.items()}
    settings = changed(LIFTING, segment_ends="skin")
    lift = lumbar.lift(recording_of({**rest, "C7": points, **markers}, rate), ANN, 0.0, settings=settings)
    return lift.analysed.complete["C7"], [gap for gap in lift.analysed.gaps if gap.marker == "C7"]


def with_gaps(points, *gaps):
    points = np.array(points, dtype=float)
    for gap in gaps:
        points[gap] = np.nan
    return points


CUBIC = np.stack([TIME**3 - 2 * TIME, 0.5 - TIME**2, 0.1 * TIME**3 + TIME], axis=1)


@pytest.mark.parametrize("gap", [slice(50, 51), slice(50, 70), slice(2, 12), slice(190, 198)])
def test_cubic_motion_is_restored_exactly(gap):
    """A cubic spline reproduces cubics; the gaps reach within two frames of the ends."""
    filled, gaps = clean(with_gaps(CUBIC, gap))
    np.testing.assert_allclose(filled, CUBIC, atol=1e-9)
    assert [(actual.first_frame, actual.n_frames, actual.outcome) for actual in gaps] == [
        (gap.start, gap.stop - gap.start, FILLED)
    ]
    assert gaps[0].start_s == pytest.approx(TIME[gap.start])
    assert gaps[0].length_s == pytest.approx((gap.stop - gap.start) / RATE)


def test_seen_frames_are_unchanged():
    noisy = CUBIC + np.random.default_rng(0).normal(0, 0.001, CUBIC.shape)
    holes = with_gaps(noisy, slice(20, 25), slice(100, 118))
    filled, gaps = clean(holes, L_WRIST=noisy)
    visible = np.isfinite(holes[:, 0])
    np.testing.assert_array_equal(filled[visible], holes[visible])
    assert np.isfinite(filled).all() and len(gaps) == 2
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
    points, gaps = clean(with_gaps(CUBIC, gap))
    assert np.isnan(points[gap]).all()
    np.testing.assert_array_equal(points[gap.stop :], CUBIC[gap.stop :])
    assert gaps[0].outcome == outcome


@pytest.mark.parametrize("rate", [50.0, 60.0, 100.0, 120.0, 240.0, 1000.0])
def test_longest_gap_is_filled_at_every_rate(rate):
    frames = round(0.2 * rate)
    points = np.stack([(np.arange(6 * frames) / rate) ** 2] * 3, axis=1)
    filled, _ = clean(with_gaps(points, slice(2 * frames, 3 * frames)), rate)
    np.testing.assert_allclose(filled, points, atol=1e-9)


def test_single_frame_between_two_gaps_is_not_enough():
    filled, gaps = clean(with_gaps(CUBIC, slice(50, 55), slice(56, 70)))
    assert [gap.outcome for gap in gaps] == [FILLED, FILLED]  # both within 0.2 s of two seen frames
    np.testing.assert_allclose(filled, CUBIC, atol=1e-9)
    _, gaps = clean(with_gaps(CUBIC, slice(20, 50), slice(51, 61), slice(62, 100)))
    assert [gap.outcome for gap in gaps[:3]] == [TOO_LONG, ALONE, TOO_LONG]


def test_islands_too_short_for_the_filter_are_left_out():
    points = np.full((200, 3), np.nan)
    points[10], points[40:57], points[100:] = 1.0, 2.0, 3.0
    cleaned, gaps = clean(points)
    assert [(gap.first_frame, gap.n_frames) for gap in gaps if gap.outcome == ISLAND] == [(10, 1), (40, 17)]
    assert np.isnan(cleaned[:100]).all() and (cleaned[100:] == 3.0).all()
    with pytest.raises(lumbar.InputError, match=r"lift\.c3d: 17 .*\b17\b"):
        clean(CUBIC[:17])


def test_gaps_cut_into_a_real_lift(shared):
    """0.1 s cut out of a real squat comes back within millimetres."""
    path = shared / "real" / "lifting" / "athlete_floor_pickup_squats" / "squat.c3d"
    real = lumbar.read(path, layout=lumbar.MarkerLayout(up="+y", forward="+x", aliases={"C7": "C7"}))["C7"]
    assert np.isfinite(real).all()
    holes = with_gaps(real, *(slice(start, start + 12) for start in range(100, 2400, 100)))
    filled, gaps = clean(holes)
    assert len(gaps) == 23
    error = np.linalg.norm(filled - real, axis=1)
    assert np.sqrt(np.mean(error[np.isnan(holes[:, 0])] ** 2)) < 0.002
    assert error.max() < 0.01


def test_hidden_spine_of_the_ilium_does_not_hide_hips_and_loin():
    whole = true_recording("novice_23kg")
    bending = replace(whole, positions=hide(whole.positions, slice(200, 300), "L_ASIS"))
    points, expected = (lumbar.lift(body, ANN, 0.0).analysed.points for body in (bending, whole))
    for name in ("MID_HIP", "L5S1", "L4L5"):
        assert points[name] == pytest.approx(expected[name], abs=5e-5)  # filtered up to the gap
        assert has_tokens(points.points[name].rule, "L_ASIS…100")
    assert "100" not in expected.points["MID_HIP"].rule
