"""Statistics of people against published fits, closed forms, other implementations and simulated groups."""

from __future__ import annotations

import numpy as np
import pytest
from orthodont import BOYS, GIRLS
from scipy import optimize, stats
from statsmodels.stats.power import TTestIndPower, TTestPower

from lumbar.base.errors import InputError
from lumbar.lifting.population.contrast import (
    between_groups,
    cluster_bootstrap,
    percent_interval,
    within_persons,
)
from lumbar.lifting.population.sample_size import detectable_difference, persons_needed, power
from lumbar.lifting.population.variance_components import PersonMeans, change_components, variance_components
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
    assert "bootstrap" in cluster_bootstrap(two.mean, five.mean, 1).remark


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
    """What the test above would miss if it could not fail, and how the cluster bootstrap mends it."""
    rng, pooled, clustered = np.random.default_rng(8), 0, 0
    for number in range(200):
        first, second = (draw_group(rng, 6, 4, 0.5) for _ in range(2))
        pooled += stats.ttest_ind(*map(np.concatenate, (first.values, second.values))).pvalue < 0.05
        interval = cluster_bootstrap(first.mean, second.mean, number, 200)
        clustered += not interval.low <= 0 <= interval.high
    assert pooled > 0.15 * 200 and 0.02 * 200 <= clustered <= 0.08 * 200


@pytest.mark.statistical
def test_power_is_what_simulated_studies_find():
    rng = np.random.default_rng(9)
    persons = persons_needed(1.0, np.sqrt(0.5 + 0.5 / 3))
    found = [
        between_groups(draw_group(rng, persons, 3, 0.5, 1.0), draw_group(rng, persons, 3, 0.5)).p_value < 0.05
        for _ in range(600)
    ]
    assert np.mean(found) == pytest.approx(power(1.0, np.sqrt(0.5 + 0.5 / 3), persons), abs=0.04)
