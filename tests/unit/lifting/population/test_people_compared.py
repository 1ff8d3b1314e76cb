"""Tables of many people's measures: who is safer, what is missing, how many people it takes."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import lumbar
from lumbar.base.errors import InputError
from lumbar.settings.population import PopulationSettings


@pytest.fixture(scope="module")
def table():
    """Two measures of 5 experts and 4 novices with two boxes, two trials each: one differs, one does not."""
    rng, rows = np.random.default_rng(1), []
    for group, count, margin in (("expert", 5, 40.0), ("novice", 4, 20.0)):
        for person in range(count):
            own = rng.normal(margin, 4)
            for mass in (15, 23):
                for _ in range(2):
                    key = (f"{group}_{person}", group, mass)
                    rows.append((*key, "margin", own - (mass - 15) / 2 + rng.normal(0, 2), "mm", "higher"))
                    rows.append((*key, "moment", 300 - own + rng.normal(0, 2), "N·m", "lower"))
                    rows.append((*key, "sway", rng.normal(10, 3), "mm", "lower"))
    columns = ["person", "group", "box_mass_kg", "measure", "value", "unit", "safer"]
    frame = pd.DataFrame(rows, columns=columns).assign(plane="all")
    frame.loc[frame.index[0], "value"] = np.nan
    return frame


@pytest.fixture(scope="module")
def compared(table):
    return lumbar.compare_groups(table)


def test_the_safer_side_follows_from_the_measure(compared):
    frame = compared.table.frame.set_index(["comparison", "box_mass_kg", "measure"]).sort_index()
    for box in ("15", "23"):
        assert (frame.loc[("expert_vs_novice", box), "safer"] == ["expert", "expert", "not decided"]).all()
        assert frame.loc[("expert_vs_novice", box, "moment"), "difference"] < 0
    assert frame.loc[("decrease_in_mass_expert", "15 vs 23", "margin"), "safer"] == "15 kg"
    assert frame.loc[("decrease_in_mass_expert", "15 vs 23", "margin"), "df"] == 4
    first = frame.loc[("expert_vs_novice", "15", "margin")]
    assert first["persons"] == "5 + 4" and first["trials"] == "9 + 8"
    assert "1 trials without a value" in first["remark"]
    assert (frame["p_holm"] >= frame["p"]).all()


def test_planning_says_how_many_persons(table, compared):
    frame = compared.planning.frame
    margin = frame[(frame["measure"] == "margin") & (frame["comparison"] == "expert_vs_novice")].iloc[0]
    scatter = {"person_sd": margin["person_sd"], "trial_sd": margin["trial_sd"]}
    for trials in (1, 3, 5):
        name = f"persons_with_{trials}_trial{'s' * (trials > 1)}"
        assert margin[name] == lumbar.sample_size(margin["sought"], trials=trials, **scatter)
    wanted = PopulationSettings(detect={"margin": 3.0})
    assert lumbar.compare_groups(table, settings=wanted).planning.frame["sought"].iloc[0] == 3.0
    with pytest.raises(InputError, match="no measure gait; measures: margin, moment, sway"):
        _ = lumbar.compare_groups(table, settings=PopulationSettings(detect={"gait": 1.0})).planning


def test_picture_has_the_safer_group_on_its_side(compared):
    axes = compared.figure().axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["margin", "moment", "sway"]
    effects = [line.get_xdata()[0] for line in axes.lines if len(line.get_xdata()) == 1]
    assert (
        len(effects) == 6 and min(effects[:4]) > 0
    )  # the expert is safer in margin and moment, with either box


def test_too_few_people_are_named_and_not_tested(table):
    few = lumbar.compare_groups(table[table["person"].isin(["expert_0", "expert_1", "novice_0"])])
    between = few.table.frame[few.table.frame["comparison"] == "expert_vs_novice"]
    assert between["p"].isna().all() and (between["safer"] == "cannot be told").all()
    assert "2 persons (expert), 1 person (novice), at least 3" in between["remark"].iloc[0]
    assert "Nothing can be compared" in few.figure().get_suptitle()


def test_wrong_tables_are_refused(table, tmp_path):
    with pytest.raises(InputError, match="no columns person"):
        lumbar.compare_groups(table.drop(columns="person"))
    with pytest.raises(InputError, match="nobody is labelled 'trained'"):
        lumbar.compare_groups(table, groups=("trained", "novice"))
    with pytest.raises(InputError, match="expert_0: a person of 2 groups"):
        lumbar.compare_groups(pd.concat([table, table.head(1).assign(group="novice")]))
    (tmp_path / "broken.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"broken\.csv: not a table"):
        lumbar.compare_groups(tmp_path / "broken.csv")
    with pytest.raises(InputError, match="trials 0"):
        lumbar.sample_size(1.0, person_sd=1.0, trials=0)
