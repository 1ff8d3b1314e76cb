"""Which effects are missing: forward selection with look-ahead over pairs and a backward pass.

Every candidate is refitted jointly with base and effects. Candidates are compared by the likelihood of the training
record and of the unseen records together: a wrong effect also lowers the training error, but not the others'.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.base.progress import track
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, add, screen
from lumbar.tissue.diagnosis.fitting.joint_fit import fit as refit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import prediction_variance
from lumbar.tissue.diagnosis.noise.noise_floor import prediction_error_filter
from lumbar.tissue.diagnosis.selection.thresholds import MOST_OF_REST, WORTHWHILE, WORTHWHILE_BLIND
from lumbar.tissue.models.form import Effect, Form

_MOST_LEFT = 0.5
"""Share of a response's variance that a model without a known noise floor may leave and still be adequate."""
_PREDICTION_ORDER = 12
_UNCERTAIN = 4.0
"""Variances of a prediction, from the uncertainty of the parameters, that an unseen error may be above the noise (95 %)."""
ADEQUATE = 1.1
"""A model whose error is within this factor of the noise floor leaves nothing to explain."""
LOOK_AHEAD = 3
"""How many first effects are tried with a second one."""
REFITTED = 5
"""How many effects are refitted after screening in the rounds after the first one, which refits all."""
EXCHANGED = 3
"""How many effects are tried, in all their forms, in the place of one that is taken out."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fitted set of effects and how well it does."""

    fit: Fit
    train_rms: float
    test_rms: float
    """`train_rms`, `test_rms`: free-run simulation errors in the output's unit."""
    score: float
    """Minus twice the log-likelihood of all records, up to a constant, and the logarithm of their size for each parameter
    (Schwarz, Ann. Statist. 6 (1978) 461-464): smaller is better. Unseen errors are taken as Student's t, so that a few
    peaks beyond the range of the training record do not outweigh all the rest."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, in the order added."""
        return self.fit.structure.effects

    @property
    def parameters(self) -> int:
        """Number of parameters."""
        return len(self.fit.linear) + len(self.fit.nonlinear)


def evaluate(fit: Fit, experiment: Experiment) -> Candidate:
    """Simulate a fitted model on all records."""
    training, tests = experiment.training, experiment.tests
    simulated = [(item, fit.simulate(item.motion)) for item in tests]
    errors = np.concatenate([item.error(values) for item, values in simulated])
    unseen = np.concatenate([item.whitened_error(values) for item, values in simulated])
    score = training.size * np.log(fit.squared_error / training.size) + _unlikelihood(unseen)
    score += (len(fit.linear) + len(fit.nonlinear)) * np.log(training.size + len(unseen))
    train_rms = training.kept(("rms", fit), lambda: fit.rms(training))
    return Candidate(fit, train_rms, float(np.sqrt(np.mean(errors**2))), float(score))


_EARLY = 0.6
"""Share of the training record from which the rest is predicted."""
_FREEDOM = 4
"""Degrees of freedom of Student's t for unseen errors."""


def _robust_scale(errors: np.ndarray) -> float:
    """Maximum-likelihood scale of Student's t, by expectation and maximisation."""
    square = errors**2
    scale = float(np.median(square)) or float(np.mean(square))
    for _ in range(12):
        if scale <= 0:
            break
        scale = float(np.mean((_FREEDOM + 1) * square / (_FREEDOM + square / scale)))
    return float(np.sqrt(scale))


def _loss(errors: np.ndarray, scale: float) -> np.ndarray:
    """Minus twice the log-likelihood of Student's t, per error, up to a constant."""
    return (_FREEDOM + 1) * np.log1p((errors / scale) ** 2 / _FREEDOM)


def _unlikelihood(errors: np.ndarray) -> float:
    scale = _robust_scale(errors)
    if scale <= 0:
        return float("-inf")
    return float(np.sum(_loss(errors, scale))) + 2 * len(errors) * float(np.log(scale))


def likelihood_ratio(before: Candidate, after: Candidate, experiment: Experiment) -> float:
    """Likelihood-ratio statistic on the training record: twice what the log-likelihood gains."""
    return experiment.training.size * float(np.log(before.fit.squared_error / after.fit.squared_error))


