"""Silent corruptions of real recordings are all named, nothing is found in untouched ones, jumps are left out to the frame."""

import re

import numpy as np
import pytest
from quality_corruptions import CORRUPTIONS, Trunk, changed, corrupted, exchanged

import lumbar
from lumbar.lifting.quality.body import side_pairs
from lumbar.lifting.quality.displacement import find_rigid_violations
from lumbar.lifting.quality.findings import REMEDIES, Legend
from lumbar.lifting.quality.gate import examine

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
"""One disturbed and one undisturbed of ten equal trials."""
SYNTHETIC = ("expert_23kg", "expert_15kg", "novice_23kg", "novice_15kg")


@pytest.fixture(scope="module")
def recordings(request, twin_lift):
    """Return a function that reads a recording once: markers by the file's labels, the nearest trunk markers."""
    tables = {}

    def read(name):
        if name not in tables:
            if name in SYNTHETIC:
                path, up, trunk = twin_lift(name), "+z", Trunk("C7", "T12", "L5")
            else:
                path = request.getfixturevalue("shared") / "real" / "lifting" / name
                up, trunk = RECORDINGS[name]
            layout = lumbar.MarkerLayout(up=up, forward="+x", check_axes=False)
            tables[name] = lumbar.read(path, layout=layout), trunk
        return tables[name]

    return read


@pytest.mark.parametrize("name", [*RECORDINGS, *SYNTHETIC])
def test_untouched_recording_has_no_findings(recordings, name):
    recording, _ = recordings(name)
    assert examine(recording.positions, recording.time, recording.rate) == []


@pytest.mark.parametrize("corruption", CORRUPTIONS)
@pytest.mark.parametrize("name", [*EACH_LABORATORY, *SYNTHETIC[:1]])
def test_a_silent_corruption_is_named_with_its_markers_and_frames(recordings, name, corruption):
    recording, trunk = recordings(name)
    tables = corrupted(corruption, recording.positions, recording.rate, trunk, np.random.default_rng(1))
    findings = examine(tables.points, np.arange(len(recording)) / tables.rate, tables.rate)
    assert [finding.kind for finding in findings] == [tables.kind], findings
    (finding,) = findings
    assert frozenset(finding.markers) == tables.markers
    frames = tables.frames or slice(0, len(recording))
    assert abs(finding.frames.start - frames.start) <= 1
    assert abs(finding.frames.stop - frames.stop) <= 1


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.statistical)])
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
        ):
            findings = examine(spoilt, recording.time, rate)
            assert {label for finding in findings for label in finding.markers} == markers
            assert min(finding.frames.start for finding in findings) == pytest.approx(frames.start, abs=1)
            assert max(finding.frames.stop for finding in findings) == pytest.approx(frames.stop, abs=1)


def test_all_sides_exchanged_are_reported_as_a_mirrored_body(recordings):
    recording, _ = recordings("ktk_pig_com_oracle/gait.c3d")
    points = dict(recording.positions)
    for left, right in side_pairs(points):
        points = exchanged(points, left, right, slice(None))
    (finding,) = examine(points, recording.time, recording.rate)
    assert (finding.kind, finding.outcome) == ("mirrored", "error")


@pytest.mark.parametrize(
    ("height_m", "kinds"), [(1.60, []), (1.75, []), (2.2, ["stature"]), (0.75, ["unit"])]
)
def test_lengths_of_the_body_are_compared_with_the_stature(recordings, height_m, kinds):
    """The static trial is of an athlete 1.60 m tall."""
    recording, _ = recordings("athlete_static_full_spine/c3dfile1.c3d")
    findings = examine(recording.positions, recording.time, recording.rate, height_m)
    assert [finding.kind for finding in findings] == kinds


def test_legs_that_change_sides_are_reported_pair_by_pair(recordings):
    """All leap at once, each to where its fellow was and near to where others were."""
    walk, _ = recordings("ktk_pig_com_oracle/gait.c3d")
    points, time, rate = walk.positions, walk.time, walk.rate
    pairs = [(f"L{part}", f"R{part}") for part in ("THI", "KNE", "TIB", "ANK", "HEE", "TOE")]
    spoilt = {label: positions.copy() for label, positions in points.items()}
    for left, right in pairs:
        spoilt[left][200:], spoilt[right][200:] = points[right][200:], points[left][200:]
    actual = examine(spoilt, time, rate)
    assert {finding.kind for finding in actual} == {"exchanged"}
    assert sorted(tuple(sorted(finding.markers)) for finding in actual) == sorted(pairs)
    assert {(finding.first_frame, finding.frames.stop) for finding in actual} == {(200, len(time))}


def test_noise_of_all_markers_is_one_finding(recordings):
    walk, _ = recordings("ktk_pig_com_oracle/gait.c3d")
    points, time, rate = walk.positions, walk.time, walk.rate
    rng = np.random.default_rng(0)
    (actual,) = examine({k: v + rng.normal(0, 5e-3, v.shape) for k, v in points.items()}, time, rate)
    assert (actual.kind, actual.markers) == ("jitter", ())
    least, largest = map(float, re.findall(r"\d+\.\d", actual.evidence))
    assert [least, largest] == pytest.approx([np.sqrt(3) * 5] * 2, rel=0.1)


LAYOUT = lumbar.MarkerLayout(up="+z", forward="+x", check_axes=False)
DRIFT = 30


@pytest.fixture(scope="module")
def box_transfer(shared):
    return lumbar.read(shared / "real" / "lifting" / "s2m_box_transfer" / "Vicon.c3d", layout=LAYOUT)


