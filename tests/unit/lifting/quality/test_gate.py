"""Silent corruptions of real recordings are all named, nothing is found in untouched ones, jumps are left out to the frame."""

from itertools import product

import numpy as np
import pytest
from quality_corruptions import CORRUPTIONS, Trunk, changed, corrupted, exchanged

from lumbar.lifting.quality.displacement import off_its_part
from lumbar.lifting.quality.gate import examine, unchecked_properties
from lumbar.lifting.quality.landmarks import side_pairs
from lumbar.lifting.quality.other_trials import beside, of_same_person
from lumbar.lifting.quality.sheet import FINE_RATE
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout

CHAIR = Trunk("Clavical", "Sternum", "V_Sacral")
RECORDINGS = {
    "athlete_floor_pickup_squats/squat.c3d": ("+y", Trunk("C7", "T10", "LBWT")),
    "athlete_static_full_spine/c3dfile1.c3d": ("+z", Trunk("C7", "T12", "SACROL")),
    "ktk_pig_com_oracle/gait.c3d": ("+z", Trunk("C7", "T10", "LPSI")),
    "ktk_pig_com_oracle/static.c3d": ("+z", Trunk("C7", "T10", "LPSI")),
    "qualisys_ior_gait/Qualisys.c3d": ("+z", Trunk("CV7", "TV8", "L_IPS")),
    "s2m_box_transfer/Vicon.c3d": ("+z", Trunk("T1", "T10", "PSISr")),
    "weird_squat_trc/markers_Squat2.trc": ("+y", Trunk("C7", "T10", "SACR")),
    **{f"sts_trunk_flexion_trc/sts_perturbed_{trial}.trc": ("+y", CHAIR) for trial in range(1, 6)},
    **{f"sts_trunk_flexion_trc/sts_unperturbed_{trial}.trc": ("+y", CHAIR) for trial in range(1, 6)},
}
EACH_LABORATORY = [name for name in RECORDINGS if "sts_" not in name or name.endswith("perturbed_2.trc")]
"""Of ten trials alike, one disturbed and one not."""
SYNTHETIC = ("expert_23kg", "expert_15kg", "novice_23kg", "novice_15kg")
STANDING_STILL = ("athlete_static_full_spine/c3dfile1.c3d", "ktk_pig_com_oracle/static.c3d")
"""Of people who do not move, no rate is implausible."""


@pytest.fixture(scope="module")
def recordings(request, twin_lift):
    """Return a function that reads a recording once: markers by the file's labels, the nearest trunk markers."""
    made = {}

    def read(name):
        if name not in made:
            if name in SYNTHETIC:
                path, up, trunk = twin_lift(name), "+z", Trunk("C7", "T12", "L5")
            else:
                path = request.getfixturevalue("shared") / "real" / "lifting" / name
                up, trunk = RECORDINGS[name]
            layout = MarkerLayout(up=up, forward="+x", check_axes=False)
            made[name] = read_markers(path, layout), trunk
        return made[name]

    return read


@pytest.mark.parametrize("name", [*RECORDINGS, *SYNTHETIC])
def test_nothing_is_found_in_an_untouched_recording(recordings, name):
    recording, _ = recordings(name)
    assert examine(recording.positions, recording.time, recording.rate) == []


@pytest.mark.parametrize("corruption", CORRUPTIONS)
@pytest.mark.parametrize("name", [*EACH_LABORATORY, *SYNTHETIC[:1]])
def test_a_silent_corruption_is_named_with_its_markers_and_frames(recordings, name, corruption):
    if "rate" in corruption and name in STANDING_STILL:
        pytest.skip("a person who stands still has no tempo")
    recording, trunk = recordings(name)
    made = corrupted(corruption, recording.positions, recording.rate, trunk, np.random.default_rng(1))
    findings = examine(made.points, np.arange(len(recording)) / made.rate, made.rate)
    assert [finding.kind for finding in findings] == [made.kind], findings
    (finding,) = findings
    assert frozenset(finding.markers) == made.markers
    frames = made.frames or slice(0, len(recording))
    assert abs(finding.frames.start - frames.start) <= 1
    assert abs(finding.frames.stop - frames.stop) <= 1


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("name", ["s2m_box_transfer/Vicon.c3d", "sts_trunk_flexion_trc/sts_perturbed_3.trc"])
def test_small_and_short_corruptions_of_any_marker_are_named(recordings, name, seed):
    recording, _ = recordings(name)
    points, rate, rng = recording.positions, recording.rate, np.random.default_rng(seed)
    whole = [label for label, positions in points.items() if np.isfinite(positions).all()]
    for _ in range(4):
        one, other = rng.choice(whole, 2, replace=False)
        start = int(rng.integers(5, len(recording) - 45))
        frames = slice(start, start + int(rng.integers(8, 35)))
        shift = rng.normal(size=3)
        moved = points[one][frames] + 0.03 * shift / np.linalg.norm(shift)
        for spoilt, markers in (
            (changed(points, one, frames, moved), {one}),
            (exchanged(points, one, other, frames), {one, other}),
            (changed(points, one, frames, points[other][frames]), {one}),
        ):
            findings = examine(spoilt, recording.time, rate)
            assert {label for finding in findings for label in finding.markers} == markers
            assert min(finding.frames.start for finding in findings) == pytest.approx(frames.start, abs=1)
            assert max(finding.frames.stop for finding in findings) == pytest.approx(frames.stop, abs=1)


