"""Marker recordings: units, axes, aliases and prefixes, and the real lifting files."""

import numpy as np
import pytest
from c3d_builder import build_c3d
from lifting_cases import missing_share

import lumbar
from refusing import has_tokens, refusal

pytestmark = pytest.mark.usefixtures("read_in_this_process")

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}

BODY = {  # metres; x right, y forward, z up
    "C7": (0.0, 0.0, 1.45),
    "SACRUM": (0.0, -0.08, 1.0),
    "L_HIP": (-0.17, 0.0, 0.92),
    "R_HIP": (0.17, 0.0, 0.92),
    "L_HEEL": (-0.12, -0.08, 0.03),
    "R_HEEL": (0.12, -0.08, 0.03),
    "L_TOE": (-0.14, 0.14, 0.02),
    "R_TOE": (0.14, 0.14, 0.02),
}
STANDARD = dict(zip(BODY, BODY, strict=True))


def layout_of(**keys):
    """Return a layout as in a study's YAML."""
    return lumbar.MarkerLayout.model_validate(keys)


def read_markers(path, layout=None):
    return lumbar.read(path, "markers", layout=layout or lumbar.MarkerLayout())


def file_axes(up: str, forward: str) -> np.ndarray:
    """Return the standard axes x lateral (right), y forward, z up as rows in a file's axes."""
    rows = [np.eye(3)["xyz".index(axis[1])] * (1 if axis[0] == "+" else -1) for axis in (forward, up)]
    return np.array([np.cross(*rows), *rows])


def write(tmp_path, positions, axes=None, unit="mm", **options):
    """Write `positions` (standard axes, metres) as C3D, in a file's axes given as rows of a rotation."""
    rotation = np.eye(3) if axes is None else axes
    points = np.stack([np.broadcast_to(value, (20, 3)) for value in positions.values()], axis=1)
    sway = 0.003 * np.sin(np.linspace(0, 6, 20))[:, None, None]
    stored = (points + sway) @ rotation / METRES[unit if unit in METRES else "mm"]
    path = tmp_path / "trial.c3d"
    path.write_bytes(build_c3d(stored, list(positions), unit=unit, **options))
    return path


# Units and axes


@pytest.mark.parametrize("unit", ["m", "cm", "mm"])
def test_unit_of_file_is_read(tmp_path, unit):
    recording = read_markers(write(tmp_path, BODY, unit=unit))
    np.testing.assert_allclose(recording["C7"].mean(axis=0)[2], 1.45, atol=0.003)


@pytest.mark.parametrize(("stated", "tokens"), [("", "no unit"), ("inch", "unit 'inch'")])
def test_missing_or_unknown_unit_is_rejected(tmp_path, stated, tokens):
    path = write(tmp_path, BODY, unit=stated or " ")
    assert has_tokens(refusal(read_markers, path, layout_of(unit="file")), f"trial.c3d … {tokens}")


AXES = ["+x", "-x", "+y", "-y", "+z", "-z"]
PAIRS = [(up, forward) for up in AXES for forward in AXES if up[1] != forward[1]]


@pytest.mark.parametrize(("up", "forward"), PAIRS)
def test_every_orientation_is_read(tmp_path, up, forward):
    rotation = file_axes(up, forward)
    assert np.linalg.det(rotation) == pytest.approx(1)
    path = write(tmp_path, BODY, axes=rotation)
    recording = read_markers(path, layout_of(up=up, forward=forward, aliases=STANDARD))
    for name, position in BODY.items():
        np.testing.assert_allclose(recording[name].mean(axis=0), position, atol=0.003)


@pytest.mark.parametrize(
    ("up", "forward", "declared", "tokens"),
    [
        ("+y", "+x", {}, 'up: "+y"'),
        ("-z", "+y", {}, 'up: "-z"'),
        ("+z", "-y", {}, 'forward: "-y"'),
        ("+z", "+x", {}, 'forward: "+x"'),
        ("+z", "+y", {"up": "+z", "forward": "-z"}, "up … +z … forward … -z"),
    ],
)
def test_axes_that_contradict_the_body_are_rejected(tmp_path, up, forward, declared, tokens):
    path = write(tmp_path, BODY, axes=file_axes(up, forward))
    assert has_tokens(refusal(read_markers, path, layout_of(aliases=STANDARD, **declared)), tokens)
    if not declared:
        read_markers(path, layout_of(aliases=STANDARD, check_axes=False))


