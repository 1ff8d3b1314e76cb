"""Published segment tables against their own rows; limb joints between their markers."""

from dataclasses import replace

import numpy as np
import pytest
from lifting_cases import recording_of

import lumbar
from lumbar.lifting.movement.centre_of_mass import COMS, DE_LEVA, DUMAS, WINTER, segment_table
from lumbar.lifting.movement.joint_centres import limb_joints


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


def test_table_of_both_sexes_needs_the_sex():
    with pytest.raises(lumbar.InputError, match=r"subject\.sex is 'unknown'"):
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


def test_joint_is_the_middle_of_its_visible_markers():
    places = {"L_KNEE": (0.3, 0, 0.5), "L_KNEE_MEDIAL": (0.2, 0, 0.5), "L_ANKLE": (0.25, 0, 0.1)}
    pair = recording_of({name: np.tile(place, (200, 1)) for name, place in places.items()})
    assert limb_joints(pair)["L_KNEE"][0] == pytest.approx([0.25, 0, 0.5])
    assert limb_joints(pair)["L_ANKLE"] is pair["L_ANKLE"]
    assert limb_joints(replace(pair, derived={"L_KNEE": "mean of two"}))["L_KNEE"] is pair["L_KNEE"]
    pair["L_KNEE_MEDIAL"][7] = np.nan
    assert limb_joints(pair)["L_KNEE"] is pair["L_KNEE"]
