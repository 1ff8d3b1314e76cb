"""Silent corruptions of real lifting recordings are all named, and nothing is found in the untouched ones."""

import numpy as np
import pytest
from quality_corruptions import CORRUPTIONS, Trunk, changed, corrupted, exchanged

from lumbar.lifting.quality.gate import examine
from lumbar.lifting.quality.landmarks import side_pairs
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
