"""Pendulum states against rigid rods, closed forms and the twin's noise-free movement."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from lumbar.base.errors import InputError, NumericalError
from lumbar.interface.lift import lift
from lumbar.lifting.movement.joint_centres import trunk_points
from lumbar.lifting.movement.lift_analysis import analyse_lift
from lumbar.lifting.movement.lift_tables import states_frame, summary
from lumbar.lifting.movement.pendulum_states import (
    THESIS_CHOICE,
    pendulum_states,
    pivot_trajectory,
    rotate,
)
from lumbar.lifting.stability.model.pendulum_trajectories import pendulum_choice
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.settings.lifting import LiftingSettings
from lumbar.twin.examples import example_lift
from lumbar.twin.lifter import simulate
from lumbar.twin.lifting_recordings import true_movement
from study_settings import changed, study_settings, subject_settings

TIME = np.arange(0, 4, 0.01)
START, STOP, POINTS = 1.0, 3.0, 1000


def rod(angle, length, plane):
    """Bob of a rod of this length at this angle from straight up, in one plane."""
    horizontal = length * np.sin(angle)
    zero = np.zeros_like(horizontal)
    columns = (horizontal, zero) if plane == "lateral_bending" else (zero, horizontal)
    return np.stack([*columns, length * np.cos(angle)], axis=1)


@pytest.mark.parametrize("plane", ["lateral_bending", "flexion_extension"])
def test_a_rigid_rod(plane):
    omega, amplitude = 2 * np.pi * 0.8, 0.4
    bob = rod(amplitude * np.sin(omega * TIME), 1.1, plane)
    states = pendulum_states(TIME, bob, START, STOP, POINTS, "rod")[plane]
    grid = np.linspace(START, STOP, POINTS)
    assert np.array_equal(states.time, grid)
    assert states.angle == pytest.approx(amplitude * np.sin(omega * grid), abs=1e-6)
    assert states.angular_velocity == pytest.approx(amplitude * omega * np.cos(omega * grid), abs=1e-4)
    acceleration = -amplitude * omega**2 * np.sin(omega * grid)
    assert states.angular_acceleration == pytest.approx(acceleration, abs=2e-2)
    assert states.length == pytest.approx(1.1, abs=1e-6)
    assert states.length_rate == pytest.approx(0.0, abs=1e-4)


def test_a_rod_that_changes_its_length():
    angle, length = 0.3 * TIME - 0.5, 0.8 + 0.1 * TIME
    states = pendulum_states(TIME, rod(angle, length, "lateral_bending"), START, STOP, POINTS, "rod")
    grid = np.linspace(START, STOP, POINTS)
    lateral, expected = states["lateral_bending"], 0.8 + 0.1 * grid
    assert lateral.length == pytest.approx(expected, abs=1e-6)
    assert lateral.length_rate == pytest.approx(0.1, abs=1e-5)
    assert lateral.angular_velocity == pytest.approx(0.3, abs=1e-5)
    assert lateral.angular_acceleration == pytest.approx(0.0, abs=1e-3)
    # The other plane sees the height alone.
    seen = expected * np.cos(0.3 * grid - 0.5)
    assert states["flexion_extension"].length == pytest.approx(seen, abs=1e-6)


def test_the_spline_does_not_end_where_the_deposit_ends():
    # Off-grid limits: the same instants of a longer deposit have the same states.
    bob = rod(0.3 * np.sin(5 * TIME), 1.0, "lateral_bending")
    short = pendulum_states(TIME, bob, 1.503, 2.507, 11, "rod")["lateral_bending"]
    assert short.angular_velocity == pytest.approx(1.5 * np.cos(5 * short.time), abs=1e-4)


def test_missing_samples_within_the_deposit_are_refused_and_outside_do_not_matter():
    bob = rod(0.2 * np.sin(3 * TIME), 1.0, "lateral_bending")
    bob[20:60] = np.nan
    bob[350:360] = np.nan
    states = pendulum_states(TIME, bob, START, STOP, 50, "rod")["lateral_bending"]
    assert states.angle == pytest.approx(0.2 * np.sin(3 * states.time), abs=1e-6)
    bob[150:155] = np.nan
    with pytest.raises(InputError, match=r"rod: 5 samples missing within the deposit, the first at 1\.50 s"):
        pendulum_states(TIME, bob, START, STOP, 50, "rod")


def test_a_deposit_of_three_samples_is_refused():
    with pytest.raises(InputError, match="has 3 samples; 4 are needed"):
        pendulum_states(TIME, rod(0 * TIME, 1.0, "lateral_bending"), 1.0, 1.004, 50, "rod")


def test_a_bob_at_the_pivot_has_no_angle():
    with pytest.raises(NumericalError, match="of the pivot, where the angle is not defined"):
        pendulum_states(TIME, rod(0 * TIME, 0.005, "lateral_bending"), START, STOP, 50, "rod")


def test_missing_markers_are_refused_with_the_pivots_that_are_possible():
    recording = MarkerRecording("x", np.arange(5) / 100, 100.0, {"L5": np.ones((5, 3))}, source="x.c3d")
    points = trunk_points(recording, "inner", "harrington", "male")
    with pytest.raises(InputError, match=r"2 problems(.|\n)*pivots possible with this recording: L5"):
        pivot_trajectory(recording, points, "mid_ankle")


@pytest.fixture(scope="module")
def study(project):
    settings, subject = study_settings(), subject_settings("novice")
    return settings.lifting, settings.twin.lifting, subject, subject.trials[0]


@pytest.fixture(scope="module")
def recording(study, twin_lift):
    return read_markers(twin_lift("novice_23kg"), study[0].markers)


def test_the_whole_chain_recovers_the_twins_true_pendulum(study, recording):
    """Gaps, noise, filter and spline against finite differences of the noise-free movement at 10 kHz."""
    settings, twin, subject, trial = study
    settings = changed(settings, segment_ends="skin")  # points whose truth is known to the last digit
    lift = analyse_lift(recording, subject, trial, settings)
    states = lift.states[("thorax", "flexion_extension")]
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
    facts = summary(lift, subject, trial, settings)
    assert facts["length_m"]["thorax"]["flexion_extension"] == pytest.approx(at(length).mean(), abs=1e-3)
    # Of a movement that starts and ends as smoothly, speeds below 20 mm/s are not seen.
    assert facts["duration_s"] == pytest.approx(7.75 - 6.15, abs=0.1)


def errors_mm(study, recording, ends):
    """Largest distance from the true centres of mass, by segment, and largest error of the thorax's angle."""
    settings, twin, subject, trial = study
    movement = true_movement(twin, "novice_23kg")
    lift = analyse_lift(recording, subject, trial, changed(settings, segment_ends=ends))
    distance = {
        name: 1e3 * np.linalg.norm(lift.centres[name].position - true, axis=1)
        for name, true in movement.centres_of_mass.items()
    }
    relative = movement.centres_of_mass["thorax"] - lift.pivot
    angle = np.arctan2(relative[:, 1], relative[:, 2])
    states = lift.states[("thorax", "flexion_extension")]
    return distance, np.abs(states.angle - np.interp(states.time, movement.time, angle)).max()


