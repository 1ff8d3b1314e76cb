"""Statistics of people against published fits, closed forms, other implementations and simulated groups."""

import numpy as np
import pandas as pd
import pytest
from scipy import optimize, stats
from statsmodels.stats.power import TTestIndPower, TTestPower

import lumbar
from lumbar.base.errors import InputError
from lumbar.lifting.population.contrast import (
    between_groups,
    percent_interval,
    within_persons,
)
from lumbar.lifting.population.sample_size import assured_sd, detectable_difference, persons_needed, power
from lumbar.lifting.population.variance_components import PersonMeans, change_components, variance_components
from lumbar.settings.population import PopulationSettings
from simulated_people import UNEQUAL, draw_group, draw_pair


def people(rows, name="p") -> PersonMeans:
    """Persons from their trials."""
    return PersonMeans.of({f"{name}{number}": row for number, row in enumerate(rows)})


def test_published_mixed_model():
    """nlme prints for Orthodont, distance ~ age + Sex with a random intercept, SexFemale −2.3210, 0.7614, 25 df, p 0.0054.

    Pinheiro & Bates, Mixed-Effects Models in S and S-PLUS, 2000, and the help page of lme; age is balanced.
    """
    girls, boys = people(GIRLS), people(BOYS)
    ratio = variance_components([girls, boys]).variance_ratio
    found = between_groups(girls, boys, ratio, equal_variances=True)
    assert found.difference == pytest.approx(-2.321023, abs=5e-7)
    assert found.standard_error == pytest.approx(0.7614168, abs=5e-8)
    assert found.freedom == 25 and found.p_value == pytest.approx(0.0054, abs=5e-5)


def test_balanced_groups_are_compared_by_t_tests_on_person_means():
    rng = np.random.default_rng(1)
    first, second, third = (draw_group(rng, count, 4, 0.5, 3.0) for count in (6, 6, 9))
    for other, equal in ((second, True), (third, False)):
        expected = stats.ttest_ind(first.mean, other.mean, equal_var=equal)
        interval = expected.confidence_interval()
        for ratio in (None, 0.1, 20.0):
            found = between_groups(first, other, ratio)
            assert found.p_value == pytest.approx(expected.pvalue)
            assert (found.interval.low, found.interval.high) == pytest.approx(interval)
            assert found.freedom == pytest.approx(expected.df)
    paired = within_persons(first, second)
    assert paired.p_value == pytest.approx(stats.ttest_rel(first.mean, second.mean).pvalue)


def restricted_likelihood(groups, person_variance, trial_variance) -> float:
    """−2 log of the restricted likelihood, written out with the whole covariance matrix (Searle et al., 1992, § 6.6)."""
    values = np.concatenate([trials for group in groups for trials in group.values])
    sizes = [len(trials) for group in groups for trials in group.values]
    owner = np.repeat(np.arange(len(sizes)), sizes)
    design = np.repeat(np.eye(len(groups)), [sum(map(len, group.values)) for group in groups], axis=0)
    covariance = trial_variance * np.eye(len(values)) + person_variance * (owner[:, None] == owner)
    inverse = np.linalg.inv(covariance)
    information = design.T @ inverse @ design
    projection = inverse - inverse @ design @ np.linalg.solve(information, design.T @ inverse)
    determinants = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(information)[1]
    return determinants + values @ projection @ values


def test_variance_components_with_unequal_trials():
    rng = np.random.default_rng(3)
    groups = [draw_group(rng, 6, UNEQUAL, 0.6, scale=5.0), draw_group(rng, 9, UNEQUAL, 0.6, 40.0, scale=5.0)]
    found = variance_components(groups)
    best = optimize.minimize(
        lambda logs: restricted_likelihood(groups, *np.exp(logs)), [2.0, 2.0], method="Nelder-Mead"
    )
    assert (found.person_sd, found.trial_sd) == pytest.approx(np.exp(best.x / 2), rel=1e-3)
    ratio = found.variance_ratio
    assert between_groups(*groups, ratio).difference == pytest.approx(
        np.subtract(*(np.average(group.mean, weights=1 / (1 + ratio / group.trials)) for group in groups))
    )


