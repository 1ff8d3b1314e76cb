"""What a hand would tell of the rated models, beside what people said of them, and what a survey would need to decide.

Whether a model felt like the tissue is asked of people; whether its force differs from the measured one by more than a hand
notices is computed. The two are put side by side; four models cannot confirm that one follows from the other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations

import numpy as np

from lumbar.records.ratings import Ratings
from lumbar.records.record import Record
from lumbar.tables.described import described
from lumbar.tables.table import Table
from lumbar.tissue.identification.metrics import settling_time
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.perception.felt import Felt, force_difference
from lumbar.tissue.perception.thresholds import Hands

_RESAMPLES = 2000
_DRAWS = 2000
_CONFIDENCE = 0.95
_PARTICIPANTS, _MODELS = (20, 45, 90, 180), (4, 6, 8, 10)
_LEVEL = 0.05


def felt_pairs(
    models: Mapping[str, FittedModel], record: Record, settling_s: float | None, hands: Hands
) -> dict[tuple[str, str], Felt]:
    """Every two models, and each beside the measurement (``""``), on a record's motion; empty where the output is no force."""
    first = round(settling_time(record, settling_s) / record.sampling_time)
    forces = {"": record["output"][first:]}
    forces |= {name: model.simulate(record)[first:] for name, model in models.items()}
    unit, position = record.channels["output"].unit, record["input"][first:]
    found = {}
    for one, other in combinations(forces, 2):
        # The measurement is the standard; of two models the stronger one is, beside which less is noticed.
        standard, beside = (
            (forces[one], forces[other])
            if not one
            else sorted((forces[one], forces[other]), key=np.std, reverse=True)
        )
        met = force_difference(standard, beside, unit, position, record.sampling_time, hands)
        if met is not None:
            found[one, other] = met.felt
    return found


def survey_felt_table(
    ratings: Ratings, felt: Mapping[tuple[str, str], Felt], record: str, seed: int, data: str
) -> Table:
    """Pairs of rated models: what a hand tells of them, and what the participants said."""
    picks = dict(zip(ratings.models, 100 * ratings.picks() / len(ratings), strict=True))
    rows = []
    for (one, other), found in felt.items():
        if not one:
            continue
        closer = min((one, other), key=lambda name: felt["", name].jnd.value)
        difference = ratings.of(one) - ratings.of(other)
        rows.append(
            {
                "model_a": one,
                "model_b": other,
                "felt_jnd": found.jnd.value,
                "felt_low": found.jnd.low,
                "felt_high": found.jnd.high,
                "told_apart_percent": found.told_apart_percent.value,
                "error_a_jnd": felt["", one].jnd.value,
                "error_b_jnd": felt["", other].jnd.value,
                "closer": closer,
                "rating_difference": float(np.mean(difference)),
                "rated_alike_percent": 100 * float(np.mean(difference == 0)),
                "picked_a_percent": picks[one],
                "picked_b_percent": picks[other],
            }
        )
    words = {"record": record, "rank": _rank_sentence(ratings, felt, seed)}
    return described(__file__, "survey_felt", rows, data, words)


def _rank_sentence(ratings: Ratings, felt: Mapping[tuple[str, str], Felt], seed: int) -> str:
    """Rank correlation of felt error and mean rating over the models, and what so few models can decide."""
    names = [name for name in ratings.models if ("", name) in felt]
    if len(names) < 3:
        return f"{len(names)} rated models were identified: no rank correlation is made."
    errors = np.array([felt["", name].jnd.value for name in names])
    scores = ratings.scores[:, [ratings.models.index(name) for name in names]]
    drawn = np.random.default_rng([seed, 32]).integers(len(ratings), size=(_RESAMPLES, len(ratings)))
    own = spearman(errors, scores.mean(axis=0)[None])[0]
    low, high = np.quantile(
        spearman(errors, scores[drawn].mean(axis=1)), [(1 - _CONFIDENCE) / 2, (1 + _CONFIDENCE) / 2]
    )
    least = min(2 / math.factorial(len(names)), 1.0)
    decides = "cannot be significant at 5 %" if least > _LEVEL else "can be significant at 5 %"
    return (
        f"Rank correlation of felt error and mean rating over {len(names)} models: {own:+.2g} ({low:+.2g} to {high:+.2g} over "
        "resampled participants, the models fixed); −1 is expected where people rate what a hand tells. Even a perfect order of "
        f"{len(names)} models has p = {least:.2g} and {decides}."
    )


def spearman(fixed: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Spearman's rank correlation of one sequence with every row, ties by mean ranks; 0 where a row has a single value."""
    from scipy.stats import rankdata

    first = rankdata(fixed) - (len(fixed) + 1) / 2
    ranks = rankdata(rows, axis=1) - (len(fixed) + 1) / 2
    size = np.sqrt(np.sum(first**2) * np.sum(ranks**2, axis=1))
    return np.where(size > 0, ranks @ first / np.where(size > 0, size, 1.0), 0.0)


def survey_power_table(ratings: Ratings, seed: int, data: str) -> Table:
    """What a survey would need: the chance that ratings show, at 5 %, that they follow the felt error.

    Taken for true are mean ratings in equal steps over the range of this survey's, in the order of what is felt, and this
    survey's spread of one participant's ratings about his own mean. Two-sided by the distribution of random orders.
    """
    means = ratings.scores.mean(axis=0)
    within = ratings.scores - ratings.scores.mean(axis=1, keepdims=True) - means + means.mean()
    people, models = ratings.scores.shape
    spread = float(np.sqrt(np.sum(within**2) / ((people - 1) * (models - 1))))
    generator, rows = np.random.default_rng([seed, 33]), []
    for count in _MODELS:
        order, steps = np.arange(count, dtype=float), np.linspace(means.min(), means.max(), count)
        chance = np.sort(np.abs(spearman(order, generator.random((20 * _DRAWS, count)))))
        # The least correlation that random orders reach in no more than the level.
        values = np.unique(chance)
        share = 1 - np.searchsorted(chance, values - 1e-9) / len(chance)
        reached = values[share <= _LEVEL]
        for participants in _PARTICIPANTS:
            seen = steps + generator.normal(0.0, spread / np.sqrt(participants), (_DRAWS, count))
            power = float(np.mean(spearman(order, seen) >= reached[0] - 1e-9)) if reached.size else 0.0
            rows.append({"models": count, "participants": participants, "power_percent": 100 * power})
    words = {"spread": spread, "low": means.min(), "high": means.max(), "draws": _DRAWS}
    return described(__file__, "survey_power", rows, data, words)
