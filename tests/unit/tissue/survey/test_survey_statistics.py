"""Survey statistics against published numbers, closed forms, enumeration and independent implementations."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from lumbar.base.errors import NumericalError
from lumbar.records.ratings import Ratings, read_ratings
from lumbar.settings.runtime import SurveySettings
from lumbar.tissue.survey import paired_analysis
from lumbar.tissue.survey.paired_analysis import (
    EXACT_LIMIT,
    compare_pairs,
    friedman,
    resampled_counts,
    signed_rank_test,
    vargha_delaney,
)
from lumbar.tissue.survey.survey_analysis import (
    analyse_survey,
    describe_participants,
    equal_shares_test,
    pick_shares,
)
from lumbar.tissue.survey.table_3_2 import holm, kruskal_wallis, mann_whitney, modes, pairs
from study_settings import study_settings


@pytest.fixture(scope="module")
def settings(project) -> SurveySettings:
    """Those of the study, with fewer resamples."""
    return study_settings().survey.model_copy(update={"resamples": 1000})


@pytest.fixture(scope="module")
def ratings(project, settings) -> Ratings:
    return read_ratings(project / "resources" / "survey" / "survey_reconstructed.csv", settings.layout)


@pytest.fixture(scope="module")
def analysed(ratings, settings):
    return analyse_survey(ratings, settings, 7, "synthetic twin")


def make_ratings(scores, best=None, models=("A", "B", "C", "D")) -> Ratings:
    scores = np.asarray(scores)
    models = models[: scores.shape[1]]
    return Ratings(
        participants=tuple(map(str, range(len(scores)))),
        models=models,
        scores=scores,
        scale_points=5,
        best=tuple(best or models[:1] * len(scores)),
        groups={},
    )


def test_table_3_2_has_published_numbers(analysed, project):
    table = analysed.tables["table_3_2"]
    published = (project / "resources" / "thesis" / "table_3_2.csv").read_text(encoding="utf-8").splitlines()
    header = published[0].split(",")
    assert set(header) <= set(table.frame.columns)
    for line, (_, row) in zip(published[1:], table.frame.iterrows(), strict=True):
        wanted = dict(zip(header, line.split(","), strict=True))
        for column in ("model", "median", "mode", "mode_count"):
            assert row[column] == type(row[column])(wanted[column])
        assert abs(row["best_percent"] - float(wanted["best_percent"])) < 0.05
        for other in ("MW", "KB", "HO"):
            cell = row[f"printed_vs_{other}"]
            assert ("" if cell is None or cell != cell else cell) == wanted[f"p_vs_{other}"]


def test_tests_of_thesis_have_reference_values(ratings):
    # H and p computed by R's kruskal.test and wilcox.test on the same answers.
    overall = kruskal_wallis(ratings)
    assert overall.statistic == pytest.approx(29.29, abs=0.005)
    assert overall.dof == 3
    assert overall.p_value == pytest.approx(stats.chi2.sf(overall.statistic, 3))
    expected = ["1.7e-02", "7.2e-06", "1.6e-05", "6.3e-03", "1.1e-02", "7.9e-01"]
    assert [f"{p_value:.1e}" for p_value in mann_whitney(ratings)] == expected
    assert pairs(ratings) == [*itertools.combinations(("IL", "MW", "KB", "HO"), 2)]
    # Holm's adjustment by hand: 6 * 0.001, 5 * 0.01, 4 * 0.02, 3 * 0.03 and then the running maximum.
    p = np.array([0.5, 0.03, 0.001, 0.02, 0.01, 0.04])
    assert holm(p) == pytest.approx([0.5, 0.09, 0.006, 0.08, 0.05, 0.09])


@pytest.mark.parametrize(("counts", "mode"), [((1, 5, 0, 5, 2), "2/4"), ((0, 0, 7, 1, 2), "3")])
def test_all_modes_are_listed(counts, mode):
    assert modes(np.array(counts)) == mode


def brute_force_signed_rank(differences, zeros):
    """Statistic and p-value from every assignment of signs, with exact rational ranks."""
    values = [d for d in differences if d != 0] if zeros == "wilcox" else list(differences)
    sizes = [abs(v) for v in values]
    doubled = [sum(s < t for s in sizes) * 2 + sum(s == t for s in sizes) + 1 for t in sizes]
    ranks = [rank for rank, value in zip(doubled, values, strict=True) if value != 0]
    observed = sum(rank for rank, value in zip(doubled, values, strict=True) if value > 0)
    middle = sum(ranks)
    hits = sum(
        abs(2 * sum(itertools.compress(ranks, signs)) - middle) >= abs(2 * observed - middle)
        for signs in itertools.product((0, 1), repeat=len(ranks))
    )
    return observed / 2, hits / 2 ** len(ranks)


@pytest.mark.parametrize("zeros", ["pratt", "wilcox"])
@pytest.mark.parametrize("seed", range(12))
def test_signed_rank_p_is_enumerated_one(zeros, seed):
    random = np.random.default_rng(seed)
    differences = random.integers(-4, 5, size=random.integers(1, 12))
    result = signed_rank_test(differences, zeros)
    statistic, p_value = brute_force_signed_rank(differences.tolist(), zeros)
    assert result.exact
    assert result.statistic == statistic
    assert result.p_value == pytest.approx(p_value, rel=1e-12)


@pytest.mark.parametrize("zeros", ["pratt", "wilcox"])
def test_large_samples_use_the_normal_approximation(zeros):
    differences = np.random.default_rng(1).integers(-4, 5, 3 * EXACT_LIMIT)
    differences[::9] += 1
    result = signed_rank_test(differences, zeros)
    assert not result.exact
    reference = stats.wilcoxon(differences, zero_method=zeros, method="asymptotic", correction=False)
    assert result.p_value == pytest.approx(reference.pvalue, rel=1e-9)


def test_zero_differences_have_p_one():
    assert signed_rank_test(np.zeros(20)).p_value == 1.0
    assert signed_rank_test(np.array([])).p_value == 1.0
    with pytest.raises(ValueError, match=r"'zsplit'.*pratt, wilcox"):
        signed_rank_test(np.arange(5), "zsplit")


def test_friedman_and_kendall_of_worked_example():
    # Ranks of three judges, no ties: W = 12 S / (m² (n³ − n)) with S the squared deviations of the rank sums.
    scores = np.array([[1, 2, 3, 4], [2, 1, 3, 4], [1, 3, 2, 4]])
    sums = scores.sum(axis=0)
    w = 12 * ((sums - sums.mean()) ** 2).sum() / (9 * (64 - 4))
    overall, concordance = friedman(make_ratings(scores))
    assert concordance == pytest.approx(w)
    assert overall.statistic == pytest.approx(3 * 3 * w)
    assert overall.p_value == pytest.approx(stats.chi2.sf(3 * 3 * w, 3))


def test_superiority_is_share_of_all_pairs(ratings):
    a, b = ratings.scores_of("IL"), ratings.scores_of("KB")
    brute = np.mean([(x > y) + 0.5 * (x == y) for x in a for y in b])
    counts = dict(zip(ratings.models, ratings.counts(), strict=True))
    assert vargha_delaney(counts["IL"], counts["KB"]) == pytest.approx(brute, rel=1e-12)


def test_bootstrap_interval_is_that_of_resampled_rows(ratings):
    result = compare_pairs(ratings, 0.95, 20_000, 1)[-1]
    random, values = np.random.default_rng(99), []
    for _ in range(3000):
        rows = ratings.scores[random.integers(0, len(ratings), len(ratings))]
        values.append(np.mean(np.sign(rows[:, 2][:, None] - rows[:, 3])) / 2 + 0.5)
    assert [result.low, result.high] == pytest.approx(np.quantile(values, [0.025, 0.975]), abs=0.012)
    assert result.low < result.narrow_low < result.narrow_high < result.high


def test_bootstrap_draws_whole_participants():
    # Two kinds of participants with opposite answers: the counts of the two models must move together.
    counts = resampled_counts(make_ratings([[1, 5]] * 10 + [[5, 1]] * 10), 500, [1])
    assert (counts[:, 0, 0] == counts[:, 1, 4]).all()
    assert (counts.sum(axis=2) == 20).all()
    assert counts[:, 0, 0].std() == pytest.approx(math.sqrt(20 / 4), rel=0.1)


def test_equivalence_is_two_one_sided_tests():
    # Both tests at 0.05 pass where the interval of 90 % lies inside; that of 95 % may reach out.
    result = compare_pairs(make_ratings([[1, 2, 3], [3, 2, 1]]), 0.95, 1000, 1)[0]
    inside = replace(result, low=0.43, narrow_low=0.45, narrow_high=0.55, high=0.57)
    assert inside.is_equivalent(0.06)
    assert not replace(inside, narrow_high=0.57).is_equivalent(0.06)
    assert not replace(inside, narrow_low=0.43).is_equivalent(0.06)


def test_intervals_of_picks_are_closed_forms(ratings):
    shares, n = pick_shares(ratings, 0.95), len(ratings)
    assert shares.picks.tolist() == [2, 14, 12, 17]
    z, chi2 = stats.norm.ppf(0.975), stats.chi2.ppf(1 - 0.05 / 4, 1)
    for row, x in enumerate(shares.picks):
        centre, half = (x + z**2 / 2) / (n + z**2), z / (n + z**2) * math.sqrt(x * (n - x) / n + z**2 / 4)
        assert shares.wilson[row] == pytest.approx([centre - half, centre + half])
        root = math.sqrt(chi2 * (chi2 + 4 * x * (n - x) / n))
        goodman = [(chi2 + 2 * x - root) / (2 * (n + chi2)), (chi2 + 2 * x + root) / (2 * (n + chi2))]
        assert shares.goodman[row] == pytest.approx(goodman)
    assert (shares.goodman[:, 0] < shares.wilson[:, 0]).all()


def test_chi_square_of_picks():
    assert equal_shares_test(np.array([2, 14, 12, 17])).p_value == pytest.approx(0.010, abs=5e-4)
    rest = equal_shares_test(np.array([14, 12, 17]))
    expected = sum((x - 43 / 3) ** 2 / (43 / 3) for x in (14, 12, 17))
    assert rest.statistic == pytest.approx(expected)
    assert rest.p_value == pytest.approx(math.exp(-expected / 2))  # chi-square with 2 degrees of freedom
    assert rest.p_value == pytest.approx(0.64, abs=0.01)
    with pytest.raises(NumericalError, match=r"\b0\b.*\b3\b"):
        equal_shares_test(np.array([0, 0, 0]))


def test_participants_are_described_as_in_thesis(ratings):
    described = describe_participants(ratings)
    assert described["number"] == 45
    assert described["groups"]["clinician"]["count"] == 34
    percents = {name: round(group["percent"], 1) for name, group in described["groups"].items()}
    assert percents == {"clinician": 75.6, "dry_needling": 15.6, "acupuncture": 13.3, "palpation": 93.3}
    assert [round(described["experience"][level]["percent"], 1) for level in ("<5", ">20")] == [11.1, 35.6]


@pytest.mark.nightly
def test_analysis_depends_only_on_seed_and_states_reconstruction(analysed, ratings, settings):
    second, other = (analyse_survey(ratings, settings, seed, "synthetic twin").tables for seed in (7, 8))
    for name, table in analysed.tables.items():
        assert table.to_html() == second[name].to_html()
        assert (
            table.source_label.startswith("reconstructed survey") and "synthetic twin" in table.source_label
        )
        assert any("demonstration" in note for note in table.notes)
    assert other["survey_paired"].to_html() != second["survey_paired"].to_html()


def test_real_answers_are_not_called_reconstructed(ratings, settings):
    real = replace(ratings, sources=("laboratory X",))
    for table in analyse_survey(real, settings, 1, "laboratory X").tables.values():
        assert table.source_label == "laboratory X"
        assert "reconstructed" not in table.to_html()


def test_large_p_does_not_show_equivalence(analysed):
    table = analysed.tables["survey_paired"]
    kb_ho = table.frame.iloc[-1]
    assert kb_ho["p_wilcoxon"] > 0.5
    assert kb_ho["equivalent"] == "not shown"
    assert any("KB" in note and "HO" in note and "equivalence" in note for note in table.notes)


def test_result_that_depends_on_treatment_of_zeros_is_undecided():
    # Fifteen equal; of the others fifteen up and five down.
    first = np.r_[[3] * 15, [4] * 13, [5] * 2, [2] * 4, [1]]
    scores = np.column_stack([first, [3] * 35, [1, 2, 3, 4, 5] * 7])
    pair = compare_pairs(make_ratings(scores), 0.95, 1000, 1)[0]
    difference = first - 3
    assert pair.test.p_value == signed_rank_test(difference, "pratt").p_value
    assert pair.test_without_zeros.p_value == signed_rank_test(difference, "wilcox").p_value
    assert pair.test.p_value != pytest.approx(pair.test_without_zeros.p_value, rel=0.05)
    pair = replace(pair, p_holm=0.034, p_holm_without_zeros=0.054)
    assert any(
        "0.034" in note and "0.054" in note
        for note in paired_analysis._notes(make_ratings(scores), [pair], 0.06)
    )


@pytest.mark.parametrize(
    ("test", "scores", "tokens"),
    [
        (friedman, [[3, 3, 3]] * 10, r"Friedman.*\bparticipant\b"),
        (kruskal_wallis, [[3, 3, 3]] * 10, r"Kruskal-Wallis.*\bratings\b"),
        (friedman, [[1, 2], [2, 3]], r"Friedman.*\b2\b.*\b3\b"),
    ],
)
def test_equal_answers_are_rejected(test, scores, tokens):
    with pytest.raises(NumericalError, match=tokens):
        test(make_ratings(scores))


def test_two_constant_models_have_p_one():
    ratings = make_ratings([[3, 3, rating] for rating in (1, 2, 5) * 3])
    assert mann_whitney(ratings)[0] == 1.0
    assert compare_pairs(ratings, 0.95, 1000, 1)[0].test.p_value == 1.0
