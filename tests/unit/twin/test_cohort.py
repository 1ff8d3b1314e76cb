"""Cohorts of synthetic lifters: drawn as declared, each by itself, within what the twin can move."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from lumbar.base.errors import InputError, Problems
from lumbar.settings.plain import plain
from lumbar.settings.twin import GroupMovement, SyntheticLift, SyntheticPerson
from lumbar.study.load_study import load_study, name_lifts
from lumbar.study.validation import Origins, overlay, validate
from lumbar.twin.cohort import (
    FARTHEST_SD,
    cohort_subjects,
    draw_lift,
    draw_person,
    lift_name,
    lifts_of,
    own_part,
    own_settings,
    person_names,
)
from lumbar.twin.lifting_recordings import true_movement
from study_settings import study_config, study_settings, subject_settings

SEED = 45


@pytest.fixture(scope="module")
def cohort():
    return study_settings("studies/cohort.yaml").twin.lifting.cohort


def with_persons(cohort, count, **changes):
    """The cohort with as many persons in every group."""
    groups = {name: replace(group, persons=count) for name, group in cohort.groups.items()}
    return replace(cohort, groups=groups, **changes)


def test_who_is_added_changes_nobody(cohort):
    few, many = (cohort_subjects(with_persons(cohort, count), SEED) for count in (2, 3))
    assert set(many) - set(few) == {"expert_0003", "novice_0003"}
    assert all(many[name] == subject for name, subject in few.items())
    person = draw_person(cohort, "novice_0002", "novice", SEED)
    assert person == draw_person(own_part(cohort, "novice"), "novice_0002", "novice", SEED)
    more = with_persons(cohort, 2, trials=9)
    assert draw_lift(cohort, person, 23.0, "a_2", SEED) == draw_lift(more, person, 23.0, "a_2", SEED)


def test_lifts_are_named_as_a_study_names_them(cohort):
    subjects = cohort_subjects(with_persons(cohort, 1), SEED)
    named = {name: lift.trial.markers for name, lift in name_lifts(subjects).items()}
    expected = [lift_name(person, *lift) for person in subjects for lift in lifts_of(cohort)]
    assert list(named) == expected
    assert named["expert_0001_15kg_2"] == "lifting/expert_0001/expert_0001_15kg_2.c3d"


def test_a_cohort_is_a_study_of_its_people(project):
    config = study_config("studies/cohort.yaml")
    study = load_study(config, project)
    assert (len(study.subjects), len(study.lifts)) == (20, 120)
    assert sorted(set(study.labels.values())) == ["expert", "novice"]
    assert len(study.lifts_by_person["novice_0010"]) == 6
    renamed = overlay(config, {"stability": {"compare": {"groups": ["trained", "novice"]}}})
    with pytest.raises(InputError, match=r"nobody is labelled 'trained'.*expert, novice"):
        load_study(renamed, project)
    alone = {**config, "twin": {"lifting": {"cohort": {"groups": {"expert": {"persons": 4}}}}}}
    with pytest.raises(InputError, match="nobody is labelled 'novice'"):
        load_study(alone, project)


def test_people_are_drawn_as_declared(cohort):
    """Of a normal distribution without what lies beyond 2.5 standard deviations, 0.955 of the standard deviation is left."""
    large = with_persons(cohort, 600)
    people = [draw_person(large, name, group, SEED) for name, group in person_names(large)]
    left = stats.truncnorm(-FARTHEST_SD, FARTHEST_SD).std()
    for sex in ("female", "male"):
        truth = np.array([(item.truth.height_m, item.truth.mass_kg) for item in people if item.sex == sex])
        declared = np.array(
            [(item.declared.height_m, item.declared.mass_kg) for item in people if item.sex == sex]
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


def test_every_lift_can_be_moved(cohort):
    """Numbers within the limits of a lift that is named by hand, and events in order."""
    problems = Problems("lifts")
    large = with_persons(cohort, 40)
    for name, group in person_names(large):
        person = draw_person(large, name, group, SEED)
        for mass, trial in lifts_of(large):
            lift = draw_lift(large, person, mass, lift_name(name, mass, trial), SEED)
            validate(plain(lift), SyntheticLift, problems, Origins())
            assert np.all(np.diff([1.2, *vars(lift.events_s).values()]) >= 0.2)
    problems.raise_if_any()


def test_a_person_of_a_study_needs_no_movement_of_their_own():
    """Drawn as of the label, with the mass declared, and from nobody else's; who has a named lift keeps it."""
    twin, seed = study_settings().twin.lifting, SEED
    person = replace(subject_settings("novice"), name="third", mass_kg=66.0)
    own = own_settings(twin, person, "third_12kg", 12.0, seed)
    assert list(own.lifts) == ["third_12kg"] and own.people == {
        "third": SyntheticPerson(66.0, person.height_m)
    }
    mean, between, within = twin.groups["novice"].lift_flexion_deg
    assert abs(own.lifts["third_12kg"].lift_flexion_deg - mean) <= FARTHEST_SD * (between + within)
    assert own.duration_s >= own.lifts["third_12kg"].events_s.release + 2
    assert len(true_movement(own, "third_12kg").time) == 100 * own.duration_s
    more = replace(twin, groups={**twin.groups, "nurse": GroupMovement()}, people={}, lifts={})
    assert own_settings(more, person, "third_12kg", 12.0, seed) == own
    named = own_settings(twin, subject_settings("expert"), "expert_23kg", 23.0, seed)
    assert named.lifts == {"expert_23kg": twin.lifts["expert_23kg"]} and named.duration_s == twin.duration_s
