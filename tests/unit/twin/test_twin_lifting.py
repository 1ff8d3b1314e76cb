"""Synthetic lifts and cohorts: declared and independent people, rigid bodies, files for every reader."""

import warnings

import c3d
import ezc3d
import numpy as np
import pytest
from c3d_builder import read_c3d
from lifting_cases import missing_share
from scipy import stats

from lumbar.base.errors import InputError, Problems
from lumbar.lifting.movement.cleaning import fill_gaps
from lumbar.records.c3d_file import write_c3d
from lumbar.records.markers import read_markers
from lumbar.settings.lifting import REFINING
from lumbar.settings.twin import GroupMovement, SyntheticLift, SyntheticPerson
from lumbar.settings.validation import Origins, overlay, validate
from lumbar.study.load_study import load_study
from lumbar.twin.cohort import (
    MAX_DRAWN_SD,
    cohort_lifts,
    cohort_subjects,
    draw_lift,
    draw_person,
    lift_name,
    single_lift_settings,
    single_person_cohort,
)
from lumbar.twin.lifter import ARM_LENGTH
from lumbar.twin.lifting_recordings import true_movement, write_lift
from study_settings import changed, study_config, study_settings, subject_settings

LIFTS = ("expert_23kg", "expert_15kg", "novice_23kg", "novice_15kg")


@pytest.fixture(scope="module")
def twin(project):
    return study_settings().twin.lifting


@pytest.fixture(scope="module")
def movements(twin):
    return {lift: true_movement(twin, lift) for lift in LIFTS}


def test_study_declares_people_and_lifts_of_twin(project, twin):
    declared = {}
    for name, person in twin.people.items():
        subject = subject_settings(name)
        assert (subject.mass_kg, subject.height_m) == (person.mass_kg, person.height_m)
        declared |= {f"{name}_{trial.box_mass_kg:g}kg": trial.box_mass_kg for trial in subject.trials}
    assert declared == {name: lift.box_mass_kg for name, lift in twin.lifts.items()}


@pytest.mark.parametrize("lift", LIFTS)
def test_segments_are_rigid_and_hands_hold_box(twin, movements, lift):
    markers, time = movements[lift].markers, movements[lift].time
    rigid = ("L_SHOULDER", "R_SHOULDER"), ("L_HIP", "R_HIP"), ("C7", "MANUBRIUM"), ("L_HEEL", "L_TOE")
    for start, stop in rigid:
        assert np.ptp(np.linalg.norm(markers[start] - markers[stop], axis=1)) < 1e-9
    height = twin.people[twin.lifts[lift].person].height_m
    events = twin.lifts[lift].events_s
    held = (time >= events.lift_off) & (time <= events.release)
    for side in "LR":
        arm = np.linalg.norm(markers[f"{side}_SHOULDER"] - markers[f"{side}_WRIST"], axis=1)
        # Shoulders give way by a few centimetres when the hands reach out.
        assert arm.max() < 1.10 * ARM_LENGTH * height
        assert arm[held].max() < 1.02 * ARM_LENGTH * height
        grip = markers[f"{side}_WRIST"] - markers["BOX_1"]
        assert np.ptp(grip[held], axis=0).max() < 1e-9
    assert min(points[:, 2].min() for points in markers.values()) > 0
    assert np.ptp(markers["BOX_1"][time < events.lift_off], axis=0).max() == 0
    assert np.ptp(markers["BOX_1"][time > events.release], axis=0).max() == 0


@pytest.mark.parametrize("lift", ["expert_23kg", "novice_15kg"])
def test_file_has_movement_with_noise_and_short_gaps(twin, movements, lift, tmp_path):
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
    assert set(recording.absent) - set(REFINING) == {"L_ELBOW", "L_KNEE", "R_ELBOW", "R_KNEE"}


