"""Joint centres, segment tables and centres of mass: by hand, by Plug-in Gait and another implementation, in recordings."""

from dataclasses import replace

import numpy as np
import pytest
from lifting_cases import without
from scipy.spatial.transform import Rotation

from lumbar.base.errors import InputError
from lumbar.lifting.movement.centre_of_mass import (
    COMS,
    DE_LEVA,
    DUMAS,
    WINTER,
    absent_segments,
    centres_of_mass,
    segment_centres,
    segment_table,
    whole_body_centre,
)
from lumbar.lifting.movement.events import Event
from lumbar.lifting.movement.joint_centres import SKIN_MARKERS, limb_joints, trunk_points
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.settings.layout import MarkerLayout
from lumbar.settings.lifting import ALIASES


@pytest.mark.parametrize(
    ("table", "segments", "share"),
    [
        (WINTER, COMS[:2], 0.355),  # Winter (2009), Table 4.1
        (WINTER, COMS[1:], 0.281),
        (WINTER, COMS, 0.497),
        (DE_LEVA["male"], COMS, 0.4346),
        (DE_LEVA["female"], COMS, 0.4257),
        (DUMAS["male"], COMS[:2], 0.333),  # Dumas, Cheze and Verriest, J. Biomech. 40 (2007) 543-553, Table 2
        (DUMAS["female"], COMS[:2], 0.304),
    ],
)
def test_segments_add_up_to_the_row_for_several_of_them(table, segments, share):
    mass = {segment.name: segment.mass_share for segment in table.segments}
    assert sum(mass[name] for name in segments) == pytest.approx(share, abs=1e-12)


@pytest.mark.parametrize("table", [WINTER, *DE_LEVA.values(), *DUMAS.values()])
def test_segments_form_a_chain_from_neck_to_hips(table):
    assert tuple(segment.name for segment in table.segments) == COMS
    assert all(0 < segment.com_share < 1 for segment in table.segments)
    assert (table.ends[0], table.ends[-1]) == ("C7T1", "MID_HIP")
    assert table.source


def test_a_table_that_differs_between_the_sexes_needs_the_sex():
    with pytest.raises(InputError, match=r"subject\.sex is 'unknown'"):
        segment_table("de_leva", "unknown")


@pytest.mark.parametrize(
    ("sex", "lengths_mm", "trunk", "tolerance"),
    # Lengths C7-xiphion, xiphion-omphalion, omphalion-mid-hip, and the centre of the whole trunk from C7
    # (de Leva 1996, Table 4). The published male trunk lies half a percent off its own parts.
    [("female", (228.0, 205.3, 181.5), 0.4964, 5e-4), ("male", (242.1, 215.5, 145.7), 0.5138, 6e-3)],
)
def test_de_levas_parts_make_his_trunk(sex, lengths_mm, trunk, tolerance):
    segments = DE_LEVA[sex].segments
    tops = [sum(lengths_mm[:index]) for index in range(3)]
    centres = [
        top + segment.com_share * length
        for top, segment, length in zip(tops, segments, lengths_mm, strict=True)
    ]
    mass = [segment.mass_share for segment in segments]
    whole = sum(share * centre for share, centre in zip(mass, centres, strict=True)) / sum(mass)
    assert whole / sum(lengths_mm) == pytest.approx(trunk, abs=tolerance)


TIME = np.arange(0, 2, 0.01)
EVENTS = {"lift_off": Event(0.5, "declared", ""), "release": Event(1.5, "declared", "")}


def recording(**points):
    positions = {
        name: np.tile(np.asarray(point, dtype=float), (len(TIME), 1)) for name, point in points.items()
    }
    return MarkerRecording("hand", TIME, 100.0, positions, source="hand.c3d")


def on_skin(body):
    return trunk_points(body, "skin", "harrington", "male")


