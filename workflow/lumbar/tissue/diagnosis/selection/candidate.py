"""A set of effects fitted with a base: how well it explains all records, compared with others and with the noise."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy

from lumbar.tissue.diagnosis.fitting import joint_fit, uncertainty
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, shape_bounds
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.noise.input_relation import ModelError, is_related
from lumbar.tissue.diagnosis.noise.noise_floor import autocovariance, prediction_error_filter
from lumbar.tissue.diagnosis.selection.thresholds import MOST_OF_REST, WORTHWHILE, WORTHWHILE_BLIND
from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.form import Form, Place
from lumbar.tissue.models.model_data import FittedParameter
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.structure import Structure

_MAX_LEFT_SHARE = 0.5
"""Largest share of a response's variance that an adequate model leaves if the noise floor is unknown."""
_PREDICTION_ORDER = 12
_UNCERTAIN_VARIANCES = 4.0
"""Largest excess of an unseen squared error over the noise, in variances of the prediction due to the parameters (95 %)."""
ADEQUATE = 1.1
"""Largest ratio of the error to the noise floor of a model that leaves nothing to explain."""
SAME_SCORE = 1e-6
"""Relative difference below which scores are equal: rounding on another processor may change its sign."""
_STUDENT_FREEDOM = 4
"""Degrees of freedom of Student's t for unseen errors."""
_BOUND_SHARE = 1e-3
"""Distance from a bound, as a share of the logarithmic range, within which a parameter counts as at the bound."""
_MIN_CURVED_SHARE = 0.01
"""Smallest share of a law of position, by standard deviation, that is not a straight line over the records' positions."""
_MAX_FALL_SHARE = 0.2
"""Largest fall of the measured force, as a share of its range, while the force before a one-to-one output curve rises."""
_MIN_OPTIMUM_GAIN = 1e-4
"""Smallest relative difference of the squared errors of two optima: fits that end in one optimum differ by less."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fitted set of effects and its errors."""

    fit: Fit
    train_rms: float
    """Free-run simulation error in training, in the output's unit."""
    test_rms: float
    """Free-run simulation error on unseen records, in the output's unit."""
    score: float
    """Minus twice the log-likelihood of all records, up to a constant, plus the logarithm of their size for each parameter
    (Schwarz, Ann. Statist. 6 (1978) 461-464): smaller is better. Unseen errors have Student's t distribution, so that a few
    peaks beyond the range of the training record do not outweigh all other errors."""
    unseen_rms: dict[str, float]
    """Free-run simulation error by unseen record, in the output's unit."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, in the order added."""
        return self.fit.structure.effects

    @property
    def parameters(self) -> int:
        """Number of parameters of the model."""
        return len(self.fit.linear) + len(self.fit.nonlinear)


def evaluate(fit: Fit, experiment: Experiment) -> Candidate:
    """Simulate a fitted model on all records."""
    training, tests = experiment.training, experiment.tests
    simulated = [(item, fit.simulate(item.motion)) for item in tests]
    errors = {item.name: item.error(values) for item, values in simulated}
    unseen = np.concatenate([item.whitened_error(values) for item, values in simulated])
    scale, unlikelihood = _student_scale(unseen), float("-inf")
    if scale > 0:
        unlikelihood = float(np.sum(_loss(unseen, scale))) + 2 * len(unseen) * float(np.log(scale))
    score = training.size * np.log(fit.squared_error / training.size) + unlikelihood
    score += (len(fit.linear) + len(fit.nonlinear)) * np.log(training.size + len(unseen))
    train_rms = training.cache.compute_once(("rms", fit), lambda: fit.rms(training))
    by_record = {name: float(np.sqrt(np.mean(error**2))) for name, error in errors.items()}
    test_rms = float(np.sqrt(np.mean(np.concatenate([*errors.values()]) ** 2)))
    return Candidate(fit, train_rms, test_rms, float(score), by_record)


def fit_base(base: Base, experiment: Experiment) -> Candidate:
    """Fit a base without effects."""
    return evaluate(joint_fit.fit_base(Structure(base), experiment.training), experiment)


