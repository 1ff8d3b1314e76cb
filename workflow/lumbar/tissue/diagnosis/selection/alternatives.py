"""Alternatives to missing effects: zeros that moved, linear dynamics of higher order, a force that leads."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lumbar.base.formats import plural
from lumbar.records.rests import begins_at_rest
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base as fit_structure
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates, scaled_covariance
from lumbar.tissue.diagnosis.selection.base_choice import SEARCH
from lumbar.tissue.diagnosis.selection.candidate import (
    Candidate,
    evaluate,
    fit_base,
    is_adequate,
    refit,
    select_forms,
    unseen_improvement,
)
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisResult, DiagnosisState, Status, run
from lumbar.tissue.diagnosis.selection.forward_selection import find_ties
from lumbar.tissue.diagnosis.selection.sentences import effects_text
from lumbar.tissue.diagnosis.selection.thresholds import EXPLAINS, TIED, UNSEEN
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.structure import Structure

_MAX_NONLINEAR_SHARE = 0.1
"""Largest significant nonlinear share of the error of the best linear model if nothing nonlinear is missing."""
_OWN_ZERO_ERROR_RATIO = 0.9
"""Ratio of the unseen error with one zero per record to that with one zero, below which one zero per record is used."""
_MIN_START_SAMPLES = 3
_ZERO_SHIFT_SHARE, _ZERO_SHIFT_SIGMAS = 0.1, 2.5
"""Largest distance between the zero at a record's beginning and that of the whole record if both are the same: a share of the
zero's shift, plus standard errors of the median at the beginning."""
_MAX_START_SHARE = 0.5
"""Largest error at the start of a record that begins at rest, as a share of the zero, if the zero is the sensor's."""
_MIN_ZERO_SHARE = 0.01
"""Share of the response's range above which a sensor's zero is reported."""
_LEAD_BASES = ("LE", "KB")
"""Bases with which a lead is searched: dashpots of the other bases can replace a lead."""
_MAX_LEADS = (5, 14, 23)
"""Longest leads, in samples, of the first search and of the next searches for a longer lead: a delay spans ten samples."""
_MIN_SAMPLES_PER_LEAD = 4
"""Smallest ratio of the samples that count in every record to the longest lead."""
_MIN_DELAY_SAMPLES = 0.2
"""Remaining delay, in samples, up to which the lead may be longer."""
_DELAY_STARTS = (4.0, 1.5)
"""Starting values of the delay in samples."""


def compare_zeros(state: DiagnosisState) -> DiagnosisState:
    """Search again with one zero per record if this makes the model, or a smaller model, much better.

    If zeros differ between records, an effect that accumulates (a drift) may be selected instead. If they do not differ, a model
    that lacks a relaxation seems to have different zeros too: a zero counts only if its record begins with this value.
    """
    step, result, experiment = "compare zeros", state.result, state.result.experiment
    if experiment.has_own_zeros:
        return state.next(step, "not needed: every record has a zero already")
    if len(experiment.records) == 1:
        return state.next(step, "not needed: one record has one zero")
    with_zeros = experiment.allow_own_zeros()
    accumulating = any(state.settings.candidates[name].accumulates for name in result.selected)
    if not accumulating and not any(
        refit(item.fit.structure, item.fit.nonlinear, with_zeros).test_rms
        < _OWN_ZERO_ERROR_RATIO * item.test_rms
        for item in result.path
    ):
        reason = f"one zero serves all records: others hardly lower the error on {experiment.test_data}"
        return state.next(step, reason)
    reason = "base and effects are searched again with one zero per record"
    again = run((*SEARCH, find_ties), state.next(step, reason, experiment=with_zeros, status=None))
    own, shared = again.result.model.test_rms, result.model.test_rms
    errors = f"{own:.4g} {experiment.output_unit} on {experiment.test_data} with one zero per record, {shared:.4g} with one"
    is_better = own < _OWN_ZERO_ERROR_RATIO * shared
    is_simpler = len(again.result.selected) < len(result.selected)
    if not (is_better or (is_simpler and own < shared / _OWN_ZERO_ERROR_RATIO)):
        return state.next(step, f"one zero serves all records: {errors}")
    finding = apparent_zeros(again.result)
    if finding is None:
        return again.next(step, f"the zeros moved between the records, which begin with them: {errors}")
    changes = {}
    if result.refined_status == Status.ADEQUATE:
        changes["refined_status"] = Status.UNEXPLAINED
    reason = f"the zeros only seem to have moved, for records do not begin with them: {errors}"
    if set(result.selected) != set(again.result.selected):
        changes |= {"status": Status.UNEXPLAINED, "tied_with": []}
        reason += f"; with them {effects_text(again.result.selected)} would be selected"
    return state.next(step, reason, finding, **changes)