@pytest.fixture
def standing():
    return recording(
        C7=(0, 0, 1.5),
        T12=(0, -0.1, 1.2),
        L5=(0, -0.1, 1.0),
        XIPHOID=(0, 0.1, 1.25),
        L_HIP=(-0.15, 0, 0.9),
        R_HIP=(0.15, 0, 0.9),
        BOX_1=(-0.2, 0.4, 1.0),
        BOX_2=(0.2, 0.4, 1.0),
    )


def test_positions_by_hand(standing):
    centres = segment_centres(on_skin(standing), WINTER)
    assert centres["thorax"][0] == pytest.approx([0, -0.082, 1.5 - 0.82 * 0.3])
    assert centres["abdomen"][0] == pytest.approx([0, -0.1, 1.2 - 0.44 * 0.2])
    assert centres["pelvis"][0] == pytest.approx([0, -0.1 + 0.105 * 0.1, 1.0 - 0.105 * 0.1])


def test_trunk_and_box_keep_their_mass_and_their_common_centre(standing):
    centres = centres_of_mass(standing, on_skin(standing), WINTER, (80.0, 23.0), "by_mass", EVENTS)
    total = sum(centre.mass_with_box_kg for centre in centres.values())
    assert total == pytest.approx(0.497 * 80 + 23)
    held = 100
    with_box = (
        sum(centre.mass_with_box_kg * centre.position_with_box[held] for centre in centres.values()) / total
    )
    parts = sum(centre.mass_kg * centre.position[held] for centre in centres.values())
    assert with_box == pytest.approx((parts + 23 * np.array([0, 0.4, 1.0])) / total)


def test_the_box_counts_only_between_lift_off_and_release(standing):
    for centre in centres_of_mass(
        standing, on_skin(standing), WINTER, (80.0, 23.0), "whole", EVENTS
    ).values():
        moved = np.linalg.norm(centre.position_with_box - centre.position, axis=1) > 1e-9
        assert np.array_equal(moved, (TIME >= 0.5) & (TIME <= 1.5))
        assert centre.mass_with_box_kg == pytest.approx(centre.mass_kg + 23)


def test_segments_without_landmarks_are_left_out_by_name():
    part = recording(C7=(0, 0, 1.5), L5=(0, 0, 1), T12=(0, 0, 1.2))
    assert set(segment_centres(on_skin(part), WINTER)) == {"thorax", "abdomen"}
    absent = absent_segments(on_skin(part), WINTER)
    assert list(absent) == ["pelvis"]
    assert "no MID_HIP (no marker L_HIP, R_HIP)" in absent["pelvis"]


def test_the_hands_stand_for_a_box_without_markers(standing):
    positions, hands = without(standing, "BOX").positions, standing["BOX_1"] + np.array([0.0, 0.1, 0.0])
    held = MarkerRecording("x", TIME, 100.0, {**positions, "L_WRIST": hands, "R_WRIST": hands})
    box = MarkerRecording("x", TIME, 100.0, {**positions, "BOX_1": hands})
    arguments = (on_skin(held), WINTER, (80.0, 23.0), "by_mass", EVENTS)
    for by_hands, by_box in zip(
        centres_of_mass(held, *arguments).values(), centres_of_mass(box, *arguments).values(), strict=True
    ):
        assert np.array_equal(by_hands.position_with_box, by_box.position_with_box)


def test_without_box_and_hands_it_is_not_known_where_they_are(standing):
    bare = without(standing, "BOX")
    for centre in centres_of_mass(bare, on_skin(bare), WINTER, (80.0, 23.0), "by_mass", EVENTS).values():
        held = (TIME >= 0.5) & (TIME <= 1.5)
        assert np.array_equal(np.isnan(centre.position_with_box[:, 0]), held)
        assert np.isfinite(centre.position).all()