@pytest.mark.parametrize(
    ("degrees", "fits"), [(0, True), (40, True), (-40, True), (75, False), (-100, False)]
)
def test_facing_within_tolerance_is_accepted(tmp_path, degrees, fits):
    turn = np.deg2rad(degrees)
    about_up = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    path = write(tmp_path, {name: about_up @ value for name, value in BODY.items()})
    if fits:
        read_markers(path, layout_of(aliases=STANDARD))
    else:
        message = refusal(read_markers, path, layout_of(aliases=STANDARD))
        assert has_tokens(message, 'faces along … forward: "')


def test_swapped_sides_are_rejected(tmp_path):
    swapped = {name: name.replace("L_", "r_").replace("R_", "L_").replace("r_", "R_") for name in BODY}
    path = write(tmp_path, BODY)
    message = refusal(read_markers, path, layout_of(aliases=swapped))
    assert has_tokens(message, "left … right … swapped") and not has_tokens(message, "forward:")


WALKING = (
    ("10_plugin_outputs.c3d", "+x"),
    ("07_subject_labels.c3d", "-x"),
)


@pytest.mark.parametrize(("name", "forward"), WALKING)
def test_axes_of_walking_subject_are_compared_per_frame(shared, name, forward):
    """Markers of the feet are hidden in different halves of the walk: their medians over time lie metres apart."""
    layout = lumbar.StudySettings().lifting.markers
    path = shared / "real" / "c3d_edge" / name
    assert len(read_markers(path, layout.model_copy(update={"required": (), "forward": forward}))) > 100
    for wrong in {"+x", "-x", "+y", "-y"} - {forward}:
        message = refusal(read_markers, path, layout.model_copy(update={"required": (), "forward": wrong}))
        assert has_tokens(message, f'faces along {forward} … forward: "{forward}"')


def test_markers_never_seen_together_show_no_axis(tmp_path):
    walk = np.linspace(0, 3, 20)[:, None] * [0, -1, 0]
    markers = {name: walk + value for name, value in BODY.items()}
    for side in "LR":
        markers[f"{side}_HEEL"][10:] = markers[f"{side}_TOE"][:10] = np.nan
    path, wrong = write(tmp_path, markers), layout_of(aliases=STANDARD, forward="-y")
    assert has_tokens(refusal(read_markers, path, wrong), 'forward: "+y"')
    read_markers(path, layout_of(aliases=STANDARD))


def test_sides_name_the_axis_that_fits_or_the_labels(tmp_path):
    """Without toes the trunk's front tells; without it both causes stay."""
    sides = {name: BODY[name] for name in ("C7", "SACRUM", "L_HIP", "R_HIP", "L_HEEL", "R_HEEL")}
    path = write(tmp_path, sides)
    message = refusal(read_markers, path, layout_of(aliases={name: name for name in sides}, forward="-y"))
    assert has_tokens(message, 'forward: "+y" … left … right … swapped')
    front = {**sides, "L_ASIS": (-0.12, 0.1, 1.0), "R_ASIS": (0.12, 0.1, 1.0)}
    path = write(tmp_path, front)
    aliases = {name: name for name in front}
    message = refusal(read_markers, path, layout_of(aliases=aliases, forward="-y"))
    assert has_tokens(message, 'faces along +y … forward: "+y"') and not has_tokens(message, "swapped")
    aliases |= {f"{a}_{part}": f"{b}_{part}" for part in ("HIP", "HEEL") for a, b in ("LR", "RL")}
    message = refusal(read_markers, path, layout_of(aliases=aliases))
    assert has_tokens(message, "left … right … swapped") and not has_tokens(message, "forward:")


def test_uncheckable_axes_are_reported(tmp_path, run):
    path = write(tmp_path, {f"Q{number}": point for number, point in enumerate(BODY.values())})
    message = run.done("check", path)
    assert has_tokens(message, "not checked … up … forward")
    assert not has_tokens(run("check", write(tmp_path, BODY))[1], "not checked")


def test_person_bent_to_the_floor_does_not_contradict_up(tmp_path):
    bent = {**BODY, "C7": (0, 0.55, 0.75)}
    read_markers(write(tmp_path, bent), layout_of(aliases=STANDARD))


