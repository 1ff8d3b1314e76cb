"""What a diagnosis finds beside missing effects: zeros of the sensors, linear dynamics, records that differ, rates."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import zero_interval
from lumbar.tissue.diagnosis.selection.candidate import (
    Candidate,
    drop_effect,
    evaluate,
    is_adequate,
    refit,
    unseen_improvement,
)
from lumbar.tissue.diagnosis.selection.forward_selection import extend
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult, Status, effects_text
from lumbar.tissue.diagnosis.selection.thresholds import COMPLETE, TIED, UNSEEN
from lumbar.tissue.models.form import Effect
from lumbar.tissue.signals.spectrum import occupied_band

_START = 3
"""Samples that a record's beginning has at least."""
_BESIDE, _UNSURE = 0.1, 2.5
"""Distance between the zero at a record's beginning and over all of it, up to which it is one zero: a share of its shift, and
standard errors of the beginning's median."""
_NOTABLE = 0.01
"""Share of the response's range from which on a sensor's zero is worth a word."""
FAR = 2.0
"""Error of an unseen record, in noise floors, that a model which leaves only noise in training should not have."""
_STRETCHES = 4
_FALLING = -0.9
"""Rank correlation of the stiffnesses of all stretches with their order, up to which they fall all along."""
_MOVES = 0.2
"""Share of a record's range that a stretch must move over."""
_FALL = 0.01
"""Share of the stiffness by which it falls at least."""


def offsets(found: DiagnosisResult) -> list[Finding]:
    """What the zeros of the sensors are, where they are worth a word."""
    experiment, fit = found.experiment, found.model.fit
    unit, quantity = experiment.output_unit, experiment.output_quantity
    findings = []
    if fit.structure.base.contact:
        sentence = (
            f"The tool is not fastened to the tissue: it meets the surface at {experiment.surface:.4g} {experiment.input_unit}. "
            "Depths are counted from there."
        )
        findings.append(Finding("surface", sentence, experiment.surface, experiment.input_unit))
    else:
        findings += position_offset(experiment)
    low, high = zero_interval(fit, experiment.training)
    notable = _NOTABLE * float(np.ptp(experiment.training.force))
    if abs(fit.zero) > notable and (low > 0 or high < 0):
        sentence = (
            f"The zero of the {quantity} is at {fit.zero:+.3g} {unit} (95 % interval {low:.3g} to {high:.3g}), or the zero of "
            f"the {experiment.input_quantity} is off by an amount that causes it. It was fitted with the model and subtracted."
        )
        findings.append(Finding("force_offset", sentence, fit.zero, unit, experiment.training.name))
    if experiment.own_zeros and fit.structure.base.sensor_zero:
        findings += _own_zeros(found)
    return findings


def position_offset(experiment: Experiment) -> list[Finding]:
    """From where positions are counted, where no record comes near 0."""
    if not any(experiment.rest):
        return []
    unit, size = experiment.input_unit, float(np.linalg.norm(experiment.rest))
    at = ", ".join(f"{value:.5g}" for value in experiment.rest)
    at = f"({at})" if len(experiment.rest) > 1 else at
    sentence = (
        f"The records are farther from {experiment.input_quantity} 0 than their whole range. Positions are counted from {at} "
        f"{unit}, where the records begin or about which they move; effects that depend on position count from there."
    )
    return [Finding("position_offset", sentence, size, unit)]


@dataclass(frozen=True)
class _Zero:
    """The zero that an unseen record has under a model that was fitted to others."""

    name: str
    zero: float
    begins: float
    """Zero that the record's first samples have, before its motion tells."""
    first: int
    """Number of these."""
    rms: float
    """Error from its own zero, and from that of training."""
    strict_rms: float


def _zeros(found: DiagnosisResult) -> list[_Zero]:
    fit = found.model.fit
    zeros = []
    for item in found.experiment.tests:
        error = item.force - fit.simulate(item.motion)
        counted, start = item.trim(error), error[item.begins : max(item.first, item.begins + _START)]
        values = (fit.zero + float(value) for value in (counted.mean(), np.median(start)))
        sizes = float(counted.std()), float(np.sqrt(np.mean(counted**2)))
        zeros.append(_Zero(item.name, *values, len(start), *sizes))
    return zeros