def test_balanced_variance_components_are_those_of_the_analysis_of_variance():
    rng = np.random.default_rng(4)
    groups = [draw_group(rng, 8, 3, 0.7) for _ in range(2)]
    within = sum(group.squares for group in groups) / 32
    between = (sum(group.mean.var(ddof=1) for group in groups) / 2) - within / 3
    found = variance_components(groups)
    assert (found.person_sd, found.trial_sd) == pytest.approx(np.sqrt([between, within]), rel=1e-4)
    assert found.intraclass_correlation == pytest.approx(between / (between + within), rel=1e-4)


def test_a_singular_fit_is_no_result():
    alike = people([(1, 9), (9, 1.1), (2, 8.2)])
    found = variance_components([alike, people([(3, 7), (7, 3.3), (4, 5.9)])])
    assert found.person_sd is None and found.variance_ratio is None and found.status.startswith("singular")
    assert change_components(alike, alike).status.startswith("singular")
    single = people([(1,), (2,), (4,)])
    assert "one trial of each person" in variance_components([single, single]).status


def test_few_persons_have_no_interval():
    two, five = people([(1, 2), (2, 3)]), people([(number, number + 1.1) for number in range(5)])
    found = between_groups(two, five, names=("expert", "novice"))
    assert found.p_value is None and not found.interval.is_known
    assert found.interval.remark == "no interval: 2 persons (expert), at least 3 are needed"
    assert not percent_interval({"ann": [1.0] * 30}, {"bob": [2.0] * 30}, paired=False).is_known
    assert "nobody" in percent_interval({"ann": [1.0]}, {"bob": [2.0]}, paired=True).remark


def test_percent_interval_ends_where_the_ratio_is_just_rejected():
    """Fieller: at either end θ, mean₁ − θ·mean₂ lies the quantile's number of standard errors from 0."""
    rng = np.random.default_rng(5)
    for found in (
        between_groups(draw_group(rng, 7, 2, 0.5, 12.0), draw_group(rng, 7, 2, 0.5, 10.0)),
        within_persons(*draw_pair(rng, 9, 3, 0.5, (12.0, 10.0))),
    ):
        first, second, both = found.variances
        for end in (found.percent_interval.low, found.percent_interval.high):
            ratio = 1 + end / 100
            error = np.sqrt(first + ratio**2 * second - 2 * ratio * both)
            distance = abs(found.first - ratio * found.second) / error
            assert distance == pytest.approx(stats.t.ppf(0.975, found.freedom))
    near_zero = between_groups(people([[5], [6], [7]]), people([[-1], [0], [2]]))
    assert "second mean may be 0" in near_zero.percent_interval.remark


@pytest.mark.parametrize(("paired", "reference"), [(False, TTestIndPower()), (True, TTestPower())])
def test_power_and_sample_size(paired, reference):
    for effect, persons in ((0.3, 40), (1.0, 8), (2.0, 3)):
        assert power(effect, 1.0, persons, paired=paired) == pytest.approx(
            reference.power(effect, persons, 0.05), abs=1e-8
        )
        needed = persons_needed(3 * effect, 3.0, paired=paired)
        assert needed == max(3, int(np.ceil(reference.solve_power(effect, power=0.8, alpha=0.05))))
        assert power(
            detectable_difference(3.0, persons, paired=paired), 3.0, persons, paired=paired
        ) == pytest.approx(0.8)
    assert persons_needed(1e-4, 1.0, paired=paired) is None
    with pytest.raises(InputError, match="must differ from 0"):
        persons_needed(0.0, 1.0)