# Aliases


def read(tmp_path, aliases, positions=BODY, **layout):
    return read_markers(write(tmp_path, positions), layout_of(aliases=aliases, check_axes=False, **layout))


def test_alternatives_mean_share_and_offset(tmp_path):
    aliases = {
        "C7": ["CV7", "C7"],
        "SACRUM": "SACRUM",
        "T12": [{"between": ["C7", "SACRUM"], "share": 0.66}],
        "L5": {"from": {"mean": ["L_HIP", "R_HIP"]}, "offset_m": [0, -0.05, 0.1]},
    }
    recording = read(tmp_path, aliases)
    sway = recording["C7"] - BODY["C7"]
    np.testing.assert_allclose(recording["T12"] - sway, np.tile([0, -0.0528, 1.153], (20, 1)), atol=1e-6)
    np.testing.assert_allclose(recording["L5"] - sway, np.tile([0, -0.05, 1.02], (20, 1)), atol=1e-6)
    assert list(recording.derived) == ["T12", "L5"]
    assert has_tokens(recording.derived["T12"], "0.66 … C7 … SACRUM")
    assert has_tokens(recording.derived["L5"], "L_HIP … R_HIP … (0, -0.05, 0.1) m")
    assert set(recording.unused) == {"L_HEEL", "R_HEEL", "L_TOE", "R_TOE"}


def test_alias_of_derived_marker_is_derived(tmp_path):
    recording = read(tmp_path, {"L5": "MIDHIP", "MIDHIP": {"mean": ["L_HIP", "R_HIP"]}})
    assert list(recording.derived) == ["L5", "MIDHIP"]
    assert all(has_tokens(rule, "mean … L_HIP … R_HIP") for rule in recording.derived.values())


def test_parts_of_rule_are_aliases_first(tmp_path):
    """A file's L_HIP need not be the trochanter the table means by L_HIP."""
    recording = read(tmp_path, {"L_HIP": "L_TOE", "MIDDLE": {"mean": ["L_HIP", "R_TOE"]}})
    np.testing.assert_allclose(recording["MIDDLE"].mean(axis=0), [0, 0.14, 0.02], atol=0.003)


def test_swapping_aliases_refer_to_labels(tmp_path):
    recording = read(tmp_path, {"L_HIP": "R_HIP", "R_HIP": "L_HIP"})
    np.testing.assert_allclose(recording["L_HIP"].mean(axis=0), BODY["R_HIP"], atol=0.003)


def test_derived_marker_is_missing_with_its_part(tmp_path):
    hidden = {**BODY, "L_HIP": np.tile(BODY["L_HIP"], (20, 1))}
    hidden["L_HIP"][5:8] = np.nan
    recording = read(tmp_path, {"PELVIS": {"mean": ["L_HIP", "R_HIP"]}}, hidden)
    assert np.flatnonzero(np.isnan(recording["PELVIS"][:, 0])).tolist() == [5, 6, 7]


NEVER_TOGETHER = {name: np.tile(BODY[name], (20, 1)) for name in ("L_HIP", "R_HIP", "C7")}
NEVER_TOGETHER["L_HIP"][:10] = NEVER_TOGETHER["R_HIP"][10:] = np.nan
TWO = {"A:C7": BODY["C7"], "A:TOE": BODY["L_TOE"], "B:C7": BODY["SACRUM"], "box:P1": BODY["R_TOE"]}
TWO_CENTRES = {"A:C7": BODY["C7"], "A:CentreOfMass": BODY["L_HIP"], "B:CentreOfMass": BODY["R_HIP"]}
UNLIKE = {"C7": "CV7", "L_TOE": ["LTOE", "LFM1"], "SACRUM": "SACRUM"}