def refit(structure: Structure, start: np.ndarray, experiment: Experiment) -> Candidate:
    """Fit a structure, starting from given nonlinear parameters."""
    return evaluate(joint_fit.fit(structure, experiment.training, start), experiment)


def refit_from_starts(model: Candidate, experiment: Experiment) -> Candidate:
    """Fit a model again from every start of its base, because a better optimum may be elsewhere; return the better fit."""
    structure = model.fit.structure
    if not (structure.is_linear and structure.base.nonlinear):
        return model
    acting = model.fit.nonlinear[len(structure.base.nonlinear) :]
    again = joint_fit.fit_base(structure, experiment.training, acting)
    is_better = again.squared_error < model.fit.squared_error * (1 - _MIN_OPTIMUM_GAIN)
    return evaluate(again, experiment) if is_better else model


def add_form(model: Candidate, form: Form, experiment: Experiment) -> Candidate:
    """Refit a model with one more form."""
    return evaluate(joint_fit.add(model.fit, form, experiment.training), experiment)


def drop_effect(model: Candidate, name: str, experiment: Experiment) -> Candidate:
    """Refit a model without one of its effects."""
    others = tuple(form for form in model.fit.structure.forms if form.effect != name)
    rest = select_forms(model.fit, others)
    return refit(rest.structure, rest.nonlinear, experiment)


def exchange_base(model: Candidate, base: Base, experiment: Experiment) -> Candidate:
    """Refit the effects of a model with another base."""
    structure = model.fit.structure
    bare = joint_fit.fit_base(Structure(base), experiment.training)
    acting = model.fit.nonlinear[len(structure.base.nonlinear) :]
    return refit(Structure(base, structure.forms), np.concatenate([bare.nonlinear, acting]), experiment)


def select_forms(fit: Fit, forms: Sequence[Form]) -> Fit:
    """Return a fit with some of its forms, or with all in another order, without a change of parameters."""
    structure = fit.structure
    sizes = [len(structure.base.linear), *(len(form.linear) for form in structure.forms)]
    first, *parts = np.split(fit.linear, np.cumsum(sizes)[:-1])
    linear = {form.key: part for form, part in zip(structure.forms, parts, strict=True)}
    base, nonlinear = structure.nonlinear_of(fit.nonlinear)
    return replace(
        fit,
        structure=Structure(structure.base, tuple(forms)),
        linear=np.concatenate([first, *(linear[form.key] for form in forms)]),
        nonlinear=np.concatenate([base, *(nonlinear[form.key] for form in forms)]),
    )


def order_effects(model: Candidate, names: Iterable[str]) -> Candidate:
    """Return a model with its effects in another order."""
    forms = {form.effect: form for form in model.fit.structure.forms}
    return replace(model, fit=select_forms(model.fit, [forms[name] for name in names]))


def _student_scale(errors: np.ndarray) -> float:
    """Return the maximum-likelihood scale of Student's t, by expectation and maximisation."""
    square = errors**2
    scale = float(np.median(square)) or float(np.mean(square))
    for _ in range(12):
        if scale <= 0:
            break
        scale = float(np.mean((_STUDENT_FREEDOM + 1) * square / (_STUDENT_FREEDOM + square / scale)))
    return float(np.sqrt(scale))


def _loss(errors: np.ndarray, scale: float) -> np.ndarray:
    """Return minus twice the log-likelihood of Student's t, per error, up to a constant."""
    return (_STUDENT_FREEDOM + 1) * np.log1p((errors / scale) ** 2 / _STUDENT_FREEDOM)


def likelihood_ratio(before: Candidate, after: Candidate, experiment: Experiment) -> float:
    """Return the likelihood-ratio statistic on the training record: twice the gain in log-likelihood."""
    return experiment.training.size * float(np.log(before.fit.squared_error / after.fit.squared_error))


def unseen_improvement(before: Candidate, after: Candidate, experiment: Experiment) -> float:
    """Return the number of standard errors by which the loss on unseen records falls; see `loss_improvement`."""
    return loss_improvement(before.fit, after.fit, experiment.tests)


