"""Markers hidden where nothing needs them: a real recording with stray frames, and what a gap costs where it matters."""

from dataclasses import replace

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.lifting.movement.gaps import ISLAND, without_islands
from lumbar.lifting.movement.lift import analyse_lift
from lumbar.lifting.movement.lift_tables import gaps_frame
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.settings.layout import MarkerLayout
from lumbar.settings.lifting import GapSettings, LiftingSettings
from lumbar.settings.plain import from_plain
from lumbar.settings.subject import SubjectSettings, TrialSettings

ANN = SubjectSettings("ann", "female", 61.0, 1.68, "novice")
TRIAL = TrialSettings(0, "squat.c3d")
SQUAT = from_plain(
    MarkerLayout,
    {
        "up": "+y",
        "forward": "+z",
        "check_axes": False,
        "required": [],
        "aliases": {
            "C7": "C7",
            "SACRUM": {"mean": ["LBWT", "RBWT"]},
            "T12": {"between": ["T10", "SACRUM"], "share": 0.26},
            "L5": {"between": ["T12", "SACRUM"], "share": 0.65},
            "L_HIP": "LFWT",
            "R_HIP": "RFWT",
            "R_WRIST": "ROWR",
            "L_WRIST": "LOWR",
            "L_ANKLE": "LHEL",
            "R_ANKLE": "RHEL",
        },
    },
)


def hidden(recording, marker, *stretches):
    points = recording[marker].copy()
    for stretch in stretches:
        points[stretch] = np.nan
    return replace(recording, positions={**recording.positions, marker: points})


@pytest.fixture(scope="module")
def squat(shared):
    return read_markers(shared / "real" / "lifting" / "athlete_floor_pickup_squats" / "squat.c3d", SQUAT)


@pytest.fixture(scope="module")
def settings():
    return LiftingSettings(markers=SQUAT, segment_ends="skin")


@pytest.mark.parametrize("longer", ["keep", "error"])
def test_stray_frames_of_a_marker_end_no_lift(squat, settings, longer):
    """One frame of a marker between two long gaps cannot be filtered; it is left out, and named."""
    stray = hidden(squat, "R_HIP", slice(400, 600), slice(601, 900))
    lift = analyse_lift(stray, "squat", ANN, TRIAL, replace(settings, gaps=GapSettings(longer="keep")))
    rows = gaps_frame(lift)
    islands = rows[rows["outcome"] == ISLAND]
    assert 1 in set(islands["frames"])
    if longer == "error":
        with pytest.raises(InputError, match="R_HIP: not seen for"):
            analyse_lift(stray, "squat", ANN, TRIAL, replace(settings, gaps=GapSettings(longer="error")))


def test_only_what_needs_a_hidden_marker_is_left_out(squat, settings):
    gone = hidden(squat, "C7", slice(2240, 2300))  # during the deposit, from 18.6 to 19.2 s
    lift = analyse_lift(gone, "squat", ANN, TRIAL, settings)
    assert "samples missing within the deposit" in lift.missing["thorax"]
    assert {com for com, _ in lift.states} == set(lift.centres) - set(lift.missing)
    after = hidden(squat, "C7", slice(2480, 2539))
    assert "thorax" not in analyse_lift(after, "squat", ANN, TRIAL, settings).missing


def test_an_island_is_what_a_filter_cannot_take():
    points = np.full((200, 3), np.nan)
    points[10], points[40:57], points[100:] = 1.0, 2.0, 3.0
    recording = MarkerRecording("x", np.arange(200) / 100, 100.0, {"C7": points})
    cleaned, islands = without_islands(recording, 17)
    assert [(item.first_frame, item.n_frames) for item in islands] == [(10, 1), (40, 17)]
    assert np.isnan(cleaned["C7"][:100]).all() and (cleaned["C7"][100:] == 3.0).all()
    with pytest.raises(InputError, match="200 frames; the filter needs more than 200"):
        without_islands(recording, 200)
