"""Several trials of several people: one mean of each person, and the scatter between people and between one person's trials.

Value = mean of the group + deviation of the person (σ_person) + deviation of the trial (σ_trial), with person as the
random effect, by restricted maximum likelihood (statsmodels, MixedLM). A singular fit, whose σ_person is 0, is none: what
rests on it would count trials as if they were people.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

FEWEST_PERSONS = 3
"""Persons of a group below which no interval is given: with two, one difference stands for all scatter between people.
From three on the tests hold their level (benchmarks/population.py)."""


@dataclass(frozen=True, eq=False)
class PersonMeans:
    """Trials by person, and one mean of each."""

    persons: tuple[str, ...]
    values: tuple[np.ndarray, ...]
    """Trials of each person."""

    @classmethod
    def of(cls, trials: Mapping[str, Sequence[float]]) -> Self:
        """Trials by person; persons without one are left out.

        Examples
        --------
        >>> PersonMeans.of({"ann": [1.0, 3.0], "bob": [5.0], "eve": []}).mean.tolist()
        [2.0, 5.0]
        """
        found = {person: np.asarray(values, float) for person, values in trials.items() if len(values)}
        return cls(tuple(found), tuple(found.values()))

    @cached_property
    def mean(self) -> np.ndarray:
        """Mean of each person's trials, shape (persons,)."""
        return np.array([values.mean() for values in self.values])

    @cached_property
    def trials(self) -> np.ndarray:
        """Number of each person's trials, shape (persons,)."""
        return np.array([len(values) for values in self.values], dtype=int)

    @cached_property
    def squares(self) -> float:
        """Sum of squared deviations of all trials from their person's mean."""
        return float(sum(np.square(values - values.mean()).sum() for values in self.values))

    def __len__(self) -> int:
        return len(self.persons)

    def weights(self, variance_ratio: float | None) -> np.ndarray:
        """Weights of the means in inverse proportion to their variances σ_person² + σ_trial²/trials.

        The ratio is σ_trial²/σ_person²; None, where it cannot be estimated, weighs all persons alike.
        """
        if variance_ratio is None:
            return np.ones(len(self))
        return 1 / (1 + variance_ratio / self.trials)


def pair_up(first: PersonMeans, second: PersonMeans) -> tuple[PersonMeans, PersonMeans]:
    """Return the persons found in both, in the order of the first."""
    shared = tuple(person for person in first.persons if person in second.persons)
    one, other = (
        PersonMeans(shared, tuple(side.values[side.persons.index(person)] for person in shared))
        for side in (first, second)
    )
    return one, other


def too_few(**counts: int) -> str:
    """Return why there is no interval, or nothing where there are persons enough.

    Examples
    --------
    >>> too_few(expert=2, novice=8)
    'no interval: 2 persons (expert), at least 3 are needed'
    """
    short = [
        f"{count} person{'' if count == 1 else 's'} ({name})"
        for name, count in counts.items()
        if count < FEWEST_PERSONS
    ]
    return f"no interval: {', '.join(short)}, at least {FEWEST_PERSONS} are needed" if short else ""


ESTIMATED = "estimated"


@dataclass(frozen=True)
class VarianceComponents:
    """Standard deviations, both None where they cannot be told apart."""

    person_sd: float | None
    trial_sd: float | None
    """`person_sd`, `trial_sd`: in the unit of the values."""
    status: str = ESTIMATED
    """``"estimated"``, or why there are none."""

    @property
    def variance_ratio(self) -> float | None:
        """σ_trial²/σ_person²."""
        if self.person_sd is None or self.trial_sd is None:
            return None
        return (self.trial_sd / self.person_sd) ** 2

    @property
    def intraclass_correlation(self) -> float | None:
        """σ_person²/(σ_person² + σ_trial²): 1 where a person's trials are all alike."""
        ratio = self.variance_ratio
        return None if ratio is None else 1 / (1 + ratio)


