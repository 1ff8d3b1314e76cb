"""Receiver operating characteristic of scores of events that come in clusters: one person gives many.

An area is the share of pairs (one event, one not) that the score orders rightly, ties counted half (Mann and Whitney 1947;
Hanley and McNeil 1982). Its interval comes from leaving out one person after the other, with all of theirs.
"""

from dataclasses import dataclass

import numpy as np

from lumbar.lifting.population.contrast import jackknife_interval

SPECIFICITY = 0.95
"""At which the sensitivity is told."""
AT_ONCE = 2**17
"""Weights of scores that are held at once: memory does not grow with samples times scores."""


@dataclass(frozen=True)
class SortedScores:
    """Scores in rising order, ties together, for areas under many weights of persons."""

    order: np.ndarray
    """Shape (n,)."""
    starts: np.ndarray
    """Shape (values,): where each different score begins."""
    event: np.ndarray
    """Shape (n,): in that order."""
    person: np.ndarray
    """Shape (n,): index of the person, in that order."""


def sort_scores(score: np.ndarray, event: np.ndarray, person: np.ndarray) -> SortedScores:
    """Sort scores once; arrays of shape (n,), persons as whole numbers from 0."""
    order = np.argsort(score, kind="stable")
    values = score[order]
    starts = np.flatnonzero(np.r_[True, values[1:] != values[:-1]])
    return SortedScores(order, starts, event[order], person[order])


def area(score: np.ndarray, event: np.ndarray) -> float:
    """Area under the curve, every event counted once; arrays of shape (n,)."""
    return float(areas(sort_scores(score, event, np.zeros(len(score), dtype=int)), np.ones((1, 1)))[0])


def areas(scores: SortedScores, weights: np.ndarray) -> np.ndarray:
    """Areas under the curve, shape (samples,), for weights of persons, shape (samples, persons): how often each counts.

    NaN where a sample has no event, or nothing else.
    """
    found = np.empty(len(weights))
    count = max(1, AT_ONCE // len(scores.person))
    for start in range(0, len(weights), count):
        own = weights[start : start + count, scores.person].astype(float)
        hit = np.add.reduceat(own * scores.event, scores.starts, axis=1)
        miss = np.add.reduceat(own * ~scores.event, scores.starts, axis=1)
        below = np.cumsum(miss, axis=1) - 0.5 * miss
        with np.errstate(invalid="ignore"):
            found[start : start + count] = (hit * below).sum(axis=1) / (hit.sum(axis=1) * miss.sum(axis=1))
    return found


def left_out(persons: int) -> np.ndarray:
    """Weights of persons that leave out one after the other, shape (persons, persons)."""
    return 1.0 - np.eye(persons)


def area_interval(whole: float, parts: np.ndarray) -> tuple[float, float] | None:
    """Return the same of an area from those without each person, on the scale of log odds; None where one is 0 or 1."""
    from scipy.special import expit, logit

    values = logit(np.r_[whole, parts])
    if not np.isfinite(values).all():
        return None
    low, high = (float(expit(end)) for end in jackknife_interval(values[0], values[1:]))
    return low, high


def curve(score: np.ndarray, event: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shares of false alarms and of events told, from the highest threshold to the lowest, one point per different score."""
    order = np.argsort(-score, kind="stable")
    values, told = score[order], event[order]
    last = np.flatnonzero(np.r_[values[1:] != values[:-1], True])
    hits, alarms = np.cumsum(told)[last], np.cumsum(~told)[last]
    return np.r_[0.0, alarms / max(alarms[-1], 1)], np.r_[0.0, hits / max(hits[-1], 1)]


def sensitivity_at(score: np.ndarray, event: np.ndarray, specificity: float = SPECIFICITY) -> float:
    """Largest share of events told with at least this share of the others left in peace."""
    alarms, hits = curve(score, event)
    return float(hits[alarms <= 1 - specificity + 1e-12].max())


def best_threshold(score: np.ndarray, event: np.ndarray) -> float:
    """Threshold, above which an event is told, with the largest sum of both shares told right (Youden 1950).

    Midway between two scores, so that it is no score itself.
    """
    alarms, hits = curve(score, event)
    values = np.unique(score)[::-1]
    best = int(np.argmax(hits - alarms))
    if best == 0:
        return np.inf
    following = values[best] if best < len(values) else values[-1] - 1.0
    return float((values[best - 1] + following) / 2)


def groups_of(person: np.ndarray, folds: int, seed: list[int]) -> np.ndarray:
    """Draw groups of persons, shape (n,) as `person`; as many as persons where there are fewer than `folds`."""
    persons, index = np.unique(person, return_inverse=True)
    drawn = np.random.default_rng(seed).permutation(len(persons)) % min(folds, len(persons))
    return drawn[index]


def cross_validated_rates(
    score: np.ndarray, event: np.ndarray, person: np.ndarray, folds: int, seed: list[int]
) -> tuple[float, float]:
    """Shares of events and of the others told right, each person by the best threshold of other persons.

    Arrays have shape (n,); groups as of `groups_of`.
    """
    group = groups_of(person, folds, seed)
    told = np.zeros(len(score), dtype=bool)
    for fold in range(group.max() + 1):
        held = group == fold
        told[held] = score[held] > best_threshold(score[~held], event[~held])
    return float(told[event].mean()), float((~told[~event]).mean())
