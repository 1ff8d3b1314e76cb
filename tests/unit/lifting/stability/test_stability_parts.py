"""What differences of Table 4.1 come from: contributions of additive and of single parts by hand, sums against the table."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from stability_cases import lift
from test_stability_table import INVERTED, OWN, lift_states, study_of

from lumbar.lifting.stability.changed_pendulums import (
    EXCHANGED,
    PARTS,
    contributions,
    decomposition_table,
    exchanged,
)


def table(lifts, project):
    published = pd.read_csv(project / "resources" / "thesis" / "table_4_1.csv")
    study = study_of(lifts, INVERTED, published)
    actual, failures = decomposition_table(study)
    assert not failures
    return study, actual.frame


def printed(study, frame):
    """The differences of Table 4.1 by row of `frame`."""
    actual = study.percent_differences(study.areas("exact", OWN))
    cells = pd.DataFrame(actual).set_index(["comparison", "com"])
    return [cells.loc[(row.comparison, row.com), row.plane] for row in frame.itertuples()]


def test_contributions_of_sums_and_of_products():
    individual = dict(zip(PARTS, (1.0, 2.0, -0.5, 0.0, 4.0), strict=True))
    summed = np.array([10 + sum(individual[part] for part in taken) for taken in EXCHANGED])
    assert contributions(summed) == pytest.approx([10, 20, -5, 0, 40])
    product = np.array([2.0 ** len({"length", "mass"} & taken) for taken in EXCHANGED])
    assert contributions(product) == pytest.approx([0, 150, 150, 0, 0])


def test_exchange_of_no_or_all_parts_gives_the_two_pendulums():
    before, after = lift(subject="novice", duration=1.9)[3], lift(box=15.0)[3]
    after = replace(after, angle=after.angle + 0.05)
    for taken, whole in ((EXCHANGED[0], before), (EXCHANGED[-1], after)):
        actual = exchanged(before, after, taken)
        assert (actual.duration, actual.mass_kg, actual.length_m) == pytest.approx(
            (whole.duration, whole.mass_kg, whole.length_m)
        )
        for name in ("angle", "angular_velocity", "angular_acceleration"):
            np.testing.assert_allclose(getattr(actual, name), getattr(whole, name), atol=1e-12)
    slower = exchanged(before, after, frozenset({"course"}))
    assert slower.duration == pytest.approx(before.duration)
    assert np.gradient(slower.angle, slower.time)[50] == pytest.approx(slower.angular_velocity[50], rel=0.01)


def test_the_five_add_up_to_the_table_and_a_box_acts_by_its_mass(project):
    study, frame = table([lift_states(), lift_states(box=15.0), lift_states("novice", duration=1.9)], project)
    assert np.allclose(frame[[f"{part}_percent" for part in PARTS]].sum(axis=1), frame["percent"])
    assert frame["percent"].tolist() == pytest.approx(printed(study, frame), abs=0.05)
    assert (frame["pairs"] == 1).all() and frame["mass_low_percent"].isna().all()
    boxes = frame[frame["comparison"] == "decrease_in_mass_expert"]
    assert np.allclose(boxes["mass_percent"], boxes["percent"]) and (boxes["percent"].abs() > 1).all()
    people = frame[frame["comparison"] == "expert_vs_novice"]
    assert np.allclose(people["mass_percent"] + people["length_percent"], 0, atol=1e-6)
    assert (people["duration_percent"].abs() > 0.1).all()


@pytest.mark.nightly
def test_unequal_groups_give_an_interval_and_the_table_s_difference(project):
    lifts = []
    for number, label in enumerate(("expert",) * 3 + ("novice",) * 4):
        tables = lift_states(label, duration=1.5 + 0.07 * number, body=17.0 + number % 3)
        lifts.append(replace(tables, facts={**tables.facts, "subject": f"{label}_{number}"}))
    study, frame = table(lifts, project)
    people = frame[frame["comparison"] == "expert_vs_novice"]
    assert people["percent"].tolist() == pytest.approx(printed(study, people), abs=0.05)
    assert (people["duration_low_percent"] < people["duration_percent"]).all()
    assert (people["duration_percent"] < people["duration_high_percent"]).all()
    _, alone = table([*lifts[:2], *lifts[3:]], project)
    assert alone["duration_low_percent"].isna().all() and (alone["pairs"] == 4).all()
