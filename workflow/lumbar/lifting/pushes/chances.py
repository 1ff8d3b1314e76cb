"""Chances of a step that a measure gives every push, learnt on other persons: the rule under which all measures compete.

One logistic regression per direction, so that no measure, and no baseline either, loses by not being told which way the push
goes. Whoever is told has no part in what is learnt. *Alone* a measure is its own score; one that a push cannot enter is told
the size beside it. *Added* it joins the size of the push and the mass, which anybody knows: what it adds to them is what
measuring it is worth.
"""

from collections.abc import Hashable, Mapping, Sequence
from typing import TypeVar

import numpy as np
import pandas as pd

from lumbar.lifting.pushes.levels import NOTHING, PREDICTORS, RATIO, score
from lumbar.lifting.pushes.roc import groups_of

Key = TypeVar("Key", bound=Hashable)
KNOWN, KNOWN_WORDS = "push_and_mass", "the push's size and direction and the mass"
"""What every measure is added to."""
ALONE, ADDED = "alone", "added"
PRIOR_SD = np.array([10.0, 2.5])
"""Of constant and slopes, with predictors of unit spread: finite where they separate all pushes (Gelman et al. 2008)."""


def chances_of(
    frame: pd.DataFrame, names: list[str], folds: int, seed: list[int]
) -> dict[tuple[str, str], np.ndarray]:
    """Return log odds of a step, shape (pushes,), by measure and `ALONE` or `ADDED`; ``KNOWN, ALONE`` is what they are added to.

    A measure without a level at every push (no basin) is left out.

    Parameters
    ----------
    frame : pandas.DataFrame
        Pushes, columns `lumbar.lifting.pushes.contest.COLUMNS`.
    folds : int
        Groups of persons, drawn by `seed`, each told by what was learnt on the others.
    """
    size, shift = np.log(frame["impulse_N_s"].to_numpy(float)), frame["shift_m_per_N_s"].to_numpy(float)
    known = [size, np.log(frame["level_push_over_mass"].to_numpy(float))]
    predictors = {(KNOWN, ALONE): known}
    for name in names:
        own = score(name, frame[f"level_{name}"].to_numpy(float), np.exp(size), shift)
        if not np.isfinite(own).all():
            continue
        entering = PREDICTORS[name].push
        own = np.log(own) if entering == RATIO else own
        predictors[name, ALONE] = [size, own] if entering == NOTHING else [own]
        predictors[name, ADDED] = [*known, own]
    return told_by_others(
        predictors,
        frame["steps"].to_numpy(bool),
        frame["direction"].to_numpy(str),
        groups_of(frame["subject"].to_numpy(str), folds, seed),
    )


def told_by_others(
    predictors: Mapping[Key, Sequence[np.ndarray]],
    steps: np.ndarray,
    direction: np.ndarray,
    groups: np.ndarray,
) -> dict[Key, np.ndarray]:
    """Log odds of a step by each set of predictors, shape (pushes,), learnt on other groups, direction by direction."""
    told = {key: np.zeros(len(steps)) for key in predictors}
    for way in np.unique(direction):
        there = direction == way
        for fold in np.unique(groups[there]):
            learnt, held = there & (groups != fold), there & (groups == fold)
            if not learnt.any():
                continue
            for key, columns in predictors.items():
                told[key][held] = _log_odds(np.stack(columns), steps, learnt, held)
    return told


def _log_odds(predictors: np.ndarray, steps: np.ndarray, learnt: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Log odds of those held out, by the maximum a posteriori of a logistic regression on the others."""
    from scipy.optimize import minimize
    from scipy.special import expit

    own = predictors[:, learnt]
    centre, spread = own.mean(axis=1), own.std(axis=1)
    # A mass that all persons share, or a level that none varies, tells nothing.
    scaled = (predictors - centre[:, None]) / np.where(spread > 1e-9 * np.abs(centre), spread, np.inf)[
        :, None
    ]
    design = np.vstack([np.ones(len(steps)), scaled])
    inside, outcome = design[:, learnt], steps[learnt]
    precision = 1 / PRIOR_SD[np.minimum(np.arange(len(design)), 1)] ** 2

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        odds = weights @ inside
        value = np.logaddexp(0, odds).sum() - odds[outcome].sum() + 0.5 * precision @ weights**2
        return value, inside @ (expit(odds) - outcome) + precision * weights

    found = minimize(loss, np.zeros(len(design)), jac=True, method="BFGS")
    return found.x @ design[:, held]