def zeros_moved(found: DiagnosisResult) -> bool:
    """Whether records judged from zeros of their own begin with these, as far as noise allows, and not with that of training."""
    zeros, zero = _zeros(found), found.model.fit.zero
    away = np.array([item.begins - item.zero for item in zeros])
    shifts = np.array([item.zero - zero for item in zeros])
    noise = found.experiment.noise / np.sqrt([item.first for item in zeros])
    return bool(np.linalg.norm(away) < _BESIDE * np.linalg.norm(shifts) + _UNSURE * np.linalg.norm(noise))


def apparent_zeros(found: DiagnosisResult) -> Finding:
    """What zeros records would be given by a model that lacks something, and that they do not begin with them."""
    unit, zero = found.experiment.output_unit, found.model.fit.zero
    words = ", ".join(
        f"{item.name} {item.zero:+.3g} (begins at {item.begins:+.3g})" for item in _zeros(found)
    )
    sentence = (
        f"With a separate zero for every record the error on unseen records would be {found.model.test_rms:.3g} {unit}: {words}, "
        f"in {found.experiment.training.name} {zero:+.3g} {unit}. The records do not begin there, so these may not be zeros of "
        "the sensor: a relaxation or a force that depends on rate or amplitude, which the model lacks, would look the same; all "
        "records are judged from one zero."
    )
    return Finding("apparent_zeros", sentence, zero, unit)


def _own_zeros(found: DiagnosisResult) -> list[Finding]:
    unit, quantity = found.experiment.output_unit, found.experiment.output_quantity
    training = found.experiment.training.name
    return [
        Finding(
            "force_offset",
            f"{item.name}: the zero of the {quantity} is at {item.zero:+.3g} {unit}, in {training} at "
            f"{found.model.fit.zero:+.3g} {unit}: it moved between the records, and this one begins there. The error from its "
            f"own zero is {item.rms:.3g} {unit}, from that of {training} {item.strict_rms:.3g} {unit}.",
            item.zero,
            unit,
            item.name,
        )
        for item in _zeros(found)
    ]


def linear_alternative(model: Candidate, experiment: Experiment) -> tuple[Candidate, Finding] | None:
    """Linear model of higher order that explains all records surely better than a selected one, and what it reaches.

    By likelihood and number of parameters, and by the loss on unseen records. None where there is none; contact that is lost is
    never linear, and what explains the records with as few states is not replaced by a model without names.
    """
    if model.fit.structure.base.contact:
        return None
    from lumbar.tissue.diagnosis.linear.linear_dynamics import linear_dynamics

    linear = evaluate(linear_dynamics(experiment), experiment)
    if unseen_improvement(model, linear, experiment) <= UNSEEN or linear.score >= model.score - TIED:
        return None
    unit, order = experiment.output_unit, linear.fit.order
    structure = model.fit.structure
    states = len(structure.base.state) + sum(len(form.state) for form in structure.forms)
    if is_adequate(model, experiment) and order <= states:
        return None
    words = {
        "prony": "a spectrum of relaxation times",
        "rational": f"{order} poles" if order else "of spring, dashpot and mass alone",
        "delayed": f"{order} poles behind a delay",
    }[linear.fit.kind]
    sentence = (
        f"Linear dynamics ({words}) explain these records better than the selected effects: their error on unseen records is "
        f"{linear.test_rms:.3g} {unit}, that of the refined model {model.test_rms:.3g} {unit}."
    )
    return linear, Finding("higher_order_linear", sentence, float(order), "1")


def far_off(found: DiagnosisResult) -> list[str]:
    """Unseen records far above the noise, or what is left in training where that is unknown, of a model that is at it there."""
    experiment, model = found.experiment, found.model
    noise = experiment.noise or model.train_rms
    tissue = model.fit.structure.base.system == "tissue" and not experiment.session and not experiment.points
    if not tissue or model.train_rms > COMPLETE * noise:
        return []
    trained = {item.name for item in experiment.training.records}
    return [name for name, rms in model.unseen_rms.items() if rms > FAR * noise and name not in trained]