def drifted(recording, label, start, direction=(1.0, 0.0, 0.0)):
    """Let a marker drift 0.1 m away over 30 frames; then it is back."""
    frames = slice(start, start + DRIFT)
    away = np.linspace(0, 0.1, DRIFT)[:, None] * np.array(direction)
    return changed(recording.positions, label, frames, recording[label][frames] + away)


def test_only_wrong_frames_of_a_real_recording_are_left_out(shared):
    """The distance of RSK1 from RSK2 is 103 to 111 mm except in frames 137 to 166, where it grows to 157 mm."""
    recording = lumbar.read(shared / "real" / "c3d_edge" / "01_intel_int.c3d", layout=LAYOUT)
    actual = {
        finding.markers: finding.frames
        for finding in examine(recording.positions, recording.time, recording.rate)
    }
    assert set(actual) == {("RSK1",), ("RTH2",), ("LFT3",)}
    assert (actual["RSK1",].start, actual["RSK1",].stop) == (pytest.approx(137, abs=3), 167)
    assert (actual["RTH2",].start, actual["RTH2",].stop) == (pytest.approx(416, abs=3), 424)
    assert actual["LFT3",] == slice(0, 43)
    distance = np.linalg.norm(recording["RSK1"] - recording["RSK2"], axis=1)
    kept = np.delete(distance, np.r_[actual["RSK1",]])
    assert np.nanmin(kept) > 0.1
    assert np.nanmax(kept) < 0.115


@pytest.mark.parametrize("start", [140, 270, 430])
def test_drift_that_ends_in_a_leap_is_left_out(box_transfer, start):
    (finding,) = examine(drifted(box_transfer, "T10", start), box_transfer.time, box_transfer.rate)
    assert (finding.kind, finding.outcome, finding.markers) == ("jump", "left out", ("T10",))
    assert finding.frames.start == pytest.approx(start, abs=6)
    assert finding.frames.stop == start + DRIFT


def test_ambiguous_leap_is_noted_and_keeps_all_frames():
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


@pytest.mark.parametrize("cut", [200, 290])
def test_cut_out_frames_are_one_error(box_transfer, cut):
    kept = np.delete(np.arange(len(box_transfer)), np.r_[cut : cut + 30])
    points = {label: positions[kept] for label, positions in box_transfer.positions.items()}
    (finding,) = examine(points, np.arange(len(kept)) / box_transfer.rate, box_transfer.rate)
    assert (finding.kind, finding.outcome, finding.markers) == ("missing frames", "error", ())
    assert finding.frames == slice(cut - 1, cut + 1)


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
    """A person rests for half a minute and steps once: the heel first, then the other foot's whole."""
    step = [0, 0.3, 0] * ramp(14.0, 14.5)
    left = part(("L_HEEL", "L_TOE", "L_ANKLE", "L_FOOT"), np.zeros(3), step)
    left["L_HEEL"] = left["L_HEEL"] + [0, 0, 0.12] * (ramp(13.8, 14.0) - ramp(14.5, 14.7))
    right = part(("R_HEEL", "R_TOE", "R_ANKLE", "R_FOOT"), np.array([0.3, 0, 0]), 0 * step)
    noise = np.random.default_rng(1)
    return {name: places + noise.normal(0, 2e-4, places.shape) for name, places in (left | right).items()}


def test_two_feet_on_the_ground_are_not_one_body(two_feet):
    assert find_rigid_violations(two_feet, Legend(TIME, RATE)) == []


def test_a_marker_off_a_box_that_is_carried_is_found(two_feet):
    names = ("BOX_1", "BOX_2", "BOX_3", "BOX_4")
    box = part(names, np.array([0, 0.5, 0.3]), [0, 0.2, 0.7] * ramp(10.0, 13.0))
    box["BOX_3"][1150:1162] += [0.05, 0, 0]
    [off] = find_rigid_violations(two_feet | box, Legend(TIME, RATE))
    assert (off.markers, off.frames) == (("BOX_3",), slice(1150, 1162))
    assert "BOX_1" in off.evidence


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
def test_wrong_side_of_a_jump_is_left_out_even_if_longer(recordings, label):
    recording, _ = recordings("weird_squat_trc/markers_Squat2.trc")
    wrong = slice(0, 320)
    moved = recording.positions[label][wrong] + [0.06, 0.08, 0.0]
    (finding,) = examine(changed(recording.positions, label, wrong, moved), recording.time, recording.rate)
    assert (finding.kind, finding.markers, finding.frames) == ("jump", (label,), wrong)


@pytest.mark.parametrize("decimals", [3, 4])
def test_coarse_numbers_are_not_frozen(recordings, decimals):
    recording, _ = recordings("s2m_box_transfer/Vicon.c3d")
    points = {label: np.round(positions, decimals) for label, positions in recording.positions.items()}
    assert examine(points, recording.time, recording.rate) == []


def test_every_kind_of_finding_is_explained(project):
    lifting = project / "workflow" / "lumbar" / "lifting"
    sources = [*(lifting / "quality").glob("*.py"), lifting / "movement" / "rigid_filling.py"]
    text = "".join(path.read_text(encoding="utf-8") for path in sources)
    assert [kind for kind in REMEDIES if text.count(f'"{kind}"') < 2] == []
    page = (project / "docs" / "lifting" / "quality.md").read_text(encoding="utf-8")
    explained = r"^\| `([a-z ]+)` \| (?:error|left|proposed|noted)[^|]*\| [^|]+\| [^|]+\|$"
    assert set(REMEDIES) == set(re.findall(explained, page, re.MULTILINE))
