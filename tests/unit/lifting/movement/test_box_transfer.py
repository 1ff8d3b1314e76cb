"""The study of a recorded box: where its rules for missing markers come from, and that it runs."""

import ezc3d
import numpy as np
import pytest

from lumbar.lifting.movement.lift import analyse_lift
from lumbar.lifting.movement.lift_tables import summary
from lumbar.records.markers import read_markers
from study_settings import study_settings, subject_settings


@pytest.fixture(scope="module")
def study(project):
    return study_settings("studies/box_transfer.yaml").lifting, subject_settings("box_transfer")


def raw(path):
    """Mean of every marker in metres, read by ezc3d directly."""
    file = ezc3d.c3d(str(path))
    labels = file["parameters"]["POINT"]["LABELS"]["value"]
    return dict(zip(labels, file["data"]["points"][:3].transpose(1, 2, 0) / 1000, strict=True))


def share_along(start, end, point):
    """Share of the way from `start` to `end` at which `point` lies, in the mean over time."""
    line, offset = end - start, point - start
    return float(np.nanmean(np.sum(line * offset, axis=1) / np.sum(line**2, axis=1)))


def test_t12_lies_where_a_static_trial_with_the_whole_spine_has_it(study, shared):
    points = raw(shared / "real" / "lifting" / "athlete_static_full_spine" / "c3dfile1.c3d")
    sacrum = (points["LPSI"] + points["RPSI"]) / 2
    t10 = points["T12"] + (points["T6"] - points["T12"]) / 3
    rule = study[0].markers.aliases["T12"]
    assert rule.between == ("T10", "SACRUM")
    assert rule.share == pytest.approx(share_along(t10, sacrum, points["T12"]), abs=0.005)


def test_the_recording_becomes_pendulums_that_say_what_was_assumed(study, shared):
    settings, subject = study
    recording = read_markers(shared / "real" / "lifting" / "s2m_box_transfer" / "Vicon.c3d", settings.markers)
    trial = subject.trials[0]
    lift = analyse_lift(recording, "box_transfer_6kg", subject, trial, settings)
    facts = summary(lift, subject, trial, settings)
    said = " ".join(facts["assumptions"])
    for assumed in ("mass_kg = 60", "box_mass_kg = 6", "C7", "T12", "L5", "L_HIP", "R_HIP"):
        assert assumed in said
    assert facts["pivot"] == "hip"
    # The line of the two ASIS, seen from above, is the person's own lateral axis.
    across = np.nanmean(
        raw(recording.source)["Daphnee:ASISr"] - raw(recording.source)["Daphnee:ASISl"], axis=0
    )
    standing = np.arctan2(across[0], across[1])
    assert abs(facts["heading_rad"]) == pytest.approx(abs(standing), abs=0.2)
    for (com, plane), states in lift.states.items():
        assert 0.1 < states.length.mean() < 0.6, (com, plane)
        assert np.abs(states.angle).max() < 1.0
        assert np.abs(states.angular_velocity).max() < 1.5