def test_all_labels_of_a_side_exchanged_are_told_as_a_mirrored_body(recordings):
    recording, _ = recordings("ktk_pig_com_oracle/gait.c3d")
    points = dict(recording.positions)
    for left, right in side_pairs(points):
        points = exchanged(points, left, right, slice(None))
    (finding,) = examine(points, recording.time, recording.rate)
    assert (finding.kind, finding.outcome) == ("mirrored", "error")


def test_one_pair_of_a_side_is_told_from_the_others(recordings):
    recording, _ = recordings("weird_squat_trc/markers_Squat2.trc")
    points = exchanged(recording.positions, "LASI", "RASI", slice(None))
    (finding,) = examine(points, recording.time, recording.rate)
    assert (finding.kind, set(finding.markers)) == ("exchanged", {"LASI", "RASI"})


@pytest.mark.parametrize(
    ("height_m", "kinds"), [(1.60, []), (1.75, []), (2.2, ["stature"]), (0.75, ["unit"])]
)
def test_lengths_of_the_body_are_compared_with_the_stature(recordings, height_m, kinds):
    """The static trial is of an athlete 1.60 m tall."""
    recording, _ = recordings("athlete_static_full_spine/c3dfile1.c3d")
    findings = examine(recording.positions, recording.time, recording.rate, height_m)
    assert [finding.kind for finding in findings] == kinds


