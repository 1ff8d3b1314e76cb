"""What explains records as well as missing effects do: moved zeros, linear dynamics of higher order, a force that leads."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base as fit_structure
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates, zero_interval
from lumbar.tissue.diagnosis.selection.base_choice import SEARCH
from lumbar.tissue.diagnosis.selection.candidate import (
    Candidate,
    evaluate,
    fit_base,
    is_adequate,
    refit,
    unseen_improvement,
    with_forms,
)
from lumbar.tissue.diagnosis.selection.forward_selection import find_ties
from lumbar.tissue.diagnosis.selection.result import DiagnosisState, Status, run
from lumbar.tissue.diagnosis.selection.sentences import effects_text
from lumbar.tissue.diagnosis.selection.thresholds import EXPLAINS, TIED, UNSEEN
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.form import Form
from lumbar.tissue.models.structure import Structure

_NONLINEAR = 0.1
"""Smallest significant nonlinear share of the error of the best linear model if something nonlinear is missing."""
_ZEROS_HELP = 0.9
"""Factor on the unseen error below which one zero per record is used."""
_START = 3
"""Samples that a record's beginning has at least."""
_BESIDE, _UNSURE = 0.1, 2.5
"""Distance between the zero at a record's beginning and over all of it, up to which it is one zero: a share of its shift, and
standard errors of the beginning's median."""
_NOTABLE = 0.01
"""Share of the response's range above which a sensor's zero is reported."""
_LEAD_BASES = ("LE", "KB")
"""Bases with which a lead is searched: the dashpots of the others can replace one."""
_LEAD_SAMPLES = (5, 14, 23)
"""Longest lead that is searched first, and next if it may be longer: a delay spans ten samples."""
_LEAD_ROOM = 4
"""Ratio of the samples that must count in every record to the longest lead."""
_LEAD_LEAST = 0.2
"""Samples of delay up to which the lead may be longer."""
_LEAD_STARTS = (4.0, 1.5)
"""Samples that the search for the delay begins at."""


def compare_zeros(state: DiagnosisState) -> DiagnosisState:
    """Search again with one zero per record, if the model or a smaller one does much better with them.

    Where zeros differ between records, an effect that accumulates (a drift) may be mistaken for the difference. If they do not
    differ, a model that lacks a relaxation seems to have different zeros too: a zero counts only if its record begins with it.
    """
    step, experiment = "compare zeros", state.experiment
    if experiment.has_own_zeros:
        return state.next(step, "not needed: every record has a zero already")
    with_zeros = experiment.allow_own_zeros()

    def helps(item: Candidate) -> bool:
        refitted = refit(item.fit.structure, item.fit.nonlinear, with_zeros)
        return refitted.test_rms < _ZEROS_HELP * item.test_rms

    accumulating = any(state.settings.candidates[name].accumulates for name in state.selected)
    if not (accumulating or any(helps(item) for item in state.path)):
        return state.next(
            step, "one zero serves all records: others hardly lower the error on unseen records"
        )
    trial = state.next(
        step,
        "base and effects are searched again with one zero per record",
        experiment=with_zeros,
        status=None,
    )
    again = run((*SEARCH, find_ties), trial)
    own, shared = again.model.test_rms, state.model.test_rms
    errors = (
        f"{own:.4g} {experiment.output_unit} unseen with one zero per record, {shared:.4g} with one for all"
    )
    better = again.model.test_rms < _ZEROS_HELP * state.model.test_rms
    simpler = len(again.selected) < len(state.selected)
    as_good = again.model.test_rms < state.model.test_rms / _ZEROS_HELP
    if not (better or (simpler and as_good)):
        return state.next(step, f"one zero serves all records: {errors}")
    if zeros_moved(again):
        return again.next(step, f"the zeros moved between the records, which begin with them: {errors}")
    refined = Status.UNEXPLAINED if state.refined_status == Status.ADEQUATE else state.refined_status
    apparent = f"the zeros only seem to have moved, for records do not begin with them: {errors}"
    if set(state.selected) == set(again.selected):
        return state.next(step, apparent, apparent_zeros(again), refined_status=refined)
    reason = f"{apparent}; with them {effects_text(again.selected)} would be selected"
    changes = {"status": Status.UNEXPLAINED, "tied_with": [], "refined_status": refined}
    return state.next(step, reason, apparent_zeros(again), **changes)