def trained_otherwise(found: DiagnosisResult, settings: DiagnosisSettings) -> list[Finding]:
    """The model that was selected, fitted to the records that were unseen, and to all: what each leaves of the others."""
    left = far_off(found)
    if not left:
        return []
    experiment, model = found.experiment, found.model

    def fitted(names: list[str]):
        chosen = replace(settings, train=names).prepare(list(experiment.records))
        return refit(model.fit.structure, model.fit.nonlinear, chosen.with_origin(experiment.surface))

    first = [item.name for item in experiment.training.records]
    unseen = [item.name for item in experiment.tests]
    try:
        turned, joint = fitted(unseen), fitted([*first, *unseen])
    except InputError:
        return []  # too little motion in the others, or another rate: they are no training records
    noise = experiment.noise or model.train_rms
    worst = max(joint.train_rms, joint.test_rms)
    unit, trained, others = experiment.output_unit, " and ".join(first), " and ".join(unseen)
    error = max(model.unseen_rms[name] for name in left)
    outcome = (
        "so one set of parameters describes all records: fit them together with --train"
        if worst <= FAR * noise
        else "so no single set of parameters describes all of them"
    )
    sentence = (
        f"Of {trained} only noise is left, of {' and '.join(left)} up to {error:.3g} {unit}; the same model fitted to {others} "
        f"leaves {turned.train_rms:.3g} {unit} there and {turned.test_rms:.3g} {unit} of {trained}, and fitted to all together "
        f"it leaves {worst:.3g} {unit}, {outcome}. What came before a record may matter (softening, wear, slow recovery): use "
        "--session if they were recorded one after another, in the order of their names."
    )
    return [Finding("trained_otherwise", sentence, turned.test_rms, unit)]


def falling_stiffness(experiment: Experiment) -> list[Finding]:
    """That the stiffness falls all along the records, in their order, where it does."""
    records = experiment.records
    if len(records) < 2 or experiment.session or experiment.points:
        return []
    slopes = []
    for record in records:
        parts = zip(*(np.array_split(record[role], _STRETCHES) for role in ("input", "output")), strict=True)
        least = _MOVES * float(np.ptp(record["input"]))
        for position, force in parts:
            if np.ptp(position) < least:
                return []  # a hold tells no stiffness
            moved = position - position.mean()
            slopes.append(float(moved @ force / (moved @ moved)))
    ranks = np.argsort(np.argsort(slopes))
    order = float(np.corrcoef(ranks, np.arange(len(slopes)))[0, 1])
    falls = order <= _FALLING and slopes[-1] < (1 - _FALL) * slopes[0]
    unit = f"{experiment.output_unit}/{experiment.input_unit}"
    sentence = (
        f"The stiffness falls through all records, in the order of their names, from {slopes[0]:.4g} to {slopes[-1]:.4g} {unit}. "
        "If they were recorded one after another on one specimen, use --session: each then begins where the one before it ended."
    )
    return [Finding("falling_stiffness", sentence, slopes[-1], unit)] if falls else []


_APART = 2.0
"""Ratio of the highest to the lowest rate of the motion from which on records tell whether a force depends on it."""
_AS_GOOD = 1.5
"""Error on an unseen record in that of training, each as it is or for its size of force, up to which it is predicted; and of a
rival in that of the model, up to which it stands beside."""
_FUNDAMENTAL = 0.9
"""Share of the power that bounds the rates of a motion: without the overtones of a triangle, which has one rate."""
_RIVALS = ("relaxation_spectrum", "second_relaxation")
_SPRINGS = ("hardening_stiffness", "strain_softening", "quadratic_stiffness")
"""What takes the place of a mechanism that does not ask for the speed: relaxation, alone and beside a spring of large strain."""


_OWN_SIZE = 0.5
"""Share of the error on a record of another rate that another size of the mechanism would remove, from which on that rate
contradicts it; else something else is missing there."""