def test_joint_centres_recover_the_true_centres_of_mass_and_the_skin_does_not(study, recording):
    """The lifter wears its markers on a skin of its own anatomy, not that of the regressions."""
    inner, inner_angle = errors_mm(study, recording, "inner")
    skin, skin_angle = errors_mm(study, recording, "skin")
    for name, distance in inner.items():
        assert distance.mean() < 12, name
        assert distance.max() < 20, name
        assert skin[name].min() > 60, name
    assert inner_angle < 0.015
    assert skin_angle > 0.05


def test_states_do_not_depend_on_place_nor_on_the_laboratorys_heading(study, recording):
    settings, _, subject, trial = study
    settings = changed(settings, frame="pelvis")
    shift = np.array([3.0, -7.0, 0.4])
    moved = {name: rotate(points, 0.9) + shift for name, points in recording.positions.items()}
    here = states_frame(analyse_lift(recording, subject, trial, settings).states)
    there = states_frame(analyse_lift(replace(recording, positions=moved), subject, trial, settings).states)
    for column in ("angle_rad", "angular_velocity_rad_s", "length_m", "length_rate_m_s"):
        assert there[column].to_numpy() == pytest.approx(here[column].to_numpy(), abs=1e-8)


def test_the_box_pulls_the_pendulum_forward_where_it_counts_in_the_position(study, recording):
    settings, _, subject, trial = study
    alone = analyse_lift(recording, subject, trial, settings)
    boxed = analyse_lift(recording, subject, trial, changed(settings, box={"in_position": True}))
    key = ("thorax", "flexion_extension")
    assert (boxed.states[key].angle > alone.states[key].angle + 0.05).all()


def test_thesiss_pendulums_are_those_of_a_study_that_chooses_them(tmp_path):
    """States and lengths are those of a lift with these settings; such a lift has no further ones."""
    person = example_lift(tmp_path / "lift.c3d")
    settings = LiftingSettings()
    events = settings.events.model_copy(update={"deposit_start": THESIS_CHOICE.deposit_start})
    thesis = settings.model_copy(
        update={"pivot": THESIS_CHOICE.pivot, "segment_ends": THESIS_CHOICE.segment_ends, "events": events}
    )
    own, alone = (
        lift(tmp_path / "lift.c3d", person, box_mass_kg=15, settings=item) for item in (settings, thesis)
    )
    facts = own.facts["thesis_pendulum"]
    pd.testing.assert_frame_equal(own.thesis_states, alone.states)
    assert pendulum_choice(facts) == pendulum_choice(alone.facts) == vars(THESIS_CHOICE)
    assert facts["length_m"] == alone.facts["length_m"] and facts["missing"] == {}
    assert not own.thesis_states["angle_rad"].equals(own.states["angle_rad"])
    assert alone.facts["thesis_pendulum"] is None and alone.thesis_states.empty