def loss_improvement(before: Fit, after: Fit, records: list[FitData]) -> float:
    """Return the number of standard errors by which the loss on some records falls.

    The result is the mean difference of losses over its standard error, with dependence over √samples neighbouring samples
    (Diebold and Mariano, J. Bus. Econ. Stat. 13 (1995) 253-263). The loss is that of Student's t, because a mean of squared
    errors depends on a few peaks of an extrapolated force, and no difference is then significant.
    """
    errors = [(before.whitened_errors(record), after.whitened_errors(record)) for record in records]
    scale = min(_student_scale(np.concatenate(by_fit)) for by_fit in zip(*errors, strict=True))
    if scale <= 0:
        return np.inf
    differences = [_loss(first, scale) - _loss(second, scale) for first, second in errors]
    size = sum(len(item) for item in differences)
    mean = sum(float(item.sum()) for item in differences) / size
    sums = (uncertainty.bartlett_sum(item[:, None] - mean, float(np.sqrt(size))) for item in differences)
    variance = float(sum(item[0, 0] for item in sums))
    if variance <= 0:
        return 0.0 if mean == 0 else float(np.copysign(np.inf, mean))
    return mean * size / float(np.sqrt(variance))


def is_adequate(candidate: Candidate, experiment: Experiment, factor: float = ADEQUATE) -> bool:
    """Return whether the errors are within a factor of the noise floor plus the other errors of a right model.

    Without a floor, the model must explain at least half of the variance of every record that moves and leave white noise: an
    autoregressive model (Yule–Walker) must not predict its error better than by this factor. On unseen records the part of the
    error that the parameters' uncertainty explains does not count.
    """
    if experiment.floor is None:
        for record in (experiment.training, *experiment.tests):
            errors = candidate.fit.errors(record)
            # The force of a record that rests is noise, all of which a right model leaves.
            moving = record if np.ptp(record.trim(record.motion.position)) > 0 else experiment.training
            if np.mean(errors**2) > _MAX_LEFT_SHARE * np.var(moving.trim(moving.force)):
                return False
            if _predictability(errors) <= factor:
                continue
            if record is experiment.training:
                return False
            unpredicted = uncertainty.unpredicted_errors(candidate.fit, experiment.training, record)
            if _predictability(unpredicted) > factor:
                return False
        return True
    floor, training, tests = experiment.floor, experiment.training, experiment.tests

    def largest(records: list[FitData]) -> float:
        scatter = max(factor, floor.largest_ratio(sum(item.size for item in records)))
        return scatter * float(np.hypot(floor.rms, experiment.extra_floor_rms))

    if candidate.train_rms > largest([training]):
        return False
    if candidate.test_rms <= largest(tests):
        return True
    left = candidate.test_rms**2 - largest(tests) ** 2
    return left <= _UNCERTAIN_VARIANCES * uncertainty.prediction_variance(candidate.fit, training, tests)