def compare_with_linear_dynamics(state: DiagnosisState) -> DiagnosisState:
    """Compare the model with linear dynamics of higher order.

    If linear dynamics explain more and leave no nonlinear error, only linear effects are searched. If they explain more and leave
    a nonlinear error, no effect of the catalogue explains the records.
    """
    step, result, candidates = "compare with linear dynamics", state.result, state.settings.candidates
    experiment = result.experiment
    only_linear = bool(result.selected) and all(candidates[name].linear for name in result.selected)
    if is_adequate(result.model, experiment) and not only_linear:
        return state.next(step, "not needed: the model leaves only noise")
    alternative = linear_alternative(result.model, experiment)
    if alternative is None:
        return state.next(step, "linear dynamics of higher order do not explain the records better")
    from lumbar.tissue.diagnosis.linear.linear_dynamics import nonlinear_share
    from lumbar.tissue.diagnosis.linear.poles import linear_base

    dynamics, finding = alternative
    base = linear_base(dynamics.fit.poles, dynamics.fit.held)
    linear = base and fit_base(base, experiment)
    errors = f"{dynamics.test_rms:.4g} {experiment.output_unit} on {experiment.test_data}, the model {result.model.test_rms:.4g}"
    unexplained = {"status": Status.UNEXPLAINED, "tied_with": [], "linear": linear}
    if (nonlinear_share(experiment, dynamics.fit) or 0.0) > _MAX_NONLINEAR_SHARE:
        reason = f"linear dynamics explain more ({errors}), and what they leave is nonlinear"
        return state.next(step, reason, finding, **unexplained)
    only = {name: effect for name, effect in candidates.items() if effect.linear}
    again = state
    if not set(result.selected) <= set(only):
        reason = f"linear dynamics explain more ({errors}) and leave nothing nonlinear: linear effects are searched"
        trial = state.next(step, reason, settings=state.settings.limit(only), status=None)
        again = run((*SEARCH, find_ties), trial)
        if linear_alternative(again.result.model, experiment) is None:
            named = effects_text(again.result.selected)
            reason = f"linear effects explain the records as well as linear dynamics: {named}"
            return again.next(step, reason, finding, settings=state.settings)
    reason = f"linear dynamics explain more than any effects of the catalogue: {errors}"
    return again.next(step, reason, finding, settings=state.settings, **unexplained)


def check_lead(state: DiagnosisState) -> DiagnosisState:
    """Check whether a force that leads the motion explains more than the selected linear effects; no mechanism causes a lead."""
    step, model, experiment = "check lead", state.result.model, state.result.experiment
    linear = {name for name in state.result.selected if state.settings.candidates[name].linear}
    finding = force_leads(model, experiment, linear)
    if finding is None:
        return state.next(step, "no lead of the force explains the records better")
    reason = f"a force that leads by {1e3 * finding.value:.3g} ms explains the records better"
    if not linear and is_adequate(model, experiment):
        return state.next(step, f"{reason}, but the model leaves only noise", finding)
    return state.next(step, reason, finding, status=Status.UNEXPLAINED, tied_with=[])