def unseen_improvement(before: Candidate, after: Candidate, experiment: Experiment) -> float:
    """How many standard errors the loss on unseen records falls by.

    Mean difference of losses over its standard error, neighbouring samples taken as dependent (Diebold and Mariano,
    J. Bus. Econ. Stat. 13 (1995) 253-263; Bartlett weights over half a second). The loss is that of Student's t: of
    squared errors the mean hangs on a few peaks where the force is extrapolated, and no difference is ever certain.
    """
    return _improvement(before.fit, after.fit, experiment.tests)


def later_improvement(before: Candidate, after: Candidate, experiment: Experiment) -> float:
    """How many standard errors the loss falls by on what follows in the training record, refitted to its beginning.

    For effects that accumulate: short records, in which they begin anew, hardly show them.
    """
    training = experiment.training
    early, later = training.kept("early and later", lambda: training.split(_EARLY))
    fits = [refit(item.fit.structure, early, item.fit.nonlinear) for item in (before, after)]
    return _improvement(*fits, [later])


def _improvement(before: Fit, after: Fit, records: list[FitData]) -> float:
    errors = [(before.whitened_errors(record), after.whitened_errors(record)) for record in records]
    scale = min(_robust_scale(np.concatenate(own)) for own in zip(*errors, strict=True))
    if scale <= 0:
        return np.inf
    differences = [_loss(first, scale) - _loss(second, scale) for first, second in errors]
    size = sum(len(item) for item in differences)
    mean = sum(float(item.sum()) for item in differences) / size
    lags = max(1, round(0.5 / records[0].motion.sampling_time))
    variance = 0.0
    for item in differences:
        centred = item - mean
        variance += float(centred @ centred)
        for lag in range(1, min(lags, len(centred) - 1)):
            variance += 2 * (1 - lag / lags) * float(centred[lag:] @ centred[:-lag])
    if variance <= 0:
        return 0.0 if mean == 0 else float(np.copysign(np.inf, mean))
    return mean * size / float(np.sqrt(variance))


def is_adequate(candidate: Candidate, experiment: Experiment, factor: float = ADEQUATE) -> bool:
    """Whether the errors are within this factor of the noise floor, or of what it may scatter to.

    Without a floor: whether the model explains most of the response and leaves white noise.
    """
    if experiment.floor is None:
        return leaves_white_noise(candidate.fit, experiment, factor)
    floor, training, tests = experiment.floor, experiment.training, experiment.tests

    def largest(records: list[FitData]) -> float:
        return floor.rms * max(factor, floor.largest_ratio(sum(item.size for item in records)))

    if candidate.train_rms > largest([training]):
        return False
    if candidate.test_rms <= largest(tests):
        return True
    left = candidate.test_rms**2 - largest(tests) ** 2
    return left <= _UNCERTAIN * prediction_variance(candidate.fit, training, tests)


def is_worthwhile(base: Candidate, before: Candidate, after: Candidate, experiment: Experiment) -> bool:
    """Whether a larger model explains more than what the smaller one has being slightly wrong.

    It leaves noise alone, or removes a share of what the base without effects leaves to explain, or most of what the smaller
    model leaves (`lumbar.tissue.diagnosis.selection.thresholds`).
    """
    if is_adequate(after, experiment):
        return True
    floor = 0.0 if experiment.floor is None else experiment.floor.rms
    share = WORTHWHILE if floor else WORTHWHILE_BLIND
    of_base, of_rest = (max(item.train_rms**2 - floor**2, 0.0) for item in (base, before))
    removed = before.train_rms**2 - after.train_rms**2
    return removed >= max(min(share * of_base, MOST_OF_REST * of_rest), floor**2)


def leaves_white_noise(fit: Fit, experiment: Experiment, factor: float) -> bool:
    """Whether a model explains half of the variance of every record at least, and its past does not predict its error.

    Prediction by an autoregressive model (Yule–Walker): white noise cannot be predicted, so the error is at most
    this factor above that of the prediction.
    """
    for record in (experiment.training, *experiment.tests):
        errors = fit.errors(record)
        if np.mean(errors**2) > _MOST_LEFT * np.var(record.settled(record.force)):
            return False
        if predictability(errors) > factor:
            return False
    return True


