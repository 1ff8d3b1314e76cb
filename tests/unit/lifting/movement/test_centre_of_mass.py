"""Joint centres, segment tables and centres of mass: by hand, by Plug-in Gait and another implementation, in recordings."""

import numpy as np
import pytest
from lifting_cases import ALIASES, ANN, hide_markers, recording_of, trial_of
from scipy.spatial.transform import Rotation

import lumbar
from refusing import has_tokens
from study_settings import changed

LIFTING = lumbar.load_settings().lifting
SPINE = {"C7T1": "C7", "T12L1": "T12", "L4L5": "L5", "L5S1": "L5"}
TIME = np.arange(0, 2, 0.01)
HELD = (TIME >= 0.5) & (TIME <= 1.5)


def resting(points):
    return recording_of(
        {name: np.tile(np.array(point, float), (len(TIME), 1)) for name, point in points.items()}
    )


def centres_of(recording, mass_kg=23.0, **settings):
    """Centres of mass with segments between markers; the box is held from 0.5 to 1.5 s."""
    trial = trial_of(mass_kg, {"lift_off_s": 0.5, "release_s": 1.5})
    chosen = changed(LIFTING, segment_ends="skin", **settings)
    return lumbar.lift(recording, ANN, trial=trial, settings=chosen).analysed.centres


STANDING = {
    "C7": (0, 0, 1.5),
    "T12": (0, -0.1, 1.2),
    "L5": (0, -0.1, 1.0),
    "L_HIP": (-0.15, 0, 0.9),
    "R_HIP": (0.15, 0, 0.9),
    "BOX_1": (-0.2, 0.4, 1.0),
    "BOX_2": (0.2, 0.4, 1.0),
}


@pytest.fixture
def standing():
    return resting(STANDING)


def test_positions_by_hand(standing):
    centres = centres_of(standing)
    assert centres["thorax"].position[0] == pytest.approx([0, -0.082, 1.5 - 0.82 * 0.3])
    assert centres["abdomen"].position[0] == pytest.approx([0, -0.1, 1.2 - 0.44 * 0.2])
    assert centres["pelvis"].position[0] == pytest.approx([0, -0.1 + 0.105 * 0.1, 1.0 - 0.105 * 0.1])


def test_trunk_and_box_keep_their_mass_and_their_common_centre(standing):
    centres = centres_of(standing).values()
    total = sum(centre.mass_with_box_kg for centre in centres)
    assert total == pytest.approx(0.497 * 80 + 23)
    with_box = sum(centre.mass_with_box_kg * centre.position_with_box[100] for centre in centres) / total
    parts = sum(centre.mass_kg * centre.position[100] for centre in centres)
    assert with_box == pytest.approx((parts + 23 * np.array([0, 0.4, 1.0])) / total)


def test_the_box_counts_only_between_lift_off_and_release(standing):
    for centre in centres_of(standing, box={"share": "whole"}).values():
        moved = np.linalg.norm(centre.position_with_box - centre.position, axis=1) > 1e-9
        assert np.array_equal(moved, HELD)
        assert centre.mass_with_box_kg == pytest.approx(centre.mass_kg + 23)


def test_segments_without_landmarks_are_missing_by_name(standing):
    lift = lumbar.lift(
        hide_markers(standing, "HIP"), ANN, 23.0, settings=changed(LIFTING, segment_ends="skin")
    )
    assert set(lift.analysed.centres) == {"thorax", "abdomen"}
    assert has_tokens(lift.analysed.missing["pelvis"], "MID_HIP…L_HIP, R_HIP")


def test_hands_replace_a_box_without_markers():
    bare, hands = {name: point for name, point in STANDING.items() if "BOX" not in name}, (-0.2, 0.5, 1.0)
    by_hands, by_box = (
        centres_of(resting({**bare, **dict.fromkeys(names, hands)}))
        for names in (("L_WRIST", "R_WRIST"), ("BOX_1",))
    )
    for name, centre in by_hands.items():
        assert np.array_equal(centre.position_with_box, by_box[name].position_with_box)


