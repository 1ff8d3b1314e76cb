"""Pendulums of a lift of the twin against its noise-free movement, and by the thesis's choices."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from lifting_cases import example_lift, simulate, true_movement
from scipy.spatial.transform import Rotation

import lumbar
from study_settings import changed, study_settings, subject_settings


@pytest.fixture(scope="module")
def study(project):
    settings, subject = study_settings(), subject_settings("novice")
    return settings.lifting, settings.twin.lifting, subject, subject.trials[0]


@pytest.fixture(scope="module")
def recording(study, twin_lift):
    return lumbar.read(twin_lift("novice_23kg"), layout=study[0].markers)


def test_the_whole_chain_recovers_the_twins_true_pendulum(study, recording):
    """Gaps, noise, filter and spline against finite differences of the noise-free movement at 10 kHz."""
    settings, twin, subject, trial = study
    settings = changed(settings, segment_ends="skin")  # points whose truth is known to the last digit
    lift = lumbar.lift(recording, subject, trial=trial, settings=settings)
    states = lift.analysed.states[("thorax", "flexion_extension")]
    fine = np.arange(states.time[0] - 0.01, states.time[-1] + 0.01, 1e-4)
    truth = simulate(fine, twin.people["novice"], twin.lifts["novice_23kg"], twin.workplace).markers
    thorax = truth["C7"] + 0.82 * (truth["T12"] - truth["C7"])
    relative = thorax - (truth["L_ANKLE"] + truth["R_ANKLE"]) / 2
    angle = np.arctan2(relative[:, 1], relative[:, 2])
    at = lambda values: np.interp(states.time, fine, values)  # noqa: E731
    assert states.angle == pytest.approx(at(angle), abs=2e-3)
    assert np.sqrt(np.mean((states.angular_velocity - at(np.gradient(angle, fine))) ** 2)) < 0.01
    length = np.hypot(relative[:, 1], relative[:, 2])
    assert states.length == pytest.approx(at(length), abs=2e-3)
    facts = lift.facts
    assert facts["length_m"]["thorax"]["flexion_extension"] == pytest.approx(at(length).mean(), abs=1e-3)
    # Of a movement that starts and ends as smoothly, speeds below 20 mm/s are not seen.
    assert facts["duration_s"] == pytest.approx(7.75 - 6.15, abs=0.1)


def errors_mm(study, recording, ends):
    """Largest distance from the true centres of mass, by segment, and largest error of the thorax's angle."""
    settings, twin, subject, trial = study
    movement = true_movement(twin, "novice_23kg")
    lift = lumbar.lift(
        recording, subject, trial=trial, settings=changed(settings, segment_ends=ends)
    ).analysed
    distance = {
        name: 1e3 * np.linalg.norm(lift.centres[name].position - true, axis=1)
        for name, true in movement.centres_of_mass.items()
    }
    relative = movement.centres_of_mass["thorax"] - lift.pivot
    angle = np.arctan2(relative[:, 1], relative[:, 2])
    states = lift.states[("thorax", "flexion_extension")]
    return distance, np.abs(states.angle - np.interp(states.time, movement.time, angle)).max()


def test_joint_centres_recover_true_centres_of_mass(study, recording):
    """The lifter wears its markers on a skin of its own anatomy, not that of the regressions."""
    inner, inner_angle = errors_mm(study, recording, "inner")
    skin, skin_angle = errors_mm(study, recording, "skin")
    for name, distance in inner.items():
        assert distance.mean() < 12, name
        assert distance.max() < 20, name
        assert skin[name].min() > 60, name
    assert inner_angle < 0.015
    assert skin_angle > 0.05


def test_states_do_not_depend_on_place_or_heading(study, recording):
    settings, _, subject, trial = study
    settings = changed(settings, frame="pelvis")
    shift = np.array([3.0, -7.0, 0.4])
    turn = Rotation.from_rotvec([0, 0, -0.9])
    moved = {name: turn.apply(points) + shift for name, points in recording.positions.items()}
    here, there = (
        lumbar.lift(replace(recording, positions=points), subject, trial=trial, settings=settings).states
        for points in (recording.positions, moved)
    )
    for column in ("angle_rad", "angular_velocity_rad_s", "length_m", "length_rate_m_s"):
        assert there[column].to_numpy() == pytest.approx(here[column].to_numpy(), abs=1e-8)


def test_box_in_the_position_moves_the_pendulum_forward(study, recording):
    settings, _, subject, trial = study
    without, boxed = (
        lumbar.lift(recording, subject, trial=trial, settings=changed(settings, box={"in_position": counts}))
        .analysed.states[("thorax", "flexion_extension")]
        .angle
        for counts in (False, True)
    )
    assert (boxed > without + 0.05).all()


def test_the_thesis_s_pendulums_are_those_of_a_study_that_chooses_them(tmp_path):
    """States and lengths are those of a lift with these settings; such a lift has no further ones."""
    choice = {"pivot": "mid_ankle", "segment_ends": "skin", "deposit_start": "wrist_minimum"}
    person, settings = example_lift(tmp_path / "lift.c3d"), lumbar.load_settings().lifting
    events = {"deposit_start": choice["deposit_start"]}
    thesis = changed(settings, pivot=choice["pivot"], segment_ends=choice["segment_ends"], events=events)
    individual, alone = (
        lumbar.lift(tmp_path / "lift.c3d", person, box_mass_kg=15, settings=item)
        for item in (settings, thesis)
    )
    facts = individual.facts["thesis_pendulum"]
    pd.testing.assert_frame_equal(individual.thesis_states, alone.states)
    assert {name: facts[name] for name in choice} == {name: alone.facts[name] for name in choice} == choice
    assert facts["length_m"] == alone.facts["length_m"] and facts["missing"] == {}
    assert not individual.thesis_states["angle_rad"].equals(individual.states["angle_rad"])
    assert alone.facts["thesis_pendulum"] is None and alone.thesis_states.empty