def compare_with_linear_dynamics(state: DiagnosisState) -> DiagnosisState:
    """Compare the model with linear dynamics of higher order.

    If these explain more and leave nothing nonlinear, only linear effects are searched. If they leave something nonlinear, no
    effect of the catalogue explains it.
    """
    step, experiment, candidates = "compare with linear dynamics", state.experiment, state.settings.candidates
    only_linear = bool(state.selected) and all(candidates[name].linear for name in state.selected)
    if is_adequate(state.model, experiment) and not only_linear:
        return state.next(step, "not needed: the model leaves only noise")
    alternative = linear_alternative(state.model, experiment)
    if alternative is None:
        return state.next(step, "linear dynamics of higher order do not explain the records better")
    from lumbar.tissue.diagnosis.linear.linear_dynamics import nonlinear_share
    from lumbar.tissue.diagnosis.linear.poles import linear_base

    dynamics, finding = alternative
    base = linear_base(dynamics.fit.poles, dynamics.fit.held)
    linear = base and fit_base(base, experiment)
    errors = f"{dynamics.test_rms:.4g} {experiment.output_unit} unseen, the model {state.model.test_rms:.4g}"
    unexplained = {"status": Status.UNEXPLAINED, "tied_with": [], "linear": linear}
    if (nonlinear_share(experiment, dynamics.fit) or 0.0) > _NONLINEAR:
        reason = f"linear dynamics explain more ({errors}), and what they leave is nonlinear"
        return state.next(step, reason, finding, **unexplained)
    only = {name: effect for name, effect in candidates.items() if effect.linear}
    again = state
    if not set(state.selected) <= set(only):
        reason = f"linear dynamics explain more ({errors}) and leave nothing nonlinear: linear effects are searched"
        trial = state.next(step, reason, settings=replace(state.settings, catalogue=only), status=None)
        again = run((*SEARCH, find_ties), trial)
        if linear_alternative(again.model, experiment) is None:
            reason = f"linear effects explain the records as well as linear dynamics: {effects_text(again.selected)}"
            return again.next(step, reason, finding, settings=state.settings)
    reason = f"linear dynamics explain more than any effects of the catalogue: {errors}"
    return again.next(step, reason, finding, settings=state.settings, **unexplained)


def check_lead(state: DiagnosisState) -> DiagnosisState:
    """Check whether a force that leads explains more than the selected linear effects: no mechanism does that."""
    step, model = "check lead", state.model
    linear = {name for name in state.selected if state.settings.candidates[name].linear}
    finding = force_leads(model, state.experiment, linear)
    if finding is None:
        return state.next(step, "no lead of the force explains the records better")
    reason = f"a force that leads by {1e3 * finding.value:.3g} ms explains the records better"
    if not linear and is_adequate(model, state.experiment):
        return state.next(step, f"{reason}, but the model leaves only noise", finding)
    return state.next(step, reason, finding, status=Status.UNEXPLAINED, tied_with=[])


def report_zeros(state: DiagnosisState) -> DiagnosisState:
    """Report where the zeros of the sensors are, if that matters."""
    findings = report_offsets(state)
    kinds = ", ".join(item.kind.replace("_", " ") for item in findings)
    return state.next("report zeros", kinds or "the zeros are where the records say", *findings)


def report_offsets(state: DiagnosisState) -> list[Finding]:
    """Report the zeros of the sensors that are significantly not 0."""
    experiment, fit = state.experiment, state.model.fit
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
    if experiment.has_own_zeros and fit.structure.base.sensor_zero:
        findings += _report_own_zeros(state)
    return findings