def whatever_the_speed(
    found: DiagnosisResult, effects: Mapping[str, Effect]
) -> tuple[DiagnosisResult, list[Finding]]:
    """Name a rate-independent mechanism alone only where other rates are predicted without new constants.

    Else it is tied with the relaxations, alone or beside a spring of large strain, that explain the unseen records as well; and
    unexplained where records of other rates contradict it and none of these does. `effects` are all that the records allow.
    """
    named = [name for name in found.selected if effects[name].rate_independent]
    if found.status not in (Status.NAMED, Status.TIED) or not named:
        return found, []
    # Lowest and highest frequency (Hz) of the motion in all records.
    records = [part for item in (found.experiment.training, *found.experiment.tests) for part in item.records]
    bands = [
        occupied_band(part.own(part.motion.position), part.motion.sampling_time, _FUNDAMENTAL)
        for part in records
    ]
    low, high = min(edges[0] for edges in bands), max(edges[1] for edges in bands)
    apart, failed = high >= _APART * low, _not_predicted(found, named)
    if apart and not failed:
        return found, []
    known = {frozenset(item.effects) for item in found.tied_with}
    rivals = [item for item in _rivals(found, named, effects) if frozenset(item.effects) not in known]
    tied = [*found.tied_with, *rivals]
    status = Status.TIED if tied else Status.UNEXPLAINED if apart else Status.NAMED
    if apart:
        kind, sentence = (
            "other_rates_missed",
            f"The constants of {found.experiment.training.name} do not predict records at other rates: {' and '.join(failed)} "
            f"(rates from {low:.3g} to {high:.3g} Hz). The records thus do not show that {effects_text(named)} acts at every "
            "speed; relaxation on many time scales and springs of large strain were tried instead.",
        )
    else:
        kind, sentence = (
            "one_rate",
            f"All records move at nearly one rate ({low:.3g} to {high:.3g} Hz), so they do not show that {effects_text(named)} "
            "acts at every speed. Repeat the same path ten times as fast or as slowly.",
        )
    finding = Finding(kind, sentence, high / low, "1")
    return replace(found, status=status, tied_with=tied), [finding]


def _not_predicted(found: DiagnosisResult, named: list[str]) -> list[str]:
    """Unseen records with an error far above that of training, also for its force, that other sizes of these would remove."""
    model, experiment = found.model, found.experiment
    least = max(model.train_rms, experiment.noise)

    def size(data: FitData) -> float:
        return float(np.std(data.trim(data.force)))

    own = size(experiment.training)
    return [
        item.name
        for item in experiment.tests
        if model.unseen_rms[item.name] > _AS_GOOD * least * max(1.0, size(item) / own)
        and _removed_by_size(model.fit, named, item) > _OWN_SIZE
    ]


def _removed_by_size(fit: Fit, named: list[str], data: FitData) -> float:
    """Share of the squared error on a record that the named effects' force removes at a size of its own."""
    of_base = np.zeros(len(fit.structure.base.linear), dtype=bool)
    of_forms = [np.full(len(form.linear), form.effect in named) for form in fit.structure.forms]
    larger = fit.linear * np.where(np.concatenate([of_base, *of_forms]), 2.0, 1.0)
    force = fit.structure.simulate(data.motion, larger, fit.nonlinear) + fit.zero - fit.simulate(data.motion)
    error = data.trim(data.force - fit.simulate(data.motion))
    part = data.trim(force)
    error, part = error - error.mean(), part - part.mean()
    return float((error @ part) ** 2 / max((error @ error) * (part @ part), 1e-300))


def _rivals(found: DiagnosisResult, named: list[str], effects: Mapping[str, Effect]) -> list[Candidate]:
    """Relaxations in the place of the mechanism, the best alone and beside a spring, that come near on unseen records."""
    experiment, start = found.experiment, found.model
    for name in named:
        start = drop_effect(start, name, experiment)
    relaxing, springs = (
        {name: effects[name] for name in names if name in effects} for names in (_RIVALS, _SPRINGS)
    )
    alone = extend(start, relaxing, experiment)[:1]
    beside = [item for model in alone for item in extend(model, springs, experiment)[:1]]
    return [item for item in alone + beside if item.test_rms <= _AS_GOOD * found.model.test_rms]