def test_without_box_and_hands_positions_with_box_are_unknown(standing):
    for centre in centres_of(hide_markers(standing, "BOX")).values():
        assert np.array_equal(np.isnan(centre.position_with_box[:, 0]), HELD)
        assert np.isfinite(centre.position).all()


POSE = Rotation.from_euler("zxy", [35, 50, -12], degrees=True)
SHIFT = np.array([1.2, -0.4, 0.9])
FRAMES = 60


def posed(point):
    """A point (right, forward, up; millimetres) of a body that is turned and shifted, at every frame; metres."""
    return np.tile(POSE.apply(np.asarray(point, dtype=float) / 1000) + SHIFT, (FRAMES, 1))


def unposed(points):
    return POSE.inv().apply(points - SHIFT)[0] * 1000


def body(*left_out, **changed):
    points = {
        "C7": (0, -65, 500),
        "T12": (0, -75, 240),
        "T8": (0, -95, 330),
        "MANUBRIUM": (0, 55, 440),
        "XIPHOID": (0, 110, 300),
        "L5": (0, -105, 120),
        "SACRUM": (0, -100, 90),
        **{f"{side}_ASIS": (x * 120, 55, 73) for side, x in (("L", -1), ("R", 1))},
        **{f"{side}_PSIS": (x * 45, -92, 102) for side, x in (("L", -1), ("R", 1))},
        **{f"{side}_HIP": (x * 165, 0, 0) for side, x in (("L", -1), ("R", 1))},
        **{f"{side}_ANKLE": (x * 110, -50, -860) for side, x in (("L", -1), ("R", 1))},
        **changed,
    }
    positions = {name: posed(point) for name, point in points.items() if name not in left_out}
    return recording_of(positions)


def points_of(recording, hips="harrington", sex="male", ends="inner", **settings):
    """Ends of the segments."""
    chosen = changed(LIFTING, hip_centres=hips, segment_ends=ends, **settings)
    subject = ANN.model_copy(update={"sex": sex})
    return lumbar.lift(recording, subject, 0.0, settings=chosen).analysed.points


def pelvis(width, depth, **changed):
    """Origin between the ASIS, axes those of the pose."""
    sides = {f"{side}_ASIS": (x * width / 2, 0, 0) for side, x in (("L", -1), ("R", 1))}
    return body(**sides, **dict.fromkeys(("L_PSIS", "R_PSIS"), (0, -depth, 0)), **changed)


@pytest.mark.parametrize(
    ("hips", "sex", "expected"),
    [
        ("harrington", "male", (86.5, -45.9, -82.9)),  # 0.33*240+7.3, -0.24*150-9.9, -0.30*240-10.9
        ("hara", "male", (85.4, -45.7, -79.2)),  # a leg of 900 mm
        ("reed", "male", (86.64, -22.8, -88.8)),  # shares of the width
        ("reed", "female", (89.28, -33.36, -80.64)),
        ("reed", "unknown", (87.96, -28.08, -84.72)),
    ],
)
def test_hips_by_hand(hips, sex, expected):
    ankles = {f"{side}_ANKLE": (x * 120, 0, -900) for side, x in (("L", -1), ("R", 1))}
    points = points_of(pelvis(240, 150, **ankles), hips, sex)
    assert unposed(points.hips["R_HIP"]) == pytest.approx(expected)
    assert unposed(points["MID_HIP"]) == pytest.approx((0, *expected[1:]), abs=1e-9)


def test_unknown_sex_lies_between_the_sexes():
    between = [
        unposed(points_of(pelvis(240, 150), "reed", sex=sex)["L5S1"]) for sex in ("female", "unknown", "male")
    ]
    assert between[1] == pytest.approx((between[0] + between[2]) / 2, abs=1e-9)
    assert between[2] == pytest.approx([0, -80.4, -7.68], abs=1e-9)


def homogeneous(origin, axes, angle_deg, point):
    """The point by a turning matrix about the third axis, as Dumas and Wojtusch's users write it."""
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    frame, turn = np.eye(4), np.eye(4)
    frame[:3, :3], frame[:3, 3] = np.column_stack(axes), origin
    turn[:2, :2] = [[c, s], [-s, c]]
    return (frame @ turn @ [*point, 1.0])[:3]