def position_offset(experiment: Experiment) -> list[Finding]:
    """Report the position from which positions are counted, if no record comes near 0."""
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
    """Zero of an unseen record for a model that was fitted to others."""

    name: str
    zero: float
    begins: float
    """Zero that the record's first samples have, before its motion tells."""
    first: int
    """Number of these."""
    rms: float
    """Error from its own zero, and from that of training."""
    strict_rms: float


def _zeros(state: DiagnosisState) -> list[_Zero]:
    fit = state.model.fit
    zeros = []
    for item in state.experiment.tests:
        error = item.force - fit.simulate(item.motion)
        counted, start = item.trim(error), error[item.begins : max(item.first, item.begins + _START)]
        values = (fit.zero + float(value) for value in (counted.mean(), np.median(start)))
        sizes = float(counted.std()), float(np.sqrt(np.mean(counted**2)))
        zeros.append(_Zero(item.name, *values, len(start), *sizes))
    return zeros


def zeros_moved(state: DiagnosisState) -> bool:
    """Return whether records begin with the zeros that were fitted to them, within the noise, and not with that of training."""
    zeros, zero = _zeros(state), state.model.fit.zero
    away = np.array([item.begins - item.zero for item in zeros])
    shifts = np.array([item.zero - zero for item in zeros])
    noise = state.experiment.noise / np.sqrt([item.first for item in zeros])
    return bool(np.linalg.norm(away) < _BESIDE * np.linalg.norm(shifts) + _UNSURE * np.linalg.norm(noise))


def apparent_zeros(state: DiagnosisState) -> Finding:
    """Report the zeros that a model which lacks something would give the records; they do not begin there."""
    unit, zero = state.experiment.output_unit, state.model.fit.zero
    words = ", ".join(
        f"{item.name} {item.zero:+.3g} (begins at {item.begins:+.3g})" for item in _zeros(state)
    )
    sentence = (
        f"With a separate zero for every record the error on unseen records would be {state.model.test_rms:.3g} {unit}: {words}, "
        f"in {state.experiment.training.name} {zero:+.3g} {unit}. The records do not begin there, so these may not be zeros of "
        "the sensor: a relaxation or a force that depends on rate or amplitude, which the model lacks, would look the same; all "
        "records are judged from one zero."
    )
    return Finding("apparent_zeros", sentence, zero, unit)


def _report_own_zeros(state: DiagnosisState) -> list[Finding]:
    unit, quantity = state.experiment.output_unit, state.experiment.output_quantity
    training = state.experiment.training.name
    return [
        Finding(
            "force_offset",
            f"{item.name}: the zero of the {quantity} is at {item.zero:+.3g} {unit}, in {training} at "
            f"{state.model.fit.zero:+.3g} {unit}: it moved between the records, and this one begins there. The error from its "
            f"own zero is {item.rms:.3g} {unit}, from that of {training} {item.strict_rms:.3g} {unit}.",
            item.zero,
            unit,
            item.name,
        )
        for item in _zeros(state)
    ]


def linear_alternative(model: Candidate, experiment: Experiment) -> tuple[Candidate, Finding] | None:
    """Return a linear model of higher order that explains all records significantly better than a selected one, and its finding.

    By likelihood and number of parameters, and by the loss on unseen records; None if there is no such model. Lost contact is
    never linear, and a model that explains the records with as few states is not replaced by one without names.
    """
    if model.fit.structure.base.contact:
        return None
    from lumbar.tissue.diagnosis.linear.linear_dynamics import linear_dynamics

    linear = evaluate(linear_dynamics(experiment), experiment)
    if unseen_improvement(model, linear, experiment) <= UNSEEN or linear.score >= model.score - TIED:
        return None
    unit, order = experiment.output_unit, linear.fit.order
    structure = model.fit.structure
    states = len(structure.base.form.state) + sum(len(form.state) for form in structure.forms)
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