POSE = Rotation.from_euler("zxy", [35, 50, -12], degrees=True)
SHIFT = np.array([1.2, -0.4, 0.9])
FRAMES = 5


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
    return MarkerRecording("hand", np.arange(FRAMES) / 100, 100.0, positions, source="hand.c3d")


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
    points = trunk_points(pelvis(240, 150, **ankles), "inner", hips, sex)
    assert unposed(points.hips["R_HIP"]) == pytest.approx(expected)
    assert unposed(points["MID_HIP"]) == pytest.approx((0, *expected[1:]))


def test_unknown_sex_lies_between_the_sexes():
    between = [
        unposed(trunk_points(pelvis(240, 150), "inner", "reed", sex)["L5S1"])
        for sex in ("female", "unknown", "male")
    ]
    assert between[1] == pytest.approx((between[0] + between[2]) / 2)
    assert between[2] == pytest.approx([0, -80.4, -7.68])


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
    points = trunk_points(body(**markers), "inner", "harrington", sex)
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
def test_dumas_pelvis_lies_where_the_other_table_of_the_same_authors_has_it(sex, expected):
    """Dumas et al., J. Biomech. 40 (2007), Table 2 alternative: from the middle of the ASIS, shares of the width."""
    points = trunk_points(pelvis(1000, 600), "inner", "reed", sex)
    top, bottom = points["L5S1"], points["MID_HIP"]
    segment = DUMAS[sex].segments[2]
    line = bottom - top
    ahead = np.cross(-line, points.right)
    centre = unposed(top + segment.com_share * line + segment.forward_share * ahead) / 1000
    assert centre == pytest.approx([0, *expected], abs=1e-3)


def test_all_points_lie_inside_the_body_where_all_markers_are_there():
    points = trunk_points(body(), "inner", "harrington", "male")
    assert not points.list_skin_rules(SKIN_MARKERS)
    assert not points.missing
    skin = trunk_points(body(), "skin", "harrington", "male")
    for name, depth in (("C7T1", 75), ("T12L1", 72), ("L4L5", 85)):
        ahead = unposed(points[name]) - unposed(skin[name])
        assert ahead[1] == pytest.approx(depth, abs=15)
    assert abs(unposed(points["XIPHOID_LEVEL"])[2] - 300) < 10


@pytest.mark.parametrize(
    ("left_out", "on_skin", "said"),
    [
        (("L_ASIS",), {"L4L5", "L5S1", "MID_HIP"}, "no marker L_ASIS"),
        (("MANUBRIUM", "XIPHOID"), {"C7T1", "T12L1"}, "no marker MANUBRIUM"),
        (("L_PSIS", "SACRUM"), {"L4L5", "L5S1", "MID_HIP"}, "no marker L_PSIS"),
    ],
)
def test_what_lies_on_the_skin_is_said_with_how_far_it_may_be_off(left_out, on_skin, said):
    points = trunk_points(body(*left_out), "inner", "harrington", "male")
    assert {name for name, point in points.points.items() if not point.inner} == on_skin
    assert len(points.list_skin_rules(SKIN_MARKERS)) == len(on_skin)
    for name in on_skin:
        point = points.points[name]
        assert said in point.rule
        assert f"about {point.off_mm:g} mm from the joint's centre" in point.rule
        assert point.markers == SKIN_MARKERS[name]


def test_the_sacrum_stands_for_both_psis_and_c7_for_t8_and_it_is_said():
    points = trunk_points(body("R_PSIS", "T8"), "inner", "harrington", "male").points
    assert "SACRUM" in points["MID_HIP"].markers
    assert "C7 in place of T8" in points["T12L1"].rule
    assert points["T12L1"].off_mm > points["C7T1"].off_mm


def test_a_point_without_any_of_its_markers_is_missing_and_names_each_marker_once():
    points = trunk_points(body("C7", "MANUBRIUM"), "inner", "harrington", "male")
    assert points.missing["C7T1"] == "no marker C7, MANUBRIUM"
    assert absent_segments(points, WINTER)["thorax"].startswith("no C7T1 (no marker C7, MANUBRIUM)")
    without_t12 = body("C7", "T8", "T12")
    points = trunk_points(without_t12, "inner", "harrington", "male")
    assert points.missing["T12L1"] == "no marker T12, C7"