def test_a_box_that_stands_in_a_coarse_file_is_not_frozen():
    """Numbers of one millimetre repeat while nothing moves, as integers of a C3D file do."""
    frames = np.arange(400)
    shift = np.where(frames > 250, (frames - 250) * 0.002, 0.0)[:, None] * [0.0, 0.0, 1.0]
    corners = {f"BOX_{i}": np.array([0.3 * (i % 2), 0.3 * (i // 2), 0.9]) for i in range(4)}
    rng = np.random.default_rng(5)
    body = {f"P{i}": rng.uniform(0, 1, 3) for i in range(4)}
    points = {label: np.round(corner + shift, 3) for label, corner in corners.items()}
    points |= {label: place + rng.normal(0, 1e-4, (400, 3)) for label, place in body.items()}
    assert [f for f in examine(points, frames / 100, 100.0) if f.kind == "frozen"] == []


def test_both_legs_that_change_sides_during_a_walk_are_named_pair_by_pair_and_from_the_frame_on(recordings):
    """All leap at once, each to where its fellow was and near to where others were."""
    walk, _ = recordings("ktk_pig_com_oracle/gait.c3d")
    points, time, rate = walk.positions, walk.time, walk.rate
    pairs = [(f"L{part}", f"R{part}") for part in ("THI", "KNE", "TIB", "ANK", "HEE", "TOE")]
    spoilt = {label: positions.copy() for label, positions in points.items()}
    for left, right in pairs:
        spoilt[left][200:], spoilt[right][200:] = points[right][200:], points[left][200:]
    found = examine(spoilt, time, rate)
    assert {finding.kind for finding in found} == {"exchanged"}
    assert sorted(tuple(sorted(finding.markers)) for finding in found) == sorted(pairs)
    assert {(finding.first_frame, finding.frames.stop) for finding in found} == {(200, len(time))}


def test_noise_of_all_markers_is_one_finding(recordings):
    walk, _ = recordings("ktk_pig_com_oracle/gait.c3d")
    points, time, rate = walk.positions, walk.time, walk.rate
    rng = np.random.default_rng(0)
    (found,) = examine({k: v + rng.normal(0, 5e-3, v.shape) for k, v in points.items()}, time, rate)
    assert (found.kind, found.markers) == ("jitter", ())
    words = found.evidence.split()
    assert [float(words[3]), float(words[5])] == pytest.approx([np.sqrt(3) * 5] * 2, rel=0.1)


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


@pytest.mark.parametrize("label", ["C7", "LASI", "RPSI"])
@pytest.mark.parametrize(("start", "stop"), [(0.0, 1.0), (0.3, 0.5)])
def test_a_marker_that_creeps_is_left_out_from_where_it_begins(recordings, label, start, stop):
    recording, _ = recordings("weird_squat_trc/markers_Squat2.trc")
    share = np.interp(np.linspace(0, 1, len(recording)), [start, stop], [0, 1])
    away = recording.positions[label] + np.outer(share, [0.0144, 0.018, -0.0192])
    points = changed(recording.positions, label, slice(None), away)
    (finding,) = examine(points, recording.time, recording.rate)
    assert (finding.kind, finding.outcome, finding.markers) == ("drift", "left out", (label,))
    assert finding.frames.start == pytest.approx(start * len(recording), abs=0.11 * len(recording))


def test_of_a_short_trial_the_drift_that_may_go_unseen_is_told_and_a_larger_one_found(recordings):
    recording, _ = recordings("sts_trunk_flexion_trc/sts_perturbed_2.trc")
    points, clock = recording.positions, (recording.time, recording.rate)
    told = unchecked_properties(points, *clock)["slow drift"]
    size = next(int(part.split()[2]) for part in told.split("; ") if "Clavical" in part) * 1e-3
    assert 0.05 < size < 0.2
    for direction in np.eye(3):
        away = points["Clavical"] + np.outer(np.linspace(0, size, len(recording)), direction)
        (finding,) = examine(changed(points, "Clavical", slice(None), away), *clock)
        assert (finding.kind, finding.markers) == ("drift", ("Clavical",))


@pytest.mark.parametrize("anew_m", [0.0, 0.01])
def test_other_trials_of_the_person_tell_a_creep_from_posture(recordings, anew_m):
    rng = np.random.default_rng(1)
    trials = {
        f"sts_{kind}_{number}.trc": recordings(f"sts_trunk_flexion_trc/sts_{kind}_{number}.trc")[0].positions
        for kind in ("perturbed", "unperturbed")
        for number in range(1, 5)
    }
    own = recordings("sts_trunk_flexion_trc/sts_perturbed_2.trc")[0]
    clock = own.time, own.rate
    others = [
        {label: positions + rng.normal(0, anew_m, 3) for label, positions in trial.items()}
        for trial in beside(trials, "sts_perturbed_2.trc").values()
    ]
    assert len(others) == 7
    assert examine(own.positions, *clock, others=others) == []
    away = np.linspace(0, 0.03, len(own))
    for label, direction in product(("Clavical", "L_ASIS"), np.eye(3)[:2]):
        points = changed(own.positions, label, slice(None), own.positions[label] + np.outer(away, direction))
        (finding,) = examine(points, *clock, others=others)
        assert (finding.kind, finding.markers) == ("drift", (label,))
        # In another trial it makes no drift of a sound one, and one other trial may be the one that drifts.
        assert examine(trials["sts_unperturbed_1.trc"], *clock, others=[points, *others[:2]]) == []
        assert examine(trials["sts_unperturbed_1.trc"], *clock, others=[points]) == []


def test_trials_of_one_person_have_the_labels_and_constant_distances_of_each_other(recordings):
    one, other, third = (
        recordings(f"sts_trunk_flexion_trc/sts_perturbed_{number}.trc")[0].positions for number in (1, 2, 3)
    )
    larger = {label: 1.05 * positions for label, positions in one.items()}
    fewer = {label: positions for label, positions in one.items() if label != "R_Toe"}
    trials = {"one": one, "other": other, "larger": larger, "fewer": fewer, "third": third}
    assert list(of_same_person(trials, "one")) == ["other", "third"]
    assert of_same_person({"one": one, "other": other}, "one") == {}


@pytest.mark.parametrize("pair", [("LKNE", "LANK"), ("RKNE", "RANK")])
@pytest.mark.parametrize("name", ["athlete_floor_pickup_squats/squat.c3d", "ktk_pig_com_oracle/gait.c3d"])
def test_knee_and_ankle_of_one_leg_exchanged_are_told(recordings, name, pair):
    recording, _ = recordings(name)
    points = exchanged(recording.positions, *pair, slice(None))
    (finding,) = examine(points, recording.time, recording.rate)
    assert (finding.kind, finding.markers) == ("exchanged", pair)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_coordinate_held_at_its_limit_becomes_a_gap(recordings, axis):
    recording, _ = recordings("ktk_pig_com_oracle/gait.c3d")
    clipped = recording.positions["C7"].copy()
    limit = np.nanpercentile(clipped[:, axis], 80)
    over = clipped[:, axis] > limit
    clipped[over, axis] = limit
    findings = examine(
        changed(recording.positions, "C7", slice(None), clipped), recording.time, recording.rate
    )
    assert {(finding.kind, finding.markers) for finding in findings} == {("clipped", ("C7",))}
    assert sum(finding.n_frames for finding in findings) == pytest.approx(over.sum(), abs=4)


def test_a_racket_at_50_Hz_does_not_jump(recordings):
    """A wrist turns by 150 degrees in 0.1 s: what it holds changes its step by as much as other markers leap."""
    recording, _ = recordings("weird_squat_trc/markers_Squat2.trc")
    points = {label: positions[::2] for label, positions in recording.positions.items()}
    time = recording.time[::2]
    turn = np.radians(150) * (1 + np.tanh((time - time[100]) / 0.025)) / 2
    for label, length in (("RACKET1", 0.4), ("RACKET2", 0.7)):
        points[label] = points["RWRA"] + length * np.c_[0 * turn + 0.1, np.cos(turn), np.sin(turn)]
    assert examine(points, time, recording.rate / 2) == []


@pytest.mark.parametrize("label", ["C7", "LASI"])
def test_of_a_jump_the_part_that_is_no_body_is_left_out_also_where_it_is_the_longer_one(recordings, label):
    recording, _ = recordings("weird_squat_trc/markers_Squat2.trc")
    wrong = slice(0, 320)
    moved = recording.positions[label][wrong] + [0.06, 0.08, 0.0]
    (finding,) = examine(changed(recording.positions, label, wrong, moved), recording.time, recording.rate)
    assert (finding.kind, finding.markers, finding.frames) == ("jump", (label,), wrong)


def test_of_a_jump_that_most_frames_alone_tell_it_is_said(recordings):
    """No left and right marker is near enough to this C7."""
    recording, _ = recordings("athlete_floor_pickup_squats/squat.c3d")
    wrong = slice(0, 1700)
    moved = recording.positions["C7"][wrong] + [0.06, 0.08, 0.0]
    points = changed(recording.positions, "C7", wrong, moved)
    (finding,) = examine(points, recording.time, recording.rate)
    assert finding.frames.start == 1700
    assert "by most frames alone: the other part may be the wrong one" in finding.evidence


@pytest.mark.parametrize(("times", "kinds"), [(1, []), (2, ["rate"]), (0.5, ["rate"]), (-1, ["backwards"])])
@pytest.mark.parametrize("name", ["ktk_pig_com_oracle/gait.c3d", "qualisys_ior_gait/Qualisys.c3d"])
def test_a_walk_tells_a_rate_off_by_two_and_frames_in_reverse(recordings, name, times, kinds):
    recording, _ = recordings(name)
    points = {label: positions[:: int(np.sign(times))] for label, positions in recording.positions.items()}
    findings = examine(points, recording.time / abs(times), recording.rate * abs(times))
    assert [(finding.kind, finding.outcome) for finding in findings] == [(kind, "noted") for kind in kinds]


@pytest.mark.parametrize("decimals", [3, 4])
def test_coarse_numbers_are_neither_frozen_nor_clipped(recordings, decimals):
    recording, _ = recordings("s2m_box_transfer/Vicon.c3d")
    points = {label: np.round(positions, decimals) for label, positions in recording.positions.items()}
    assert examine(points, recording.time, recording.rate) == []


def leapt(recording, flight_s, on_step=False):
    """Let a body that stands leave the floor and land, at 200 Hz; on a step its feet stand still instead, and the rest moves."""
    time = np.arange(0, 2.4, 0.005)
    flown = np.clip(time - 1, 0, flight_s)
    height = 9.81 / 2 * flown * (flight_s - flown)
    step = np.interp(time, [0.4, 0.8, 1.6, 2.0], [0, 0.2, 0.2, 0])
    foot = step if on_step else height
    foot, rest = (
        np.convolve(np.pad(way, 4, "edge"), np.ones(9) / 9, "valid")
        for way in (foot, step * on_step + height)
    )
    rng, points = np.random.default_rng(1), {}
    for label, positions in recording.positions.items():
        lifted = foot if label[2:] in ("TOE", "HEEL", "ANKLE") else rest
        points[label] = positions[0] + lifted[:, None] * [0, 0, 1] + rng.normal(0, 6e-4, (len(time), 3))
    return points


@pytest.mark.parametrize(
    ("times", "flight_s", "on_step", "kinds", "told"),
    [
        (1, 0.4, False, [], True),
        (1, 0.25, False, [], True),
        (2, 0.4, False, ["rate"], True),
        (0.5, 0.4, False, ["rate"], True),
        (2, 0.1, False, [], False),
        (2, 0.4, True, [], False),
    ],
)
def test_gravity_in_flight_tells_the_rate(recordings, times, flight_s, on_step, kinds, told):
    recording, _ = recordings("expert_23kg")
    points = leapt(recording, flight_s, on_step)
    clock = np.arange(480) / (200 * times), 200 * times
    found = examine(points, *clock)
    assert [item.kind for item in found if "both feet" in item.evidence or not on_step] == kinds
    assert on_step or all(f"factor of about {times:.2g}," in item.cause for item in found)
    assert (FINE_RATE not in unchecked_properties(points, *clock)) == told