def _predictability(errors: np.ndarray) -> float:
    """Return the ratio of errors to those of their autoregressive prediction; about 1 if they are white."""
    size, order = len(errors), min(_PREDICTION_ORDER, len(errors) // 20)
    _, gained = prediction_error_filter(autocovariance(errors, order) / size)
    # White noise gains by chance one part in its size for each coefficient.
    return float(np.sqrt(max(gained * (1 - order / size), 1.0)))


def leaves_noise(candidate: Candidate, experiment: Experiment, factor: float = ADEQUATE) -> bool:
    """Return whether a model is adequate, or its errors on all records have no relation to the input and explain little force.

    Noise that differs from period to period or is coloured, e.g. hum, spikes or a wandering zero, then exceeds the floor.
    """
    if is_adequate(candidate, experiment, factor):
        return True
    records = (*experiment.training.records, *experiment.tests)
    one_way = experiment.is_one_way  # a single ramp or hold cannot show a relation
    if experiment.points or one_way or not all(isinstance(record.motion, Motion) for record in records):
        return False
    errors = [ModelError(candidate.fit.errors(item), item.motion, item.first) for item in records]
    if any(
        np.mean(error.values**2) > _MAX_LEFT_SHARE * np.var(item.trim(item.force))
        for error, item in zip(errors, records, strict=True)
    ):
        return False
    return is_related(errors) is False


def is_worthwhile(base: Candidate, before: Candidate, after: Candidate, experiment: Experiment) -> bool:
    """Return whether a larger model explains more than the slight error of the smaller model's form.

    This is true if the larger model leaves only noise, or removes a share of the explainable error of the base without effects,
    or most of the explainable error of the smaller model (`lumbar.tissue.diagnosis.selection.thresholds`).
    """
    if is_adequate(after, experiment):
        return True
    floor = experiment.noise
    share = WORTHWHILE if floor else WORTHWHILE_BLIND
    of_base, of_rest = (max(item.train_rms**2 - floor**2, 0.0) for item in (base, before))
    removed = before.train_rms**2 - after.train_rms**2
    return removed >= max(min(share * of_base, MOST_OF_REST * of_rest), floor**2)


def best_by_effect(candidates: list[Candidate]) -> list[Candidate]:
    """Return the best form of every set of effects, best first."""
    best: dict[frozenset[str], Candidate] = {}
    for candidate in sorted(candidates, key=lambda item: item.score):
        best.setdefault(frozenset(candidate.effects), candidate)
    return list(best.values())


def sort_by_score(candidates: list[Candidate]) -> list[Candidate]:
    """Sort candidates by score, the best first; candidates with equal scores (`SAME_SCORE`) by the names of their effects."""
    ordered: list[Candidate] = []
    equal: list[Candidate] = []
    for item in sorted(candidates, key=lambda item: item.score):
        if equal and item.score - equal[0].score > SAME_SCORE * abs(equal[0].score):
            ordered += sorted(equal, key=lambda item: item.effects)
            equal = []
        equal.append(item)
    return ordered + sorted(equal, key=lambda item: item.effects)


def contradictions(fit: Fit, experiment: Experiment) -> list[str]:
    """Return the contradictions between a fitted model and the names of its effects, one sentence each.

    - No force that an effect adds differs significantly from 0, neither one force nor all together; if the form names essential
      forces, only these count.
    - A law of position is a straight line over the records' positions, or an output curve would have to bend back.
    - A parameter that decides whether the mechanism exists is at the end of its range.
    - The form itself rejects its parameters (`Form.contradiction`): a limit that the record exceeds, less than two cycles of a
      disturbance, or a frequency on the grid of the excitation.
    - Nothing is left of the base.
    """
    structure, training = fit.structure, experiment.training
    count = len(structure.base.linear)
    sentences = []
    if count and structure.base.system == "tissue" and not np.any(fit.linear[:count] > 0):
        sentences.append(f"nothing is left of {structure.base.name}: all its stiffnesses are 0")
    known = uncertainty.estimates(fit, training, experiment.input_unit, experiment.output_unit)
    low, high = shape_bounds(structure, training, fit.nonlinear) if len(fit.nonlinear) else ((), ())
    position = len(structure.base.nonlinear)
    for form in structure.forms:
        parameters = [item for item in known if item.effect == form.effect]
        if _is_neutral(form, parameters, fit, training):
            names = form.essential or tuple(item.name for item in form.linear)
            sentences.append(f"{form.effect}: the interval of {', '.join(names)} holds 0")
        elif _is_straight(form, parameters, fit, experiment):
            sentences.append(f"{form.effect}: its force is that of a linear spring in these records")
        elif form.place is Place.OUTPUT and form.is_static and _falls_behind(fit, experiment):
            sentences.append(f"{form.effect}: the {experiment.output_quantity} falls where its force rises")
        for shape in form.nonlinear:
            if shape.decisive:
                value, least, most = fit.nonlinear[position], low[position], high[position]
                if min(np.log(value / least), np.log(most / value)) < _BOUND_SHARE * np.log(most / least):
                    sentences.append(f"{form.effect}: {shape.name} is at the end of its range")
            position += 1
        if form.contradiction is not None:
            values = {item.name: item.value for item in parameters}
            sentences += _form_contradiction(form, values, fit, experiment)
    return sentences


def is_neutral(fit: Fit, experiment: Experiment) -> bool:
    """Return whether no essential force of an effect differs from 0: the model is then a simpler one under another name."""
    known = uncertainty.estimates(fit, experiment.training, experiment.input_unit, experiment.output_unit)
    return any(
        _is_neutral(form, [item for item in known if item.effect == form.effect], fit, experiment.training)
        for form in fit.structure.forms
        if form.essential
    )


def _is_neutral(form: Form, parameters: list[FittedParameter], fit: Fit, training: FitData) -> bool:
    """Return whether none of the forces that decide whether a form acts differs significantly from 0."""
    names = form.essential or tuple(item.name for item in form.linear)
    sizes = [item for item in parameters if item.name in names]
    if not sizes or any(item.low > 0 or item.high < 0 for item in sizes):
        return False
    return len(sizes) == 1 or not _are_jointly_significant(form, names, fit, training)


def _is_straight(form: Form, parameters: list[FittedParameter], fit: Fit, experiment: Experiment) -> bool:
    """Return whether the force of a law of position is a straight line over the positions of all records."""
    if form.axes or form.place is not Place.PARALLEL or not form.is_static:
        return False
    motions = [item.motion for item in (*experiment.training.records, *experiment.tests)]
    _, nonlinear = fit.structure.nonlinear_of(fit.nonlinear)
    columns = np.hstack([form.columns(motion, nonlinear[form.key]) for motion in motions])
    force = np.array([item.value for item in parameters[: len(form.linear)]]) @ columns
    position = np.concatenate([motion.position for motion in motions])
    line = np.polynomial.Polynomial.fit(position, force, 1)
    return bool(np.std(force - line(position)) <= _MIN_CURVED_SHARE * np.std(force))


def _falls_behind(fit: Fit, experiment: Experiment) -> bool:
    """Return whether the measured force falls while the force before the output forms rises: no one-to-one curve does that."""
    for data in (*experiment.training.records, *experiment.tests):
        inner = fit.structure.design(data.motion, fit.nonlinear) @ fit.linear
        outer = fit.structure.simulate(data.motion, fit.linear, fit.nonlinear)
        if np.any(np.diff(outer) * np.diff(inner) < -1e-9 * np.ptp(outer) * np.ptp(inner)):
            return False  # the curve itself falls, as an absolute value does
        least = _MAX_FALL_SHARE * float(np.ptp(data.force))
        direction = np.sign(np.diff(inner))
        starts = [0, *(np.flatnonzero(np.diff(direction)) + 1), len(direction)]
        for first, last in pairwise(starts):
            measured = direction[first] * data.force[first : last + 1]
            if np.max(np.maximum.accumulate(measured) - measured) > least:
                return True
    return False


def _are_jointly_significant(form: Form, names: tuple[str, ...], fit: Fit, training: FitData) -> bool:
    """Return whether several amplitudes together are significantly not 0, by Wald's test: similar forces hide each other."""
    owners = [form for form in fit.structure.forms for _ in form.linear]
    items = fit.structure.linear[len(fit.structure.base.linear) :]
    mine = [index for index, item in enumerate(items) if owners[index] is form and item.name in names]
    chosen = np.array(mine) + len(fit.structure.base.linear)
    scaled, size = uncertainty.scaled_covariance(fit, training)
    amplitudes = fit.linear[chosen] * size[chosen]
    wald = amplitudes @ np.linalg.pinv(scaled[np.ix_(chosen, chosen)], rcond=1e-12) @ amplitudes
    return bool(wald > scipy.special.chdtri(len(chosen), 0.05))


def _form_contradiction(form: Form, values: dict[str, float], fit: Fit, experiment: Experiment) -> list[str]:
    """Return the contradictions that a form detects in its parameters, by training record."""
    training, floor = experiment.training, experiment.floor
    noise, period = (floor.rms, floor.period) if floor else (fit.rms(training), None)
    motions = (training.motion,) if isinstance(training.motion, Motion) else training.motion.parts
    forces = [training.force] if len(motions) == 1 else training.motion.split(training.force)
    zeros = fit.zeros if len(fit.zeros) == len(motions) else [fit.zero] * len(motions)
    axes = form.axes or [""] * len(motions)
    for motion, force, zero, axis in zip(motions, forces, zeros, axes, strict=True):
        along = values | {name.removesuffix(f"_{axis}"): value for name, value in values.items()}
        if axis in (form.channel or axis):
            reason = form.contradiction(along, motion, force - zero, noise, period)
            if reason:
                return [f"{form.effect}: {reason}"]
    return []