def test_haras_hips_need_the_ankles():
    assert trunk_points(body(), "inner", "hara", "male").points["MID_HIP"].inner
    assert not trunk_points(body("L_ANKLE"), "inner", "hara", "male").points["MID_HIP"].inner


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


def plug_in_gait(shared, trial):
    layout = MarkerLayout.model_validate(
        {"unit": "m", "aliases": PLUG_IN_GAIT, "required": [], "check_axes": False}
    )
    return read_markers(shared / "real" / "lifting" / "ktk_pig_com_oracle" / f"{trial}.c3d", layout)


@pytest.mark.parametrize(("trial", "behind", "headless"), [("static", 24.3, 25.7), ("gait", 32.4, 33.4)])
def test_markers_of_the_head_bring_the_whole_body_s_centre_nearer_to_plug_in_gait_s(
    shared, trial, behind, headless
):
    recording = plug_in_gait(shared, trial)
    points = trunk_points(recording, "inner", "harrington", "male")
    forward = np.cross([0, 0, 1], points.right)
    for seen, expected in ((recording, behind), (without(recording, "HEAD_CENTRE"), headless)):
        offset = whole_body_centre(seen, points, WINTER) - recording["WHOLE"]
        assert -1e3 * np.nanmean(np.sum(offset * forward, axis=1)) == pytest.approx(expected, abs=0.1)


def test_a_joint_lies_between_its_markers_unless_the_inner_one_is_hidden_or_an_alias_has_both():
    pair = recording(L_KNEE=(0.3, 0, 0.5), L_KNEE_MEDIAL=(0.2, 0, 0.5), L_ANKLE=(0.25, 0, 0.1))
    assert limb_joints(pair)["L_KNEE"][0] == pytest.approx([0.25, 0, 0.5])
    assert limb_joints(pair)["L_ANKLE"] is pair["L_ANKLE"]
    assert limb_joints(replace(pair, derived={"L_KNEE": "mean of two"}))["L_KNEE"] is pair["L_KNEE"]
    pair["L_KNEE_MEDIAL"][7] = np.nan
    assert limb_joints(pair)["L_KNEE"] is pair["L_KNEE"]


def test_t12_on_a_static_trial_with_the_whole_spine(shared):
    """The estimate of T12/L1 lies 70-76 mm ahead of the real marker on T12, and at its height within 10 mm."""
    aliases = {**ALIASES, "SACRUM": {"mean": ["L_PSIS", "R_PSIS"]}, "MANUBRIUM": "STRN", "XIPHOID": "XIPH"}
    layout = MarkerLayout.model_validate({"aliases": aliases, "required": [], "check_axes": False})
    recording = read_markers(
        shared / "real" / "lifting" / "athlete_static_full_spine" / "c3dfile1.c3d", layout
    )
    points = trunk_points(recording, "inner", "harrington", "female")
    forward = np.cross([0, 0, 1], points.right)
    offset = 1e3 * (points["T12L1"] - recording["T12"])
    assert 68 < np.mean(np.sum(offset * forward, axis=1)) < 78
    assert abs(np.mean(offset[:, 2])) < 10
    # The spine's centres rise without a step, and all lie between skin and front of the body.
    heights = [np.mean(points[name][:, 2]) for name in ("MID_HIP", "L5S1", "L4L5", "T12L1", "C7T1")]
    assert np.all(np.diff(heights) > 0.02)
    depth = np.sum((recording["MANUBRIUM"] - recording["C7"]) * forward, axis=1).mean()
    for name in ("C7T1", "T12L1", "L4L5"):
        skin = recording[SKIN_MARKERS[name][0]] if name != "L4L5" else recording["SACRUM"]
        assert 0 < np.mean(np.sum((points[name] - skin) * forward, axis=1)) < depth