def force_leads(model: Candidate, experiment: Experiment, linear: set[str]) -> Finding | None:
    """Report by how much the force leads, if that explains all records significantly better than the selected model.

    The force is delayed, so that a delay remains between position and force. The effects `linear` are left out of this model:
    dashpots, masses and branches can replace a lead.
    """
    base = model.fit.structure.base
    replaced = linear & set(model.effects)
    if (
        base.contact
        or base.is_user_defined
        or not (replaced or base.name == "KV" or not is_adequate(model, experiment))
    ):
        return None
    kept = [form for form in model.fit.structure.forms if form.effect not in replaced | {"delay"}]
    shortest = min(data.size for data in (*experiment.training.records, *experiment.tests))
    for samples in (number for number in _LEAD_SAMPLES if _LEAD_ROOM * number <= shortest):
        put_late = experiment.change_data(partial(_delay_force, samples=samples, longest=samples))
        best = _fit_with_delay(model, kept, put_late)
        units = experiment.input_unit, experiment.output_unit
        late = next(item for item in estimates(best.fit, put_late.training, *units) if item.effect == "delay")
        step = experiment.training.motion.sampling_time
        if late.low > 0 and late.value > _LEAD_LEAST * step:
            break
    else:
        return None  # longer than the search allows: its size cannot be found
    first = samples * step
    same = experiment.change_data(partial(_delay_force, samples=0, longest=samples))
    rival = refit(model.fit.structure, model.fit.nonlinear, same)
    likelier = best.score < rival.score - (TIED if best.parameters >= rival.parameters else 0)
    # If another effect is missing a lead may help a little: it is reported only if nothing is left.
    whole = (
        is_adequate(best, put_late)
        if experiment.floor
        else best.test_rms**2 < (1 - EXPLAINS) * rival.test_rms**2
    )
    if not (best.fit.converged and likelier and whole and late.high < first):
        return None
    low, lead, high = (1e3 * (first - value) for value in (late.high, late.value, late.low))
    position, unit = experiment.input_quantity, experiment.output_unit
    lead_only = effects_text([best.fit.structure.base.name, *(form.effect for form in kept)])
    sentence = (
        f"The {experiment.output_quantity} leads the {position} by {lead:.3g} ms (95 % interval {low:.3g} to {high:.3g}): with "
        f"only this lead added to {lead_only}, the error on unseen records is {best.test_rms:.4g} {unit}, that of the selected "
        f"model {rival.test_rms:.4g} {unit}. No tissue responds before it is moved: the clocks of the channels differ, or the "
        f"{position} is delayed by its sensor or filter; put both channels on one clock and diagnose again, because selected "
        "dashpots, masses and branches may only stand in for the lead."
    )
    return Finding("force_leads", sentence, lead / 1e3, "s")


def _fit_with_delay(model: Candidate, kept: list[Form], put_late: Experiment) -> Candidate:
    """Fit the likeliest base with a delay and with effects of the model."""
    (delay,) = TISSUE["delay"].forms
    acting = with_forms(model.fit, kept).nonlinear[len(model.fit.structure.base.nonlinear) :]
    step = put_late.training.motion.sampling_time
    fits = (
        fit_structure(Structure(BASES[name], (*kept, delay)), put_late.training, [*acting, samples * step])
        for name in _LEAD_BASES
        for samples in _LEAD_STARTS
    )
    return min((evaluate(fit, put_late) for fit in fits), key=lambda item: item.score)


def _delay_force(data: FitData, samples: int, longest: int) -> FitData:
    """Return the record with its force delayed by `samples`; the first `longest` samples do not count."""
    force = np.concatenate([np.repeat(data.force[:1], samples), data.force[: len(data.force) - samples]])
    return replace(data, force=force, settling=data.settling + longest)