@pytest.mark.parametrize(
    ("positions", "layout", "tokens"),
    [
        (NEVER_TOGETHER, {"aliases": {"PELVIS": {"mean": ["L_HIP", "R_HIP"]}}}, "markers.aliases.PELVIS … L_HIP … R_HIP"),
        (BODY, {"aliases": UNLIKE}, "markers.aliases.C7 … CV7 … C7"),
        (BODY, {"aliases": UNLIKE}, "markers.aliases.L_TOE … LTOE … LFM1 … L_TOE"),
        (BODY, {"aliases": UNLIKE}, "C7, SACRUM, L_HIP"),
        (BODY, {"aliases": {"C7": []}}, "markers.aliases.C7 … empty … C7"),
        (BODY, {"aliases": {"A": {"mean": ["B", "C7"]}, "B": {"mean": ["A", "C7"]}}}, "markers.aliases.A … no A"),
        (BODY, {"aliases": {"C7": "C7"}, "required": ["T12"]}, "markers.required … T12"),
        ({**BODY, "LHipAngles": (0.1, 0.2, 0.3)}, {"aliases": {"L_HIP": "LHipAngles"}}, "markers.aliases.L_HIP … LHipAngles"),
        (TWO, {}, "C7 … markers.subject_prefix … A, B, box"),
        (TWO, {"subject_prefix": "C"}, "prefix 'C:'"),
        (TWO_CENTRES, {"aliases": {"BODY_COM": "CentreOfMass"}}, "markers.aliases.BODY_COM … CentreOfMass … several subjects"),
    ],
)  # fmt: skip
def test_unresolved_labels_are_rejected(tmp_path, positions, layout, tokens):
    message = refusal(read_markers, write(tmp_path, positions), layout_of(check_axes=False, **layout))
    assert has_tokens(message, tokens)


def test_subject_prefix_is_kept_or_chosen(tmp_path):
    path = write(tmp_path, TWO)
    assert list(read_markers(path, layout_of(subject_prefix="keep")).positions) == list(TWO)
    chosen = read_markers(path, layout_of(subject_prefix="A"))
    assert list(chosen.positions) == ["C7", "TOE", "B:C7", "box:P1"]


def test_optional_markers_may_be_absent(tmp_path):
    recording = read(tmp_path, {"C7": "C7", "T12": "T12"}, required=["C7"])
    assert list(recording.absent) == ["T12"]
    assert "T12" not in recording
    with pytest.raises(lumbar.InputError, match=r"\bT12\b"):
        recording["T12"]


# Files


def test_absent_file_and_unknown_suffix_are_rejected(tmp_path):
    assert has_tokens(refusal(read_markers, tmp_path / "absent.c3d"), "absent.c3d: no … file")
    (tmp_path / "trial.xyz").write_text("time_s\n0\n")
    message = refusal(read_markers, tmp_path / "trial.xyz")
    assert has_tokens(message, "trial.xyz … .c3d … .gz … '.xyz'")


@pytest.mark.parametrize(
    ("name", "frames", "rate", "markers", "missing_percent", "start_s"),
    [  # from the README of each folder
        ("qualisys_ior_gait/Qualisys.c3d", 340, 200, 55, 0, 3.52),
        ("s2m_box_transfer/Vicon.c3d", 580, 100, 51, 1.03, 0),
        ("weird_squat_trc/markers_Squat2.trc", 460, 100, 61, 0.49, 0.01),
        ("sts_trunk_flexion_trc/sts_perturbed_5.trc", 251, 100, 18, 0, 130.7),
    ],
)
def test_real_recordings(shared, name, frames, rate, markers, missing_percent, start_s):
    recording = read_markers(shared / "real" / "lifting" / name)
    assert (len(recording), recording.rate, len(recording.positions)) == (frames, rate, markers)
    assert 100 * missing_share(recording) == pytest.approx(missing_percent, abs=0.005)
    assert recording.time[0] == pytest.approx(start_s)
    assert np.diff(recording.time) == pytest.approx(1 / rate)


def test_plug_in_gait_centre_of_mass_needs_alias(shared):
    path = shared / "real" / "lifting" / "ktk_pig_com_oracle" / "gait.c3d"
    plain = read_markers(path)
    assert "CentreOfMass" not in plain
    assert has_tokens(plain.dropped["CentreOfMass"], "mass")
    assert has_tokens(plain.dropped["PELO"], "axis")
    assert len(plain.positions) == 35
    requested = read_markers(path, layout_of(aliases={"BODY_COM": "CentreOfMass", "C7": "C7"}))
    assert list(requested.derived) == ["BODY_COM"]
    assert has_tokens(requested.derived["BODY_COM"], "CentreOfMass … mass")
    above = requested["C7"] - requested["BODY_COM"]
    assert 0.3 < np.nanmedian(above[:, 2]) < 0.6