def report_zeros(state: DiagnosisState) -> DiagnosisState:
    """Report the zeros of the sensors if they are relevant."""
    findings, training = report_offsets(state.result), state.result.experiment.training.name
    if any(item.kind == "force_offset" and item.record == training for item in findings):
        # A zero that the records contradict is an error of the model.
        is_useful = _is_zero_useful(state.result)
        findings = [item for item in findings if is_useful or item.kind != "force_offset"]
    return state.report("report zeros", findings, "the zeros are where the records say")


def report_offsets(result: DiagnosisResult) -> list[Finding]:
    """Return findings on the zeros of the sensors that are significantly not 0."""
    experiment, fit = result.experiment, result.model.fit
    unit, quantity, training = experiment.output_unit, experiment.output_quantity, experiment.training.name
    findings = position_offset(experiment)
    if fit.structure.base.contact:
        sentence = (
            f"The tool is not fastened to the tissue: it meets the surface at {experiment.surface:.4g} {experiment.input_unit}. "
            "Depths are counted from there."
        )
        findings = [Finding("surface", sentence, experiment.surface, experiment.input_unit)]
    low = high = 0.0
    if fit.structure.base.sensor_zero:  # 95 % interval of the zero, of the last record if each has one
        scaled, size = scaled_covariance(fit, experiment.training)
        deviation = 1.96 * float(np.sqrt(max(scaled[-1, -1], 0.0)) / size[-1])
        low, high = float(fit.zeros[-1]) - deviation, float(fit.zeros[-1]) + deviation
    force = experiment.training.force
    # A zero beyond every measured force is an error of the model.
    is_notable = _MIN_ZERO_SHARE * float(np.ptp(force)) < abs(fit.zero) <= float(np.abs(force).max())
    if is_notable and (low > 0 or high < 0):
        sentence = (
            f"The zero of the {quantity} is at {fit.zero:+.3g} {unit} (95 % interval {low:.3g} to {high:.3g}), or the zero of "
            f"the {experiment.input_quantity} is off by an amount that causes it. It was fitted with the model and subtracted."
        )
        findings.append(Finding("force_offset", sentence, fit.zero, unit, training))
    if experiment.has_own_zeros and fit.structure.base.sensor_zero:
        for item in _record_zeros(result):
            sentence = (
                f"{item.name}: the zero of the {quantity} is at {item.zero:+.3g} {unit}, in {training} at {fit.zero:+.3g} {unit}"
                ": it moved between the records, and this one begins there. The error from its own zero is "
                f"{item.rms:.3g} {unit}, from that of {training} {item.strict_rms:.3g} {unit}."
            )
            findings.append(Finding("force_offset", sentence, item.zero, unit, item.name))
    return findings


def _is_zero_useful(result: DiagnosisResult) -> bool:
    """Return whether records that begin at rest begin at the fitted zero, and it lowers the error on unseen records."""
    model, experiment = result.model, result.experiment
    resting = {record.name for record in experiment.records if begins_at_rest(record)}
    for data in (item for item in experiment.training.records if item.name in resting):
        start = float(data.force[data.begins] - model.fit.simulate(data.motion)[data.begins])
        if abs(start) > _MAX_START_SHARE * abs(model.fit.zero):
            return False
    structure = model.fit.structure
    without = Structure(replace(structure.base, sensor_zero=False), structure.forms)
    return refit(without, model.fit.nonlinear, experiment).test_rms > model.test_rms


def position_offset(experiment: Experiment) -> list[Finding]:
    """Return a finding on the origin of the positions if no record comes near 0."""
    if not any(experiment.rest):
        return []
    unit, size = experiment.input_unit, float(np.linalg.norm(experiment.rest))
    origin = ", ".join(f"{value:.5g}" for value in experiment.rest)
    origin = f"({origin})" if len(experiment.rest) > 1 else origin
    sentence = (
        f"The records are farther from {experiment.input_quantity} 0 than their whole range. Positions are counted from {origin} "
        f"{unit}, where the records begin or about which they move; effects that depend on position count from there."
    )
    return [Finding("position_offset", sentence, size, unit)]


