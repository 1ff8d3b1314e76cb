"""Groups and boxes compared: Welch's and the paired interval in closed form and by scipy, verdicts, tables by hand."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import lumbar
from refusing import has_tokens


def compare(*sides):
    """Compare values by person: sides of experts and novices, or of the same people with 15 and 23 kg."""
    rows = [
        (f"{group}_{person}", group, box, "margin", "all", value)
        for group, box, values in (*sides, ("novice", 99, [0.0]))
        for person, value in enumerate(values)
    ]
    columns = ["person", "group", "box_mass_kg", "measure", "plane", "value"]
    comparison, *_ = lumbar.compare_groups(pd.DataFrame(rows, columns=columns)).comparisons
    return comparison.difference


def test_groups_are_compared_by_welchs_test():
    rng = np.random.default_rng(1)
    first, second = rng.normal(3.0, 1.0, 6), rng.normal(2.0, 3.0, 9)
    actual = compare(("expert", 23, first), ("novice", 23, second))
    parts = first.var(ddof=1) / 6, second.var(ddof=1) / 9
    freedom = sum(parts) ** 2 / (parts[0] ** 2 / 5 + parts[1] ** 2 / 8)
    half_width = stats.t.ppf(0.975, freedom) * np.sqrt(sum(parts))
    difference = first.mean() - second.mean()
    assert (actual.first, actual.second) == pytest.approx((first.mean(), second.mean()))
    assert (actual.low, actual.high) == pytest.approx((difference - half_width, difference + half_width))
    assert actual.freedom == pytest.approx(freedom) and actual.persons == (6, 9)
    expected = stats.ttest_ind(first, second, equal_var=False)
    assert actual.p_value == pytest.approx(expected.pvalue) and actual.freedom == pytest.approx(expected.df)
    assert (actual.low, actual.high) == pytest.approx(tuple(expected.confidence_interval()))
    pooled = np.sqrt((5 * first.var(ddof=1) + 8 * second.var(ddof=1)) / 13)
    assert actual.person_sd == pytest.approx(pooled)
    assert actual.percent == pytest.approx(100 * difference / second.mean())


def test_boxes_are_compared_within_the_persons_who_lifted_both():
    heavy, light = [3.0, 5.0, 4.0, 8.0, 99.0], [4.0, 5.5, 6.0, 9.0]
    actual = compare(("expert", 15, light), ("expert", 23, heavy))
    changes = np.array([1.0, 0.5, 2.0, 1.0])
    half_width = stats.t.ppf(0.975, 3) * changes.std(ddof=1) / 2
    assert actual.difference == pytest.approx(changes.mean()) and actual.persons == (4, 4)
    assert (actual.low, actual.high) == pytest.approx(
        (changes.mean() - half_width, changes.mean() + half_width)
    )
    assert actual.freedom == 3 and actual.person_sd == pytest.approx(changes.std(ddof=1))
    assert actual.p_value == pytest.approx(stats.ttest_rel(light, heavy[:4]).pvalue)


def test_few_persons_or_equal_values_give_no_interval():
    actual = compare(("expert", 23, [1.0, 2.0]), ("novice", 23, range(5)))
    assert actual.p_value is None and actual.low is None and actual.difference == pytest.approx(-0.5)
    assert has_tokens(actual.remark, "2…(expert)…3")
    paired = compare(("expert", 15, [1.0, 2.0]), ("expert", 23, range(5)))
    assert has_tokens(paired.remark, "2…(15 kg)…3")
    constant = compare(("expert", 23, [1.0] * 4), ("novice", 23, [2.0] * 4))
    assert constant.remark and constant.low is None and constant.p_value is None
    assert compare(("expert", 23, range(5)), ("novice", 23, [-1.0, -2.0, 0.0])).percent is None


@pytest.fixture(scope="module")
def table():
    """Three measures of 5 experts and 4 novices with two boxes, two trials each: two differ, one does not."""
    rng, rows = np.random.default_rng(1), []
    for group, count, margin in (("expert", 5, 40.0), ("novice", 4, 20.0)):
        for person in range(count):
            individual = rng.normal(margin, 4)
            for mass in (15, 23):
                for _ in range(2):
                    key = (f"{group}_{person}", group, mass)
                    rows.append(
                        (*key, "margin", individual - (mass - 15) / 2 + rng.normal(0, 2), "mm", "higher")
                    )
                    rows.append((*key, "moment", 300 - individual + rng.normal(0, 2), "N·m", "lower"))
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


def test_p_values_are_adjusted_after_holm_by_comparison_and_box(compared):
    for _, family in compared.table.frame.groupby(["comparison", "box_mass_kg"]):
        ranked = family.sort_values("p")
        steps = np.maximum.accumulate(ranked["p"].to_numpy() * [3, 2, 1])
        assert ranked["p_holm"].to_numpy() == pytest.approx(np.minimum(steps, 1.0))


def test_repeated_trials_change_no_interval(table, compared):
    """Every trial counted twice changes no interval: a person is one value."""
    twice = lumbar.compare_groups(pd.concat([table, table])).table.frame
    columns = ["low", "high", "df", "p"]
    np.testing.assert_allclose(twice[columns], compared.table.frame[columns], rtol=1e-9)


def test_picture_has_the_safer_group_on_its_side(compared):
    axes = compared.figure().axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["Margin", "Moment", "Sway"]
    effects = [line.get_xdata()[0] for line in axes.lines if len(line.get_xdata()) == 1]
    # The expert is safer in margin and moment, with either box.
    assert len(effects) == 6 and min(effects[:4]) > 0


def test_too_few_people_are_reported_and_not_tested(table):
    few = lumbar.compare_groups(table[table["person"].isin(["expert_0", "expert_1", "novice_0"])])
    between = few.table.frame[few.table.frame["comparison"] == "expert_vs_novice"]
    assert between["p"].isna().all() and (between["safer"] == "no interval").all()
    assert has_tokens(between["remark"].iloc[0], "2…(expert)…1…(novice)…3")
    assert has_tokens(few.figure().get_suptitle(), "(expert)…3")
    assert has_tokens(str(few), "(expert)…3")


def test_wrong_tables_are_rejected(table, tmp_path):
    with pytest.raises(lumbar.InputError, match=r"\bperson; .*person, group, box_mass_kg"):
        lumbar.compare_groups(table.drop(columns="person"))
    with pytest.raises(lumbar.InputError, match=r"groups: .*'trained'.*expert, novice"):
        lumbar.compare_groups(table, groups=("trained", "novice"))
    with pytest.raises(lumbar.InputError, match=r"expert_0: .*\b2\b"):
        lumbar.compare_groups(pd.concat([table, table.head(1).assign(group="novice")]))
    (tmp_path / "broken.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(lumbar.InputError, match=r"broken\.csv: .*0xff"):
        lumbar.compare_groups(tmp_path / "broken.csv")
