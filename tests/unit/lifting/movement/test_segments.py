"""The tables of trunk segments against other rows of the same publications."""

from __future__ import annotations

import pytest

from lumbar.base.errors import InputError
from lumbar.lifting.movement.segments import COMS, DE_LEVA, DUMAS, WINTER, all_tables, segment_table


def shares(table):
    return {segment.name: segment.mass_share for segment in table.segments}


def test_winter_agrees_with_the_rows_for_combined_segments():
    # Winter (2009), Table 4.1: thorax and abdomen 0.355, abdomen and pelvis 0.281, trunk 0.497.
    mass = shares(WINTER)
    assert mass["thorax"] + mass["abdomen"] == pytest.approx(0.355, abs=1e-12)
    assert mass["abdomen"] + mass["pelvis"] == pytest.approx(0.281, abs=1e-12)
    assert sum(mass.values()) == pytest.approx(0.497, abs=1e-12)


@pytest.mark.parametrize(("sex", "trunk"), [("male", 0.4346), ("female", 0.4257)])
def test_de_leva_agrees_with_the_row_for_the_trunk(sex, trunk):
    assert sum(shares(DE_LEVA[sex]).values()) == pytest.approx(trunk, abs=1e-12)


@pytest.mark.parametrize("table", [WINTER, *DE_LEVA.values(), *DUMAS.values()])
def test_segments_form_a_chain_from_neck_to_hips(table):
    assert tuple(segment.name for segment in table.segments) == COMS
    for upper, lower in zip(table.segments[:-1], table.segments[1:], strict=True):
        assert upper.distal == lower.proximal
    assert all(0 < segment.com_share < 1 for segment in table.segments)
    assert (table.ends[0], table.ends[-1]) == ("C7T1", "MID_HIP")
    assert table.source


def test_the_table_is_picked_by_name_and_sex():
    assert segment_table("winter", "unknown") is WINTER
    assert segment_table("de_leva", "female") is DE_LEVA["female"]
    assert segment_table("dumas", "male") is DUMAS["male"]


def test_all_tables_are_those_of_the_sex_and_of_both_where_it_is_not_known():
    assert all_tables("male") == (WINTER, DE_LEVA["male"], DUMAS["male"])
    assert len(all_tables("unknown")) == 5


@pytest.mark.parametrize(("sex", "torso"), [("male", 0.333), ("female", 0.304)])
def test_dumas_thorax_and_abdomen_are_the_torso_of_the_earlier_table(sex, torso):
    # Dumas, Cheze and Verriest, J. Biomech. 40 (2007) 543-553, Table 2.
    mass = shares(DUMAS[sex])
    assert mass["thorax"] + mass["abdomen"] == pytest.approx(torso, abs=1e-12)


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