def _none(reason: str) -> VarianceComponents:
    return VarianceComponents(None, None, reason)


def variance_components(groups: list[PersonMeans]) -> VarianceComponents:
    """Estimate the components from the trials of groups with means of their own."""
    persons, trials = sum(map(len, groups)), int(sum(group.trials.sum() for group in groups))
    if persons <= len(groups):
        return _none("one person in each group")
    if trials == persons:
        return _none("one trial of each person: scatter between people and trials cannot be told apart")
    within = sum(group.squares for group in groups) / (trials - persons)
    between = _analysis_of_variance(groups, within)
    if within <= 1e-20 * max(np.square(group.mean).max() for group in groups):
        return (
            VarianceComponents(float(np.sqrt(between)), 0.0) if between > 0 else _none("all values are equal")
        )
    if between <= 0:
        return _none("singular: people do not differ more than their trials do")
    return _mixed_model(groups, within, between)


def change_components(first: PersonMeans, second: PersonMeans) -> VarianceComponents:
    """Scatter of the changes of the persons found in both conditions, and of single trials, by moments."""
    pairs = list(zip(*(side.values for side in pair_up(first, second)), strict=True))
    freedom = sum(len(values) - 1 for pair in pairs for values in pair)
    if len(pairs) < 2:
        return _none("one person with both")
    if not freedom:
        return _none("one trial of each person: scatter between people and trials cannot be told apart")
    within = sum(np.square(values - values.mean()).sum() for pair in pairs for values in pair) / freedom
    changes = np.var([pair[0].mean() - pair[1].mean() for pair in pairs], ddof=1)
    between = changes - within * np.mean([sum(1 / len(values) for values in pair) for pair in pairs])
    if between <= 0:
        return _none("singular: people's changes do not differ more than their trials do")
    return VarianceComponents(float(np.sqrt(between)), float(np.sqrt(within)))


def _analysis_of_variance(groups: list[PersonMeans], within: float) -> float:
    """Estimate σ_person² by moments (Searle, Casella & McCulloch, 1992, ch. 3); it may be negative."""
    squares, factor, freedom = 0.0, 0.0, 0
    for group in groups:
        count = group.trials.sum()
        squares += (group.trials * (group.mean - group.trials @ group.mean / count) ** 2).sum()
        factor += count - np.square(group.trials).sum() / count
        freedom += len(group) - 1
    return (squares - freedom * within) / factor


def _mixed_model(groups: list[PersonMeans], within: float, between: float) -> VarianceComponents:
    """Fit MixedLM from the moments' estimate: from its own start it finds no optimum in a third of small samples."""
    from statsmodels.regression.mixed_linear_model import MixedLM, MixedLMParams
    from statsmodels.tools.sm_exceptions import ConvergenceWarning

    scale = np.sqrt(within)
    values, labels, design = _stack_trials(groups)
    start = MixedLMParams.from_components(
        fe_params=np.zeros(len(groups)), cov_re=np.array([[between / within]])
    )
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        fit = MixedLM(values / scale, design, groups=labels).fit(
            reml=True, method=["lbfgs"], start_params=start
        )
    person, trial = float(fit.cov_re[0, 0]), float(fit.scale)
    if not fit.converged or any(issubclass(item.category, ConvergenceWarning) for item in told):
        return _none("singular: the likelihood has no maximum inside, at a scatter between people above 0")
    return VarianceComponents(float(scale * np.sqrt(person)), float(scale * np.sqrt(trial)))


def _stack_trials(groups: list[PersonMeans]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All trials, the number of their person, and a column of ones for each group."""
    people = [(number, values) for number, group in enumerate(groups) for values in group.values]
    counts = [len(values) for _, values in people]
    labels = np.repeat(np.arange(len(people)), counts)
    design = np.eye(len(groups))[np.repeat([number for number, _ in people], counts)]
    return np.concatenate([values for _, values in people]), labels, design