@dataclass(frozen=True)
class _RecordZero:
    """Zero of an unseen record for a model that was fitted to other records."""

    name: str
    zero: float
    start: float
    """Offset of the first samples, before the motion affects them."""
    start_samples: int
    rms: float
    """RMS error with this zero."""
    strict_rms: float
    """RMS error with the zero of the training record."""


def _record_zeros(result: DiagnosisResult) -> list[_RecordZero]:
    fit, zeros = result.model.fit, []
    for item in result.experiment.tests:
        error = item.force - fit.simulate(item.motion)
        counted = item.trim(error)
        start = error[item.begins : max(item.first, item.begins + _MIN_START_SAMPLES)]
        values = (fit.zero + float(value) for value in (counted.mean(), np.median(start)))
        sizes = float(counted.std()), float(np.sqrt(np.mean(counted**2)))
        zeros.append(_RecordZero(item.name, *values, len(start), *sizes))
    return zeros


def apparent_zeros(result: DiagnosisResult) -> Finding | None:
    """Return a finding if records do not begin at their fitted zeros; None if they do within the noise: the zeros moved."""
    unit, zero, zeros = result.experiment.output_unit, result.model.fit.zero, _record_zeros(result)
    distances = np.array([item.start - item.zero for item in zeros])
    shifts = np.array([item.zero - zero for item in zeros])
    noise = result.experiment.noise / np.sqrt([item.start_samples for item in zeros])
    limit = _ZERO_SHIFT_SHARE * np.linalg.norm(shifts) + _ZERO_SHIFT_SIGMAS * np.linalg.norm(noise)
    if np.linalg.norm(distances) < limit:
        return None
    listed = ", ".join(f"{item.name} {item.zero:+.3g} (begins at {item.start:+.3g})" for item in zeros)
    sentence = (
        f"With a separate zero for every record the error on {result.experiment.test_data} would be "
        f"{result.model.test_rms:.3g} {unit}: "
        f"{listed}, in {result.experiment.training.name} {zero:+.3g} {unit}. The records do not begin there, so these may not be "
        "zeros of the sensor: a relaxation or a force that depends on rate or amplitude, which the model lacks, would look the "
        "same; all records are judged from one zero."
    )
    return Finding("apparent_zeros", sentence, zero, unit)


def linear_alternative(model: Candidate, experiment: Experiment) -> tuple[Candidate, Finding] | None:
    """Return a higher-order linear model that explains all records significantly better than a selected one, and its finding.

    It must be better by likelihood and number of parameters, and by the loss on unseen records; otherwise return None. Lost
    contact is never linear, and an adequate model of named effects with as few states is not replaced.
    """
    if model.fit.structure.base.contact:
        return None
    from lumbar.tissue.diagnosis.linear.linear_dynamics import linear_dynamics

    linear = evaluate(linear_dynamics(experiment), experiment)
    if unseen_improvement(model, linear, experiment) <= UNSEEN or linear.score >= model.score - TIED:
        return None
    unit, order, structure = experiment.output_unit, linear.fit.order, model.fit.structure
    states = len(structure.base.form.state) + sum(len(form.state) for form in structure.forms)
    if is_adequate(model, experiment) and order <= states:
        return None
    kind = {
        "prony": "a spectrum of relaxation times",
        "rational": plural(order, "pole") if order else "of spring, dashpot and mass alone",
        "delayed": f"{plural(order, 'pole')} behind a delay",
    }[linear.fit.kind]
    sentence = (
        f"Linear dynamics ({kind}) explain these records better than the selected effects: their error on "
        f"{experiment.test_data} is {linear.test_rms:.3g} {unit}, that of the refined model {model.test_rms:.3g} {unit}."
    )
    return linear, Finding("higher_order_linear", sentence, float(order), "1")


