"""Markers of a rigid body that moves: what is hidden comes back where the body carries it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lumbar.lifting.movement.joint_centres import trunk_points
from lumbar.lifting.movement.rigid_filling import fill_from_body
from lumbar.records.markers import MarkerRecording
from lumbar.twin.lifting_recordings import true_movement
from study_settings import study_settings

SHAPE = {"A": (0.12, 0.05, 0.0), "B": (-0.12, 0.05, 0.0), "C": (0.04, -0.1, 0.02), "D": (-0.04, -0.1, 0.03)}


def moving(noise=0.0, n=60):
    turns = Rotation.from_euler("xyz", np.linspace([0, 0, 0], [1.2, -0.4, 0.9], n))
    shift = np.linspace([0, 0, 1], [0.3, 0.8, 0.6], n)
    rng = np.random.default_rng(1)
    return {
        name: turns.apply(np.array(point)) + shift + rng.normal(0, noise, (n, 3))
        for name, point in SHAPE.items()
    }


def hidden(markers, *names, frames=slice(20, 40)):
    result = {name: points.copy() for name, points in markers.items()}
    for name in names:
        result[name][frames] = np.nan
    return result


@pytest.mark.parametrize("name", SHAPE)
def test_one_hidden_marker_comes_back_exactly(name):
    true = moving()
    filled, frames = fill_from_body(hidden(true, name))
    assert frames == {name: 20}
    assert filled[name] == pytest.approx(true[name], abs=1e-12)


def test_with_noise_it_comes_back_as_well_as_the_markers_are_known_and_seen_frames_stay():
    true, measured = moving(), moving(noise=5e-4)
    filled, _ = fill_from_body(hidden(measured, "A"))
    error = np.linalg.norm(filled["A"] - true["A"], axis=1)
    assert error[20:40].max() < 6e-3
    assert np.array_equal(filled["A"][:20], measured["A"][:20])
    assert np.array_equal(filled["B"], measured["B"])


def test_two_markers_place_no_body_nor_do_three_on_a_line():
    filled, frames = fill_from_body(hidden(moving(), "A", "B"))
    assert not frames
    assert np.isnan(filled["A"][20:40]).all()
    line = {name: np.tile([0.0, 0.1 * place, 0.0], (60, 1)) for place, name in enumerate("ABC")}
    line["D"] = np.tile([0.1, 0.0, 0.0], (60, 1))
    _, frames = fill_from_body(hidden(line, "D"))
    assert not frames


def test_a_body_that_is_never_seen_whole_is_left_as_it_is():
    markers = hidden(moving(), "A", frames=slice(None))
    filled, frames = fill_from_body(markers)
    assert filled is markers
    assert not frames


def test_a_spine_of_the_ilium_hidden_while_bending_does_not_hide_hips_and_loin():
    movement = true_movement(study_settings().twin.lifting, "novice_23kg")
    time = movement.time
    whole = MarkerRecording("twin", time, 100.0, dict(movement.markers))
    bending = {**movement.markers, "L_ASIS": movement.markers["L_ASIS"].copy()}
    bending["L_ASIS"][200:300] = np.nan
    points = trunk_points(replace(whole, positions=bending), "inner", "harrington", "male")
    expected = trunk_points(whole, "inner", "harrington", "male")
    for name in ("MID_HIP", "L5S1", "L4L5"):
        assert points[name] == pytest.approx(expected[name], abs=1e-6)
        assert "carried by the rest of the pelvis: L_ASIS in 100 frames" in points.points[name].rule
    assert "carried" not in expected.points["MID_HIP"].rule