@pytest.mark.parametrize(
    ("sex", "cervical", "thoracic"), [("male", (-8, 0.55), (94, 0.52)), ("female", (-14, 0.53), (92, 0.50))]
)
def test_spine_as_an_independent_implementation_has_it(sex, cervical, thoracic):
    markers = {"C7": [2, -70, 300], "MANUBRIUM": [-3, 55, 250], "T8": [1, -100, 120], "T12": [0, -85, 0]}
    c7, notch, t8, t12 = map(posed, markers.values())
    points = points_of(body(**markers), sex=sex)
    across = np.cross(notch[0] - c7[0], c7[0] - t12[0])
    across /= np.linalg.norm(across)
    width = np.linalg.norm(notch[0] - c7[0])
    forward = (notch[0] - c7[0]) / width
    expected = homogeneous(
        c7[0], (forward, np.cross(across, forward), across), cervical[0], (cervical[1] * width, 0, 0)
    )
    assert points["C7T1"][0] == pytest.approx(expected)
    up = (t8[0] - t12[0]) / np.linalg.norm(t8[0] - t12[0])
    ahead = np.cross(up, across)
    expected = homogeneous(t12[0], (ahead, up, across), thoracic[0], (0, thoracic[1] * width, 0))
    assert points["T12L1"][0] == pytest.approx(expected)
    # In front of the spine's skin and inside the body.
    assert -85 < unposed(points["T12L1"])[1] < 0


@pytest.mark.parametrize(("sex", "expected"), [("male", (-0.336, -0.149)), ("female", (-0.371, -0.050))])
def test_dumas_pelvis_agrees_with_the_authors_other_table(sex, expected):
    """Dumas et al., J. Biomech. 40 (2007), Table 2 alternative: from the middle of the ASIS, shares of the width."""
    points = points_of(pelvis(1000, 600), "reed", sex=sex)
    top, bottom = points["L5S1"], points["MID_HIP"]
    subject, dumas = ANN.model_copy(update={"sex": sex}), changed(LIFTING, segments="dumas")
    segment = lumbar.lift(body(), subject, 0.0, settings=dumas).analysed.table.segments[2]
    line = bottom - top
    ahead = np.cross(-line, points.right)
    centre = unposed(top + segment.com_share * line + segment.forward_share * ahead) / 1000
    assert centre == pytest.approx([0, *expected], abs=1e-3)


def test_all_points_are_inside_the_body_with_all_markers():
    points = points_of(body())
    assert not points.list_skin_rules(points.points)
    assert not points.missing
    skin = points_of(body(), ends="skin")
    for name, depth in (("C7T1", 75), ("T12L1", 72), ("L4L5", 85)):
        ahead = unposed(points[name]) - unposed(skin[name])
        assert ahead[1] == pytest.approx(depth, abs=15)
    assert abs(unposed(points["XIPHOID_LEVEL"])[2] - 300) < 10


@pytest.mark.parametrize(
    ("left_out", "on_skin", "message"),
    [
        (("L_ASIS",), {"L4L5", "L5S1", "MID_HIP"}, "L_ASIS"),
        (("MANUBRIUM", "XIPHOID"), {"C7T1", "T12L1"}, "MANUBRIUM"),
        (("L_PSIS", "SACRUM"), {"L4L5", "L5S1", "MID_HIP"}, "L_PSIS"),
    ],
)
def test_points_on_the_skin_report_their_possible_error(left_out, on_skin, message):
    points = points_of(body(*left_out))
    assert {name for name, point in points.points.items() if not point.inner} == on_skin
    assert len(points.list_skin_rules(points.points)) == len(on_skin)
    for name in on_skin:
        point = points.points[name]
        assert message in point.rule
        assert has_tokens(point.rule, f"{point.off_mm:g} mm")
        assert point.markers == (("L_HIP", "R_HIP") if name == "MID_HIP" else (SPINE[name],))


def test_sacrum_replaces_psis_and_c7_replaces_t8():
    points = points_of(body("R_PSIS", "T8")).points
    assert "SACRUM" in points["MID_HIP"].markers
    assert has_tokens(points["T12L1"].rule, "C7…T8")
    assert points["T12L1"].off_mm > points["C7T1"].off_mm