def test_bytes_depend_only_on_seed(twin, tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        write_lift(twin, "expert_15kg", [seed], tmp_path / f"{name}.c3d", tmp_path / f"{name}.csv")
    for ending in ("c3d", "csv"):
        first, again, other = ((tmp_path / f"{name}.{ending}").read_bytes() for name in "abc")
        assert first == again != other


@pytest.mark.parametrize(
    ("times", "words"), [((2.3, 2.2, 5.8, 7.1), "must follow"), ((2.3, 3.9, 5.8, 9.4), "before duration_s")]
)
def test_impossible_events_are_rejected(twin, times, words):
    events = dict(zip(("lift_off", "toe_off", "deposit_start", "release"), times, strict=True))
    settings = changed(twin, lifts={"expert_23kg": {"events_s": events}})
    with pytest.raises(InputError, match=words):
        true_movement(settings, "expert_23kg")


LABELS = ["ann:C7", "ann:SACRUM", "box:BOX_1"]


def test_written_file_is_equal_for_every_reader(tmp_path):
    points = np.random.default_rng(3).normal(0, 700, (50, 3, 3))
    points[7:9, 1] = np.nan
    path = tmp_path / "lift.c3d"
    write_c3d(path, points, LABELS, 120.0)
    own = read_c3d(path)
    assert (own.rate, own.unit, list(own.positions), own.notes) == (120, "mm", LABELS, ())
    np.testing.assert_array_equal(own.positions["ann:SACRUM"], points[:, 1].astype("f4"))
    content = ezc3d.c3d(str(path))
    np.testing.assert_array_equal(content["data"]["points"][:3].transpose(2, 1, 0), points.astype("f4"))
    assert content["parameters"]["POINT"]["LABELS"]["value"] == LABELS
    with path.open("rb") as stream, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the file has no analog part
        reader = c3d.Reader(stream)
        quads = np.array([quads for _, quads, _ in reader.read_frames()])
    np.testing.assert_array_equal(quads[..., 3] < 0, np.isnan(points[..., 0]))
    assert [label.strip() for label in reader.point_labels] == LABELS


SEED = 45


@pytest.fixture(scope="module")
def cohort():
    return study_settings("studies/cohort.yaml").twin.lifting.cohort


def with_persons(cohort, count, **changes):
    """The cohort with `count` persons in every group."""
    groups = {name: group.model_copy(update={"persons": count}) for name, group in cohort.groups.items()}
    return cohort.model_copy(update={"groups": groups, **changes})


def names_and_groups(cohort):
    return [(name, subject.experience) for name, subject in cohort_subjects(cohort, SEED).items()]


def test_added_person_or_trial_changes_no_other(cohort):
    few, many = (cohort_subjects(with_persons(cohort, count), SEED) for count in (2, 3))
    assert set(many) - set(few) == {"expert_0003", "novice_0003"}
    assert all(many[name] == subject for name, subject in few.items())
    person = draw_person(cohort, "novice_0002", "novice", SEED)
    assert person == draw_person(single_person_cohort(cohort, "novice"), "novice_0002", "novice", SEED)
    more = with_persons(cohort, 2, trials=9)
    assert draw_lift(cohort, person, 23.0, "a_2", SEED) == draw_lift(more, person, 23.0, "a_2", SEED)


def test_lifts_have_names_of_study(cohort):
    subjects = cohort_subjects(with_persons(cohort, 1), SEED)
    named = {name: trial.markers for person in subjects.values() for name, trial in person.lifts.items()}
    expected = [lift_name(person, *lift) for person in subjects for lift in cohort_lifts(cohort)]
    assert list(named) == expected
    assert named["expert_0001_15kg_2"] == "lifting/expert_0001/expert_0001_15kg_2.c3d"


def test_cohort_is_study_of_its_people(project):
    config = study_config("studies/cohort.yaml")
    study = load_study(config, project)
    assert (len(study.subjects), len(study.lifts)) == (20, 120)
    assert sorted(set(study.labels.values())) == ["expert", "novice"]
    assert len(study.lifts_by_person["novice_0010"]) == 6
    renamed = overlay(config, {"stability": {"compare": {"groups": ["trained", "novice"]}}})
    with pytest.raises(InputError, match=r"no subject has the label 'trained'.*expert, novice"):
        load_study(renamed, project)
    alone = {**config, "twin": {"lifting": {"cohort": {"groups": {"expert": {"persons": 4}}}}}}
    with pytest.raises(InputError, match="no subject has the label 'novice'"):
        load_study(alone, project)


def test_people_have_declared_distribution(cohort):
    """A normal distribution truncated at 2.5 standard deviations has 0.955 of the standard deviation."""
    large = with_persons(cohort, 600)
    people = [draw_person(large, *who, SEED) for who in names_and_groups(large)]
    left = stats.truncnorm(-MAX_DRAWN_SD, MAX_DRAWN_SD).std()
    for sex in ("female", "male"):
        truth, declared = (
            np.array([(size.height_m, size.mass_kg) for size in sizes])
            for sizes in zip(
                *((item.truth, item.declared) for item in people if item.sex == sex), strict=True
            )
        )
        assert len(truth) == 600
        for column, (mean, sd) in zip(truth.T, (cohort.stature_m[sex], cohort.mass_kg[sex]), strict=True):
            assert column.mean() == pytest.approx(mean, abs=3.5 * sd / np.sqrt(600))
            assert column.std() == pytest.approx(left * sd, rel=0.08)
        assert np.corrcoef(truth.T)[0, 1] == pytest.approx(cohort.stature_mass_correlation, abs=0.1)
        assert (declared - truth).std(axis=0) == pytest.approx([left * 0.005, left * 0.5], rel=0.1)
    exact = with_persons(cohort, 1, mass_error_kg=0.0, stature_error_m=0.0)
    person = draw_person(exact, "expert_0001", "expert", SEED)
    assert person.declared.mass_kg == pytest.approx(person.truth.mass_kg, abs=0.05)


def test_drawn_lifts_are_valid(cohort):
    """Numbers within the limits of a declared lift, and events in order."""
    problems = Problems("lifts")
    large = with_persons(cohort, 40)
    for name, group in names_and_groups(large):
        person = draw_person(large, name, group, SEED)
        for mass, trial in cohort_lifts(large):
            lift = draw_lift(large, person, mass, lift_name(name, mass, trial), SEED)
            validate(lift.model_dump(mode="json"), SyntheticLift, Origins(problems))
            assert np.all(np.diff([1.2, *vars(lift.events_s).values()]) >= 0.2)
    problems.raise_if_any()


def test_subject_without_movement_has_one_drawn_from_group(twin):
    person = subject_settings("novice").model_copy(update={"name": "third", "mass_kg": 66.0})
    people = {"third": SyntheticPerson(mass_kg=68.0, height_m=person.height_m)}
    twin = twin.model_copy(update={"people": {**twin.people, **people}})
    drawn = single_lift_settings(twin, person, "third_12kg", 12.0, SEED)
    lift = drawn.lifts["third_12kg"]
    assert len(drawn.lifts) == 1
    assert drawn.people == people
    mean, between, within = twin.groups["novice"].lift_flexion_deg
    assert abs(lift.lift_flexion_deg - mean) <= MAX_DRAWN_SD * (between + within)
    assert drawn.duration_s >= lift.events_s.release + 2
    assert len(true_movement(drawn, "third_12kg").time) == 100 * drawn.duration_s
    groups = {**twin.groups, "nurse": GroupMovement()}
    other = twin.model_copy(update={"groups": groups, "people": people, "lifts": {}})
    assert single_lift_settings(other, person, "third_12kg", 12.0, SEED) == drawn
    named = single_lift_settings(twin, subject_settings("expert"), "expert_23kg", 23.0, SEED)
    assert named.lifts == {"expert_23kg": twin.lifts["expert_23kg"]} and named.duration_s == twin.duration_s