def predictability(errors: np.ndarray) -> float:
    """RMS of a signal over that of its prediction error by its own past; 1 for white noise."""
    size, order = len(errors), min(_PREDICTION_ORDER, len(errors) // 20)
    length = 1 << (2 * size).bit_length()
    covariance = np.fft.irfft(np.abs(np.fft.rfft(errors, length)) ** 2, length)[: order + 1] / size
    _, gained = prediction_error_filter(covariance)
    # What white noise would gain by chance: one part in its size for each coefficient.
    return float(np.sqrt(max(gained * (1 - order / size), 1.0)))


def best_by_effect(candidates: list[Candidate]) -> list[Candidate]:
    """Best form of every set of effects, best first."""
    best: dict[frozenset[str], Candidate] = {}
    for candidate in sorted(candidates, key=lambda item: item.score):
        best.setdefault(frozenset(candidate.effects), candidate)
    return list(best.values())


def extend(
    model: Candidate,
    catalogue: dict[str, Effect],
    experiment: Experiment,
    most: int | None = None,
    all_forms: bool = True,
) -> list[Candidate]:
    """Add each effect of the catalogue that the model does not have.

    Parameters
    ----------
    most : int or None
        Refit only this many effects, those with the best screening; None refits all.
    all_forms : bool
        Refit all forms of an effect, or only the one with the best screening. With all forms, the general ones of the best
        `LOOK_AHEAD` effects stand in where simpler ones fail: only if they remove `MOST_OF_REST` of what these leave.

    Returns
    -------
    list of Candidate
        Every refitted form, best first.
    """
    every = [
        form for effect in catalogue.values() if effect.name not in model.effects for form in effect.forms
    ]
    forms = [form for form in every if not form.general]
    if most is not None:
        forms = _promising(model.fit, forms, experiment, most, all_forms)
    tried = track(
        forms,
        f"forms of effects fitted beside {' and '.join([model.fit.structure.base.name, *model.effects])}",
    )
    found = [evaluate(add(model.fit, form, experiment.training), experiment) for form in tried]
    if all_forms:
        simpler = {item.effects[-1]: item for item in best_by_effect(found)[:LOOK_AHEAD]}
        for form in every:
            if form.general and form.effect in simpler:
                found += _where_needed(model, form, simpler[form.effect], experiment)
    return sorted(found, key=lambda item: item.score)


def _where_needed(
    model: Candidate, general: Form, simpler: Candidate, experiment: Experiment
) -> list[Candidate]:
    """A general form refitted, where the best simpler form of its effect leaves much that it explains."""
    if is_adequate(simpler, experiment):
        return []
    found = evaluate(add(model.fit, general, experiment.training), experiment)
    floor = 0.0 if experiment.floor is None else experiment.floor.rms
    rest = max(simpler.train_rms**2 - floor**2, 0.0)
    removed = simpler.train_rms**2 - found.train_rms**2
    return [found] if removed >= MOST_OF_REST * rest else []


def _promising(fit: Fit, forms: list[Form], experiment: Experiment, most: int, all_forms: bool) -> list[Form]:
    """Forms of the effects that screening ranks first."""
    screened = {form.key: screen(fit, form, experiment.training)[0][0] for form in forms}
    ranked = sorted(forms, key=lambda item: screened[item.key])
    first: dict[str, Form] = {}
    for form in ranked:
        first.setdefault(form.effect, form)
    effects = list(first)[:most]
    return [form for form in forms if form.effect in effects and (all_forms or form is first[form.effect])]


def pairs(
    base: Candidate, singles: list[Candidate], catalogue: dict[str, Effect], experiment: Experiment
) -> list[Candidate]:
    """Pairs of effects that begin with one of the best single ones, best first.

    Further first effects are not tried once a pair leaves nothing but noise; `exchange` looks for others like it.
    """
    found: list[Candidate] = []
    for first in best_by_effect(singles)[:LOOK_AHEAD]:
        found += extend(first, catalogue, experiment, REFITTED, all_forms=False)
        if any(is_adequate(pair, experiment) for pair in found):
            break
    return sorted(found, key=lambda item: item.score)


def exchange(model: Candidate, catalogue: dict[str, Effect], experiment: Experiment) -> Candidate:
    """Take out each effect in turn and put back whatever then fits best: another form, another effect or it itself."""
    for name in model.effects:
        structure = model.fit.structure.without(name)
        base, parts = model.fit.structure.nonlinear_of(model.fit.nonlinear)
        start = np.concatenate([base, *(parts[form.key] for form in structure.forms)])
        remaining = evaluate(refit(structure, experiment.training, start), experiment)
        best = extend(remaining, catalogue, experiment, EXCHANGED)[0]
        if best.score < model.score - 1.0:
            model = best
    return model