def force_leads(model: Candidate, experiment: Experiment, linear: set[str]) -> Finding | None:
    """Report by how much the force leads, if that explains all records significantly better than the selected model.

    The force is delayed first, so that a delay remains between position and force. The effects `linear` are left out of the model
    with a lead, because dashpots, masses and branches can replace a lead.
    """
    base = model.fit.structure.base
    replaced = linear & set(model.effects)
    if base.contact or base.is_user_defined:
        return None
    if not replaced and base.name != "KV" and is_adequate(model, experiment):
        return None
    others = [form for form in model.fit.structure.forms if form.effect not in replaced | {"delay"}]
    (delay,) = TISSUE["delay"].forms
    acting = select_forms(model.fit, others).nonlinear[len(base.nonlinear) :]
    step = experiment.training.motion.sampling_time
    shortest = min(data.size for data in (*experiment.training.records, *experiment.tests))
    for samples in (number for number in _MAX_LEADS if _MIN_SAMPLES_PER_LEAD * number <= shortest):
        put_late = experiment.change_data(partial(_delay_force, samples=samples, longest=samples))
        # The likeliest base with a delay and with the other effects.
        structures = [Structure(BASES[name], (*others, delay)) for name in _LEAD_BASES]
        pairs = ((structure, [*acting, start * step]) for structure in structures for start in _DELAY_STARTS)
        fits = (fit_structure(structure, put_late.training, start) for structure, start in pairs)
        best = min((evaluate(fit, put_late) for fit in fits), key=lambda item: item.score)
        units = experiment.input_unit, experiment.output_unit
        late = next(item for item in estimates(best.fit, put_late.training, *units) if item.effect == "delay")
        if late.low > 0 and late.value > _MIN_DELAY_SAMPLES * step:
            break
    else:
        return None  # longer than the search allows: its size cannot be determined
    first = samples * step
    same = experiment.change_data(partial(_delay_force, samples=0, longest=samples))
    rival = refit(model.fit.structure, model.fit.nonlinear, same)
    is_likelier = best.score < rival.score - (TIED if best.parameters >= rival.parameters else 0)
    # If another effect is missing a lead may help a little: it is reported only if nothing is left.
    is_complete = (
        is_adequate(best, put_late)
        if experiment.floor
        else best.test_rms**2 < (1 - EXPLAINS) * rival.test_rms**2
    )
    if not (best.fit.converged and is_likelier and is_complete and late.high < first):
        return None
    low, lead, high = (1e3 * (first - value) for value in (late.high, late.value, late.low))
    position, unit = experiment.input_quantity, experiment.output_unit
    lead_only = effects_text([best.fit.structure.base.name, *(form.effect for form in others)])
    sentence = (
        f"The {experiment.output_quantity} leads the {position} by {lead:.3g} ms (95 % interval {low:.3g} to {high:.3g}): with "
        f"only this lead added to {lead_only}, the error on {experiment.test_data} is {best.test_rms:.4g} {unit}, that of the "
        f"selected model {rival.test_rms:.4g} {unit}. No tissue responds before it is moved: the clocks of the channels differ, "
        f"or the {position} is delayed by its sensor or filter; put both channels on one clock and diagnose again, because "
        "selected dashpots, masses and branches may only replace the lead."
    )
    return Finding("force_leads", sentence, lead / 1e3, "s")


def _delay_force(data: FitData, samples: int, longest: int) -> FitData:
    """Return the record with its force delayed by `samples`; the first `longest` samples do not count."""
    force = np.concatenate([np.repeat(data.force[:1], samples), data.force[: len(data.force) - samples]])
    return replace(data, force=force, settling=data.settling + longest)
