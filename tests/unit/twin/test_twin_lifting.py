"""The synthetic lifts: people as declared, bodies that hold together, files as laboratories write them, for every reader."""

import warnings
from dataclasses import replace

import c3d
import ezc3d
import numpy as np
import pytest
from lifting_cases import missing_share

from lumbar.base.errors import InputError
from lumbar.lifting.movement.gaps import fill_gaps
from lumbar.records.c3d_file import read_c3d
from lumbar.records.markers import read_markers
from lumbar.twin.lifter import ARM_LENGTH
from lumbar.twin.lifting_recordings import true_movement, write_c3d, write_lift
from study_settings import changed, study_settings, subject_settings

LIFTS = ("expert_23kg", "expert_15kg", "novice_23kg", "novice_15kg")


@pytest.fixture(scope="module")
def twin(project):
    return study_settings().twin.lifting


@pytest.fixture(scope="module")
def movements(twin):
    return {lift: true_movement(twin, lift) for lift in LIFTS}


def test_the_study_declares_the_people_and_lifts_of_the_twin(project, twin):
    declared = {}
    for name, person in twin.people.items():
        subject = subject_settings(name)
        assert (subject.mass_kg, subject.height_m) == (person.mass_kg, person.height_m)
        declared |= {f"{name}_{trial.box_mass_kg:g}kg": trial.box_mass_kg for trial in subject.trials}
    assert declared == {name: lift.box_mass_kg for name, lift in twin.lifts.items()}


@pytest.mark.parametrize("lift", LIFTS)
def test_the_body_holds_together(twin, movements, lift):
    markers, time = movements[lift].markers, movements[lift].time
    for start, stop in (
        ("L_SHOULDER", "R_SHOULDER"),
        ("L_HIP", "R_HIP"),
        ("C7", "MANUBRIUM"),
        ("L_HEEL", "L_TOE"),
    ):
        length = np.linalg.norm(markers[start] - markers[stop], axis=1)
        assert np.ptp(length) < 1e-9
    height = twin.people[twin.lifts[lift].person].height_m
    events = twin.lifts[lift].events_s
    held = (time >= events.lift_off) & (time <= events.release)
    for side in "LR":
        arm = np.linalg.norm(markers[f"{side}_SHOULDER"] - markers[f"{side}_WRIST"], axis=1) / (
            ARM_LENGTH * height
        )
        # Shoulders give way by a few centimetres when the hands reach out.
        assert arm.max() < 1.10
        assert arm[held].max() < 1.02
        grip = markers[f"{side}_WRIST"] - markers["BOX_1"]
        assert np.ptp(grip[held], axis=0).max() < 1e-9
    assert min(points[:, 2].min() for points in markers.values()) > 0
    assert np.ptp(markers["BOX_1"][time < events.lift_off], axis=0).max() == 0
    assert np.ptp(markers["BOX_1"][time > events.release], axis=0).max() == 0


@pytest.mark.parametrize("lift", ["expert_23kg", "novice_15kg"])
def test_the_file_holds_the_movement_with_noise_and_short_gaps(twin, movements, lift, tmp_path):
    write_lift(twin, lift, [1], tmp_path / "lift.c3d", tmp_path / "moment.csv")
    recording = read_markers(tmp_path / "lift.c3d", study_settings().lifting.markers)
    assert recording.rate == 100
    assert recording.time == pytest.approx(movements[lift].time)
    errors = np.concatenate([recording[name] - true for name, true in movements[lift].markers.items()])
    assert np.nanstd(errors) == pytest.approx(5e-4, rel=0.02)
    filled, gaps = fill_gaps(recording, 0.2)
    assert len(gaps) == twin.gaps.count
    assert max(gap.length_s for gap in gaps) <= twin.gaps.longest_s + 1e-9
    assert missing_share(filled) == 0
    assert not recording.derived
    # Joints that the lifter does not mark: they serve the comparison with force plates alone.
    assert set(recording.absent) == {f"{side}_{joint}" for side in "LR" for joint in ("ELBOW", "KNEE")}


def test_the_same_seed_writes_the_same_bytes_and_another_seed_others(twin, tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        write_lift(twin, "expert_15kg", [seed], tmp_path / f"{name}.c3d", tmp_path / f"{name}.csv")
    for ending in ("c3d", "csv"):
        first, again, other = ((tmp_path / f"{name}.{ending}").read_bytes() for name in "abc")
        assert first == again
        assert first != other


@pytest.mark.parametrize(
    ("times", "words"), [((2.3, 2.2, 5.8, 7.1), "must follow"), ((2.3, 3.9, 5.8, 9.4), "before duration_s")]
)
def test_a_movement_that_cannot_be_is_refused(twin, times, words):
    events = dict(zip(("lift_off", "toe_off", "deposit_start", "release"), times, strict=True))
    settings = changed(twin, lifts={"expert_23kg": {"events_s": events}})
    with pytest.raises(InputError, match=words):
        true_movement(settings, "expert_23kg")


def test_a_recording_too_long_for_a_c3d_file_is_refused(twin):
    settings = replace(twin, duration_s=95.0, rate_Hz=1000.0)
    with pytest.raises(InputError, match="95000 frames"):
        true_movement(settings, "expert_23kg")


LABELS = ["ann:C7", "ann:SACRUM", "box:BOX_1"]


def test_written_file_holds_the_same_for_every_reader(tmp_path):
    points = np.random.default_rng(3).normal(0, 700, (50, 3, 3))
    points[7:9, 1] = np.nan
    path = tmp_path / "lift.c3d"
    write_c3d(path, points, LABELS, 120.0, "mm")
    own = read_c3d(path)
    assert (own.rate, own.unit, list(own.positions), own.notes) == (120, "mm", LABELS, ())
    np.testing.assert_array_equal(own.positions["ann:SACRUM"], points[:, 1].astype("f4"))
    content = ezc3d.c3d(str(path))
    np.testing.assert_array_equal(content["data"]["points"][:3].transpose(2, 1, 0), points.astype("f4"))
    assert content["parameters"]["POINT"]["LABELS"]["value"] == LABELS
    with path.open("rb") as stream, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the analog part, which there is not
        reader = c3d.Reader(stream)
        quads = np.array([quads for _, quads, _ in reader.read_frames()])
    np.testing.assert_array_equal(quads[..., 3] < 0, np.isnan(points[..., 0]))
    assert [label.strip() for label in reader.point_labels] == LABELS
