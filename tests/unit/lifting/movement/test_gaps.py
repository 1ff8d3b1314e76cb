"""Gap filling: closed forms, real trajectories with gaps cut into them, and what is never filled."""

import numpy as np
import pytest
from lifting_cases import missing_share

from lumbar.base.errors import InputError
from lumbar.lifting.movement.gaps import (
    ALONE,
    AT_END,
    AT_START,
    FILLED,
    TOO_LONG,
    fill_gaps,
    refuse_open_gaps,
    without_islands,
)
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
    cleaned, islands = without_islands(recording, 17)
    assert [(item.first_frame, item.n_frames) for item in islands] == [(10, 1), (40, 17)]
    assert np.isnan(cleaned["C7"][:100]).all() and (cleaned["C7"][100:] == 3.0).all()
    with pytest.raises(InputError, match="200 frames; the filter needs more than 200"):
        without_islands(recording, 200)


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