@pytest.mark.statistical
@pytest.mark.parametrize("persons", [3, 10])
@pytest.mark.parametrize("trials", [(1, 1), (3, 3), (UNEQUAL, UNEQUAL), (1, 5)])
def test_five_percent_of_equal_groups_differ(persons, trials):
    """The whole table, with estimated ratios of variances, is printed by benchmarks/population.py."""
    rng, rejected = np.random.default_rng(7), 0
    for _ in range(600):
        groups = [draw_group(rng, persons, count, 0.5) for count in trials]
        rejected += between_groups(*groups, variance_ratio=1.0).p_value < 0.05
    assert 0.03 <= rejected / 600 <= 0.07


@pytest.mark.statistical
def test_trials_counted_as_people_raise_false_alarms():
    """What the test above would miss if it could not fail."""
    rng, pooled = np.random.default_rng(8), 0
    for _ in range(200):
        groups = [np.concatenate(draw_group(rng, 6, 4, 0.5).values) for _ in range(2)]
        pooled += stats.ttest_ind(*groups).pvalue < 0.05
    assert pooled > 0.15 * 200


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
        freedom = (
            compared.table.frame.set_index(["measure", "comparison"])
            .loc[("margin", "expert_vs_novice"), "df"]
            .iloc[0]
        )
        assured = lumbar.sample_size(margin["sought"], trials=trials, pilot_df=freedom, **scatter)
        assert margin[f"{name}_assured"] == assured
        assert margin[f"{name}_low"] <= margin[name] <= assured <= margin[f"{name}_high"]
    wanted = PopulationSettings(detect={"margin": 3.0})
    assert lumbar.compare_groups(table, settings=wanted).planning.frame["sought"].iloc[0] == 3.0
    with pytest.raises(InputError, match="no measure gait; measures: margin, moment, sway"):
        _ = lumbar.compare_groups(table, settings=PopulationSettings(detect={"gait": 1.0})).planning


def test_studies_of_the_assured_size_have_the_power_in_the_share_asked_for():
    """Pilots of 10 + 10 persons, a true difference of 1 and scatter of 1: 80 % of the assured, fewer than half of the others."""
    rng, held = np.random.default_rng(3), {"as found": 0, "assured": 0}
    for _ in range(300):
        pilot = rng.normal(size=(2, 10))
        found = np.sqrt(pilot.var(axis=1, ddof=1).mean())
        sizes = persons_needed(1.0, found), persons_needed(1.0, assured_sd(found, 18, 0.8))
        for name, persons in zip(held, sizes, strict=True):
            held[name] += power(1.0, 1.0, persons) >= 0.8
    assert held["as found"] < 0.5 * 300 and 0.74 * 300 <= held["assured"] <= 0.86 * 300
    # Against the quantile written out, and the interval's share of true values.
    assert assured_sd(1.0, 18, 0.8) == pytest.approx(np.sqrt(18 / stats.chi2.ppf(0.2, 18)))


def test_picture_has_the_safer_group_on_its_side(compared):
    axes = compared.figure().axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["Margin", "Moment", "Sway"]
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


GIRLS = (
    *((21, 20, 21.5, 23), (21, 21.5, 24, 25.5), (20.5, 24, 24.5, 26), (23.5, 24.5, 25, 26.5)),
    *((21.5, 23, 22.5, 23.5), (20, 21, 21, 22.5), (21.5, 22.5, 23, 25), (23, 23, 23.5, 24)),
    *((20, 21, 22, 21.5), (16.5, 19, 19, 19.5), (24.5, 25, 28, 28)),
)
BOYS = (
    *((26, 25, 29, 31), (21.5, 22.5, 23, 26.5), (23, 22.5, 24, 27.5), (25.5, 27.5, 26.5, 27)),
    *((20, 23.5, 22.5, 26), (24.5, 25.5, 27, 28.5), (22, 22, 24.5, 26.5), (24, 21.5, 24.5, 25.5)),
    *((23, 20.5, 31, 26), (27.5, 28, 31, 31.5), (23, 23, 23.5, 25), (21.5, 23.5, 24, 28)),
    *((17, 24.5, 26, 29.5), (22.5, 25.5, 25.5, 26), (23, 24.5, 26, 30), (22, 21.5, 23.5, 25)),
)
