"""Centres of mass against hand calculation, conservation of mass and Plug-in Gait's whole-body centre."""

from __future__ import annotations

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.lifting.movement.centre_of_mass import (
    absent_segments,
    box_shares,
    centres_of_mass,
    segment_centres,
)
from lumbar.lifting.movement.event import Event
from lumbar.lifting.movement.segments import DE_LEVA, WINTER
from lumbar.lifting.movement.trunk_points import trunk_points
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.settings.layout import MarkerLayout
from lumbar.settings.plain import typed

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


def test_de_leva_lies_between_its_own_landmarks(standing):
    centre = segment_centres(on_skin(standing), DE_LEVA["male"])["thorax"][0]
    assert centre == pytest.approx([0, 0.05066, 1.5 - 0.5066 * 0.25])


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


def test_without_a_box_nothing_changes(standing):
    positions = {name: points for name, points in standing.positions.items() if not name.startswith("BOX")}
    bare = MarkerRecording("hand", TIME, 100.0, positions)
    for centre in centres_of_mass(bare, on_skin(bare), WINTER, 80.0, 0.0, "by_mass", EVENTS).values():
        assert centre.mass_with_box_kg == centre.mass_kg
        assert np.array_equal(centre.position_with_box, centre.position)


def test_the_box_is_38_to_58_percent_of_the_trunk():
    assert sum(box_shares(WINTER, 15.0, "by_mass").values()) == pytest.approx(15)
    assert pytest.approx(0.38, abs=0.005) == 15 / (0.497 * 80)
    assert pytest.approx(0.58, abs=0.005) == 23 / (0.497 * 80)


def test_segments_without_landmarks_are_left_out_by_name():
    part = recording(C7=(0, 0, 1.5), L5=(0, 0, 1), T12=(0, 0, 1.2))
    assert set(segment_centres(on_skin(part), WINTER)) == {"thorax", "abdomen"}
    absent = absent_segments(on_skin(part), WINTER)
    assert list(absent) == ["pelvis"]
    assert "no MID_HIP (no marker L_HIP, R_HIP)" in absent["pelvis"]


def test_the_hands_stand_for_a_box_without_markers(standing):
    positions = {name: points for name, points in standing.positions.items() if not name.startswith("BOX")}
    hands = standing["BOX_1"] + np.array([0.0, 0.1, 0.0])
    held = MarkerRecording("x", TIME, 100.0, {**positions, "L_WRIST": hands, "R_WRIST": hands})
    box = MarkerRecording("x", TIME, 100.0, {**positions, "BOX_1": hands})
    arguments = (on_skin(held), WINTER, 80.0, 23.0, "by_mass", EVENTS)
    for by_hands, by_box in zip(
        centres_of_mass(held, *arguments).values(), centres_of_mass(box, *arguments).values(), strict=True
    ):
        assert np.array_equal(by_hands.position_with_box, by_box.position_with_box)


def test_without_box_and_hands_it_is_not_known_where_they_are(standing):
    positions = {name: points for name, points in standing.positions.items() if not name.startswith("BOX")}
    bare = MarkerRecording("x", TIME, 100.0, positions)
    for centre in centres_of_mass(bare, on_skin(bare), WINTER, 80.0, 23.0, "by_mass", EVENTS).values():
        held = (TIME >= 0.5) & (TIME <= 1.5)
        assert np.array_equal(np.isnan(centre.position_with_box[:, 0]), held)
        assert np.isfinite(centre.position).all()


def test_an_unknown_share_is_refused():
    with pytest.raises(InputError, match=r"lifting\.box\.share is 'half'"):
        box_shares(WINTER, 15.0, "half")


def test_the_trunk_moves_with_the_whole_body_centre_of_plug_in_gait(shared):
    """Plug-in Gait's own centre of mass, stored in the file, is an independent computation of the whole
    body's."""
    aliases = {
        "C7": "C7",
        "SACRUM": {"mean": ["LPSI", "RPSI"]},
        "T12": {"between": ["C7", "SACRUM"], "share": 0.71},
        "L5": {"between": ["T12", "SACRUM"], "share": 0.65},
        "L_HIP": {"from": "LASI", "offset_m": [0, 0, -0.1]},
        "R_HIP": {"from": "RASI", "offset_m": [0, 0, -0.1]},
        "WHOLE": "CentreOfMass",
    }
    layout = typed(MarkerLayout, {"unit": "m", "aliases": aliases, "check_axes": False})
    walk = read_markers(shared / "real" / "lifting" / "ktk_pig_com_oracle" / "gait.c3d", layout)
    centres = segment_centres(on_skin(walk), WINTER)
    mass = {segment.name: segment.mass_share for segment in WINTER.segments}
    trunk = sum(mass[name] * centres[name] for name in centres) / sum(mass.values())
    whole = walk["WHOLE"]
    seen = np.isfinite(trunk).all(axis=1) & np.isfinite(whole).all(axis=1)
    assert seen.sum() > 100
    difference = trunk[seen] - whole[seen]
    # The trunk's centre stays above the body's at a distance that hardly changes while the body moves by
    # metres.
    assert 0.05 < difference[:, 2].mean() < 0.35
    assert np.linalg.norm(difference[:, :2], axis=1).max() < 0.25
    assert np.ptp(whole[seen], axis=0).max() > 1.0
    vertical = np.corrcoef(trunk[seen, 2], whole[seen, 2])[0, 1]
    assert vertical > 0.8
