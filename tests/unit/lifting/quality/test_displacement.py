"""The frames that a jump leaves out are those in which the marker is wrong; rigid parts are found from how markers move."""

import numpy as np
import pytest
from quality_corruptions import changed

from lumbar.lifting.quality.displacement import off_its_part
from lumbar.lifting.quality.gate import examine
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout

LAYOUT = MarkerLayout(up="+z", forward="+x", check_axes=False)
DRIFT = 30


@pytest.fixture(scope="module")
def box_transfer(shared):
    return read_markers(shared / "real" / "lifting" / "s2m_box_transfer" / "Vicon.c3d", LAYOUT)


def drifted(recording, label, start, direction=(1.0, 0.0, 0.0)):
    """Let a marker drift 0.1 m away over 30 frames; then it is back."""
    frames = slice(start, start + DRIFT)
    away = np.linspace(0, 0.1, DRIFT)[:, None] * np.array(direction)
    return changed(recording.positions, label, frames, recording[label][frames] + away)


def test_frames_wrong_in_a_real_recording_are_left_out_and_no_others(shared):
    """Of RSK1 its distance to RSK2 is 103 to 111 mm but in frames 137 to 166, where it grows to 157 mm."""
    recording = read_markers(shared / "real" / "c3d_edge" / "01_intel_int.c3d", LAYOUT)
    found = {
        finding.markers: finding.frames
        for finding in examine(recording.positions, recording.time, recording.rate)
    }
    assert set(found) == {("RSK1",), ("RTH2",), ("LFT3",)}
    assert (found["RSK1",].start, found["RSK1",].stop) == (pytest.approx(137, abs=3), 167)
    assert (found["RTH2",].start, found["RTH2",].stop) == (pytest.approx(416, abs=3), 424)
    assert found["LFT3",] == slice(0, 43)
    distance = np.linalg.norm(recording["RSK1"] - recording["RSK2"], axis=1)
    kept = np.delete(distance, np.r_[found["RSK1",]])
    assert np.nanmin(kept) > 0.1
    assert np.nanmax(kept) < 0.115


@pytest.mark.parametrize("start", [140, 270, 430])
def test_a_drift_that_ends_in_a_leap_back_is_left_out_alone(box_transfer, start):
    (finding,) = examine(drifted(box_transfer, "T10", start), box_transfer.time, box_transfer.rate)
    assert (finding.kind, finding.outcome, finding.markers) == ("jump", "left out", ("T10",))
    assert finding.frames.start == pytest.approx(start, abs=6)
    assert finding.frames.stop == start + DRIFT


def test_where_distances_do_not_tell_it_is_said_and_nothing_is_left_out():
    """Markers that move at will have no distance that says where one of them belongs."""
    rng = np.random.default_rng(3)
    time = np.arange(400) / 100
    phases = rng.uniform(0, 6, (8, 3))
    points = {
        f"P{index}": rng.uniform(-0.5, 0.5, 3) + 0.5 * np.sin(1.5 * time[:, None] * (1 + 0.1 * index) + phase)
        for index, phase in enumerate(phases)
    }
    frames = slice(180, 400)
    findings = examine(changed(points, "P3", frames, points["P3"][frames] + 0.06), time, 100.0)
    (finding,) = [finding for finding in findings if finding.kind == "jump"]
    assert (finding.outcome, finding.markers) == ("noted", ("P3",))
    assert "do not show" in finding.evidence


@pytest.mark.parametrize("cut", [200, 290])
def test_frames_cut_out_are_one_error_and_no_marker_is_left_out(box_transfer, cut):
    kept = np.delete(np.arange(len(box_transfer)), np.r_[cut : cut + 30])
    points = {label: positions[kept] for label, positions in box_transfer.positions.items()}
    (finding,) = examine(points, np.arange(len(kept)) / box_transfer.rate, box_transfer.rate)
    assert (finding.kind, finding.outcome, finding.markers) == ("missing frames", "error", ())
    assert f"all markers leap together at {cut / 100:.2f} s" in finding.evidence
    assert "frames are missing there" in finding.evidence
    assert finding.cause


RATE = 100.0
TIME = np.arange(0, 30, 1 / RATE)


def ramp(start, stop):
    share = np.clip((TIME - start) / (stop - start), 0, 1)
    return (share**2 * (3 - 2 * share))[:, None]


def part(names, origin, movement):
    places = np.array([[0, 0, 0], [0.15, 0, 0.02], [0.05, 0.08, 0], [0.1, -0.06, 0.05]])
    return {name: origin + place + movement for name, place in zip(names, places, strict=True)}


@pytest.fixture
def two_feet():
    """A person stands for half a minute and steps once: the heel first, then the other foot's whole."""
    step = [0, 0.3, 0] * ramp(14.0, 14.5)
    left = part(("L_HEEL", "L_TOE", "L_ANKLE", "L_FOOT"), np.zeros(3), step)
    left["L_HEEL"] = left["L_HEEL"] + [0, 0, 0.12] * (ramp(13.8, 14.0) - ramp(14.5, 14.7))
    right = part(("R_HEEL", "R_TOE", "R_ANKLE", "R_FOOT"), np.array([0.3, 0, 0]), 0 * step)
    noise = np.random.default_rng(1)
    return {name: places + noise.normal(0, 2e-4, places.shape) for name, places in (left | right).items()}


def test_two_feet_on_the_ground_are_not_one_body(two_feet):
    assert off_its_part(two_feet, RATE) == []


def test_a_marker_off_a_box_that_is_carried_is_found(two_feet):
    names = ("BOX_1", "BOX_2", "BOX_3", "BOX_4")
    box = part(names, np.array([0, 0.5, 0.3]), [0, 0.2, 0.7] * ramp(10.0, 13.0))
    box["BOX_3"][1150:1162] += [0.05, 0, 0]
    [(label, stretch, seen)] = off_its_part(two_feet | box, RATE)
    assert (label, stretch) == ("BOX_3", slice(1150, 1162))
    assert "BOX_1" in seen
