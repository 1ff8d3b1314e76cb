"""Segment tables, and centres of mass against hand calculation, conservation of mass and Plug-in Gait's whole-body centre."""

import numpy as np
import pytest
from lifting_cases import without

from lumbar.base.errors import InputError
from lumbar.lifting.movement.centre_of_mass import (
    COMS,
    DUMAS,
    WINTER,
    absent_segments,
    all_tables,
    box_shares,
    centres_of_mass,
    segment_centres,
    segment_table,
)
from lumbar.lifting.movement.events import Event
from lumbar.lifting.movement.joint_centres import trunk_points
from lumbar.records.markers import MarkerRecording

DE_LEVA = {sex: segment_table("de_leva", sex) for sex in ("female", "male")}


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
    for upper, lower in zip(table.segments[:-1], table.segments[1:], strict=True):
        assert upper.distal == lower.proximal
    assert all(0 < segment.com_share < 1 for segment in table.segments)
    assert (table.ends[0], table.ends[-1]) == ("C7T1", "MID_HIP")
    assert table.source


def test_all_tables_are_those_of_the_sex_and_of_both_where_it_is_not_known():
    assert all_tables("male") == (WINTER, DE_LEVA["male"], DUMAS["male"])
    assert len(all_tables("unknown")) == 5


@pytest.mark.parametrize(
    ("name", "sex", "words"),
    [
        ("dempster", "male", "allowed: winter, de_leva, dumas"),
        ("de_leva", "unknown", "subject.sex is 'unknown'"),
    ],
)
def test_what_does_not_exist_is_refused(name, sex, words):
    with pytest.raises(InputError, match=words):
        segment_table(name, sex)


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
    centres = centres_of_mass(standing, on_skin(standing), WINTER, 80.0, 23.0, "by_mass", EVENTS)
    total = sum(centre.mass_with_box_kg for centre in centres.values())
    assert total == pytest.approx(0.497 * 80 + 23)
    held = 100
    with_box = (
        sum(centre.mass_with_box_kg * centre.position_with_box[held] for centre in centres.values()) / total
    )
    parts = sum(centre.mass_kg * centre.position[held] for centre in centres.values())
    assert with_box == pytest.approx((parts + 23 * np.array([0, 0.4, 1.0])) / total)


def test_the_box_counts_only_between_lift_off_and_release(standing):
    for centre in centres_of_mass(standing, on_skin(standing), WINTER, 80.0, 23.0, "whole", EVENTS).values():
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
    arguments = (on_skin(held), WINTER, 80.0, 23.0, "by_mass", EVENTS)
    for by_hands, by_box in zip(
        centres_of_mass(held, *arguments).values(), centres_of_mass(box, *arguments).values(), strict=True
    ):
        assert np.array_equal(by_hands.position_with_box, by_box.position_with_box)


def test_without_box_and_hands_it_is_not_known_where_they_are(standing):
    bare = without(standing, "BOX")
    for centre in centres_of_mass(bare, on_skin(bare), WINTER, 80.0, 23.0, "by_mass", EVENTS).values():
        held = (TIME >= 0.5) & (TIME <= 1.5)
        assert np.array_equal(np.isnan(centre.position_with_box[:, 0]), held)
        assert np.isfinite(centre.position).all()


def test_an_unknown_share_is_refused():
    with pytest.raises(InputError, match=r"lifting\.box\.share is 'half'"):
        box_shares(WINTER, 15.0, "half")
