"""Areas, thresholds and intervals of the ROC against independent formulas."""

import numpy as np
import pytest
from scipy.stats import mannwhitneyu, norm, sem, t

from lumbar.lifting.pushes import roc
from lumbar.lifting.pushes.roc import (
    area_interval,
    areas,
    best_threshold,
    cross_validated_rates,
    curve,
    jackknife_interval,
    left_out,
    sensitivity_at,
    sort_scores,
)


@pytest.fixture(scope="module")
def sample():
    """Scores with ties of 12 persons."""
    rng = np.random.default_rng(4)
    person = np.repeat(np.arange(12), 20)
    event = rng.random(240) < 0.4
    return np.round(rng.normal(size=240) + event, 1), event, person


def test_area_is_mann_whitneys_share_of_pairs(sample):
    score, event, _ = sample
    (found,) = areas(sort_scores(*sample), np.ones((1, 12), dtype=int))
    expected = mannwhitneyu(score[event], score[~event]).statistic / (event.sum() * (~event).sum())
    assert found == pytest.approx(expected, rel=1e-12)
    assert np.trapezoid(*curve(score, event)[::-1]) == pytest.approx(expected, rel=1e-12)


def test_a_person_drawn_twice_counts_as_two(sample, monkeypatch):
    monkeypatch.setattr(roc, "AT_ONCE", 500)  # two samples at a time
    score, event, person = sample
    weights = np.random.default_rng(3).multinomial(12, np.full(12, 1 / 12), 5)
    for row, found in zip(weights, areas(sort_scores(*sample), weights), strict=True):
        drawn = np.repeat(np.arange(len(score)), row[person])
        high, low = score[drawn][event[drawn]], score[drawn][~event[drawn]]
        pairs = (high[:, None] > low).mean() + 0.5 * (high[:, None] == low).mean()
        assert found == pytest.approx(pairs, rel=1e-12)


def test_threshold_and_sensitivity_by_hand():
    score = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0])
    event = np.array([0, 0, 0, 1, 0, 1, 1, 1], dtype=bool)
    assert best_threshold(score, event) in (3.5, 5.5)
    assert sensitivity_at(score, event) == 0.75
    assert sensitivity_at(-score, event) == 0.0
    # Constant scores tell nobody; what no threshold improves is told of nobody.
    assert sensitivity_at(0 * score, event) == 0.0
    assert best_threshold(0 * score, event) == np.inf


def test_thresholds_of_other_persons_tell_what_normal_scores_allow():
    rng = np.random.default_rng(1)
    event = np.tile([True, False], 4000)
    score, person = rng.normal(size=8000) + 2 * event, np.repeat(np.arange(40), 200)
    assert cross_validated_rates(score, event, person, 5, [1]) == pytest.approx(
        (norm.cdf(1), norm.cdf(1)), abs=0.02
    )
    # A score that is nothing but the person's own cannot be learnt from others.
    assert cross_validated_rates(rng.normal(size=8000), event, person, 5, [1]) != pytest.approx(
        (1.0, 1.0), abs=0.4
    )


def test_the_interval_is_students_for_a_mean_and_within_0_and_1_for_a_share():
    values = np.random.default_rng(2).normal(size=9)
    parts = (values.sum() - values) / 8
    low, high = jackknife_interval(values.mean(), parts)
    assert (low, high) == pytest.approx(t.interval(0.95, 8, values.mean(), sem(values)))
    low, high = area_interval(0.95, np.linspace(0.9, 0.99, 9))
    assert 0 < low < 0.95 < high < 1
    assert area_interval(1.0, np.ones(9)) is None  # all pairs ordered rightly: how surely is not known


@pytest.mark.statistical
@pytest.mark.parametrize("persons", [6, 10, 25])
def test_intervals_over_persons_cover_the_true_area(persons):
    """Of 400 cohorts with thresholds of their own, 92 to 98 % of the intervals hold the area of all persons."""

    def cohort(rng, persons):
        person = np.repeat(np.arange(persons), 16)
        own = rng.normal(0, 1.5, persons)[person]
        score = rng.normal(size=person.size)
        return score, score + own + rng.normal(0, 0.5, person.size) > 0, person

    true = areas(sort_scores(*cohort(np.random.default_rng(0), 4000)), np.ones((1, 4000), dtype=int))[0]
    held = 0
    for seed in range(400):
        scores = sort_scores(*cohort(np.random.default_rng([1, seed]), persons))
        whole = areas(scores, np.ones((1, persons)))[0]
        low, high = area_interval(whole, areas(scores, left_out(persons)))
        held += low <= true <= high
    assert 368 <= held <= 392