def test_missing_point_lists_each_marker_once():
    points = points_of(body("C7", "MANUBRIUM"))
    assert points.missing["C7T1"].endswith(" C7, MANUBRIUM")
    points = points_of(body("C7", "T8", "T12"))
    assert points.missing["T12L1"].endswith(" T12, C7")


def test_haras_hips_need_the_ankles():
    assert points_of(body(), "hara").points["MID_HIP"].inner
    assert not points_of(body("L_ANKLE"), "hara").points["MID_HIP"].inner


# T10 and both PSIS are there; T12 as in the study of the recorded box.
PLUG_IN_GAIT = {
    **ALIASES,
    "SACRUM": {"mean": ["L_PSIS", "R_PSIS"]},
    "T12": {"between": ["T10", "SACRUM"], "share": 0.263},
    "L5": {"between": ["T12", "SACRUM"], "share": 0.65},
    "L_HIP": {"from": "LASI", "offset_m": [0, 0, -0.1]},
    "R_HIP": {"from": "RASI", "offset_m": [0, 0, -0.1]},
    "WHOLE": "CentreOfMass",
    **{name: name for name in ("LFHD", "RFHD", "LBHD", "RBHD")},
    **{
        side + name: side + name
        for side in "LR"
        for name in ("HUP", "HUO", "RAO", "HNO", "FEP", "FEO", "TIO", "TOO")
    },
}


@pytest.mark.parametrize(("trial", "behind", "headless"), [("static", 24.3, 25.7), ("gait", 32.4, 33.4)])
def test_head_markers_reduce_the_distance_from_plug_in_gait(shared, trial, behind, headless):
    markers = {"unit": "m", "aliases": PLUG_IN_GAIT, "required": [], "check_axes": False}
    layout, file = lumbar.MarkerLayout(**markers), shared / "real/lifting/ktk_pig_com_oracle" / f"{trial}.c3d"
    recording = lumbar.read(file, layout=layout)
    for seen, expected in ((recording, behind), (hide_markers(recording, "HEAD_CENTRE"), headless)):
        lift = lumbar.lift(seen, ANN, 0.0, settings=LIFTING)
        centre = lift.body[[f"WHOLE_BODY_{axis}_m" for axis in "xyz"]].to_numpy()
        offset, forward = (
            centre - lift.analysed.recording["WHOLE"],
            np.cross([0, 0, 1], lift.analysed.points.right),
        )
        assert -1e3 * np.nanmean(np.sum(offset * forward, axis=1)) == pytest.approx(expected, abs=0.1)


def test_t12_on_a_static_trial_with_the_whole_spine(shared):
    """The estimate of T12/L1 lies 70-76 mm ahead of the real marker on T12, and at its height within 10 mm."""
    aliases = {**ALIASES, "SACRUM": {"mean": ["L_PSIS", "R_PSIS"]}, "MANUBRIUM": "STRN", "XIPHOID": "XIPH"}
    layout = lumbar.MarkerLayout(aliases=aliases, required=[], check_axes=False)
    file = shared / "real" / "lifting" / "athlete_static_full_spine" / "c3dfile1.c3d"
    recording = lumbar.read(file, layout=layout)
    points = points_of(recording, sex="female")
    forward = np.cross([0, 0, 1], points.right)
    offset = 1e3 * (points["T12L1"] - recording["T12"])
    assert 68 < np.mean(np.sum(offset * forward, axis=1)) < 78
    assert abs(np.mean(offset[:, 2])) < 10
    # The spine's centres rise without a step, and all lie between skin and front of the body.
    heights = [np.mean(points[name][:, 2]) for name in ("MID_HIP", "L5S1", "L4L5", "T12L1", "C7T1")]
    assert np.all(np.diff(heights) > 0.02)
    depth = np.sum((recording["MANUBRIUM"] - recording["C7"]) * forward, axis=1).mean()
    for name in ("C7T1", "T12L1", "L4L5"):
        skin = recording[SPINE[name]] if name != "L4L5" else recording["SACRUM"]
        assert 0 < np.mean(np.sum((points[name] - skin) * forward, axis=1)) < depth
