"""A diagnosis as a sequence of named steps: from records to the physical effect that a base model is missing."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.linear.direction import direction_or_sign
from lumbar.tissue.diagnosis.selection.alternatives import (
    check_lead,
    compare_with_linear_dynamics,
    compare_zeros,
    report_zeros,
)
from lumbar.tissue.diagnosis.selection.base_choice import SEARCH, find_base, reweigh_errors
from lumbar.tissue.diagnosis.selection.candidate import Candidate, drop_effect, refit
from lumbar.tissue.diagnosis.selection.forward_selection import extend, find_ties
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult, DiagnosisState, Status, run
from lumbar.tissue.diagnosis.selection.sentences import effects_text
from lumbar.tissue.diagnosis.selection.thresholds import COMPLETE
from lumbar.tissue.diagnosis.sensors.sensor_faults import repair
from lumbar.tissue.effects.catalogue import usable_effects
from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.form import Effect
from lumbar.tissue.signals.spectrum import occupied_band


def diagnose(
    records: Sequence[Record], settings: DiagnosisSettings | None = None, findings: Sequence[Finding] = ()
) -> DiagnosisResult:
    """Diagnose what a base model is missing on a set of records.

    Parameters
    ----------
    records : sequence of Record
        One per excitation, with channels ``input`` and ``output``, or one pair for every axis.
    settings : DiagnosisSettings, optional
    findings : sequence of Finding
        What is known of the records already.

    Raises
    ------
    InputError
        For a base that such records cannot have, and for records that cannot be used.
    """
    settings = settings or DiagnosisSettings()
    state = DiagnosisState(list(records), settings, tuple(findings))
    return run(steps_for(records, settings), state).result()


def steps_for(
    records: Sequence[Record], settings: DiagnosisSettings
) -> tuple[Callable[[DiagnosisState], DiagnosisState], ...]:
    """Return the steps of the diagnosis of such records."""
    if any(record.axes for record in records):
        from lumbar.tissue.diagnosis.spatial.spatial_diagnosis import SPATIAL_STEPS

        return SPATIAL_STEPS
    if settings.forward:
        from lumbar.tissue.diagnosis.forward.forward_diagnosis import FORWARD_STEPS

        return FORWARD_STEPS
    if any(record.points for record in records):
        from lumbar.tissue.diagnosis.selection.static_points import POINT_STEPS

        return POINT_STEPS
    return TISSUE_STEPS if settings.system == "tissue" else PENDULUM_STEPS


def repair_sensor_faults(state: DiagnosisState) -> DiagnosisState:
    """Repair what is wrong with the sensors and their clocks."""
    repaired, faults = repair(state.records)
    kinds = ", ".join(f"{item.kind.replace('_', ' ')} in {item.record}" for item in faults)
    return state.next("repair sensor faults", kinds or "no fault", *faults, repaired=(repaired, faults))


def estimate_noise_floor(state: DiagnosisState) -> DiagnosisState:
    """Prepare the records, estimate their noise, and leave out effects that need channels which they lack."""
    settings = state.settings
    experiment = Experiment.from_records(state.records, settings, state.repaired)
    floor, training = experiment.floor, experiment.training
    usable, not_tried = usable_effects(settings.searched, training.motion.channels, training.scale)
    noise = (
        f"{floor.rms:.3g} {experiment.output_unit} from {floor.periods} periods"
        if floor
        else "unknown: no record repeats"
    )
    return state.next(
        "estimate the noise floor",
        f"{noise}; {len(usable)} effects can be tried",
        prepared=experiment,
        experiment=experiment,
        settings=replace(settings, catalogue=usable),
        effects={**settings.candidates, **usable},
        not_tried=not_tried,
    )


def check_direction(state: DiagnosisState) -> DiagnosisState:
    """Stop if input and output are exchanged, or a sign is the other way: no effect is searched in such records."""
    step, settings, experiment = "check direction and signs", state.settings, state.experiment
    if isinstance(settings.base, Base):
        return state.next(step, "not needed: the user-defined base has its own input and output")
    if experiment.faults:
        # A command that jumps between levels would be taken for a coarse sensor, and smoothed.
        experiment = Experiment.prepare_unrepaired(state.records, settings, records=tuple(state.records))
    finding = direction_or_sign(experiment, settings.layout)
    if finding is None:
        return state.next(step, "input, output and signs are those of a tissue")
    experiment, base = find_base(experiment, settings.base, settings.candidates)
    return state.next(
        step,
        f"{finding.kind}: these records are not what a tissue model takes",
        finding,
        findings=tuple(item for item in state.findings if item not in state.experiment.faults),
        experiment=experiment,
        base=base,
        path=[base],
        status=Status.UNEXPLAINED,
        refined_status=Status.UNEXPLAINED,
        is_decided=True,
    )


def search_formula(state: DiagnosisState) -> DiagnosisState:
    """Search a short formula for what no effect of the catalogue explains."""
    step, result = "search a formula", state.result()
    if not result.goes_beyond_catalogue:
        return state.next(
            step, "not needed: nothing is known to be left that effects of the catalogue do not explain"
        )
    if not state.settings.propose_law:
        return state.next(step, "left out: the settings do not ask for it")
    from lumbar.tissue.diagnosis.law.proposal import propose, with_law

    proposal = propose(result.experiment, result.base, result.model)
    changed = with_law(result, proposal)
    added = changed.findings[len(result.findings) :]
    reason = (
        f"a law is proposed: {proposal.form.equation}" if added else "no short formula explains what is left"
    )
    return state.next(
        step, reason, *added, status=changed.status, tied_with=changed.tied_with, proposal=proposal
    )


FAR = 2.0
"""Error of an unseen record, in noise floors, that a model which leaves only noise in training should not have."""
_STRETCHES = 4
_FALLING = -0.9
"""Largest rank correlation of the stiffnesses of all intervals with their order if they fall throughout."""
_MOVES = 0.2
"""Smallest range of an interval, as a share of the record's range."""
_FALL = 0.01
"""Smallest share of the stiffness by which it falls."""
_APART = 2.0
"""Smallest ratio of the highest to the lowest rate of the motion for which records show whether a force depends on it."""
_AS_GOOD = 1.5
"""Largest ratio of the error on an unseen record to that in training, each relative to its force if that is larger, if the
record is predicted; and of the error of a rival to that of the model if they are tied."""
_FUNDAMENTAL = 0.9
"""Share of the power that bounds the rates of a motion: without the harmonics of a triangle, which has one rate."""
_RIVALS = ("relaxation_spectrum", "second_relaxation")
_SPRINGS = ("hardening_stiffness", "strain_softening", "quadratic_stiffness")
"""Alternatives to a rate-independent mechanism: relaxation, without or with a spring of large strain."""
_OWN_SIZE = 0.5
"""Smallest share of the error on a record of another rate that another size of the mechanism removes if that rate contradicts
it; else something else is missing there."""


def check_rate_independence(state: DiagnosisState) -> DiagnosisState:
    """Name a rate-independent mechanism only if other rates are predicted without new constants.

    Else it is tied with the relaxations, without or with a spring of large strain, that explain the unseen records as well; it
    is unexplained if records of other rates contradict it and none of these does.
    """
    step, experiment, effects = "check rate independence", state.experiment, state.effects
    named = [name for name in state.selected if effects[name].rate_independent]
    if state.status not in (Status.NAMED, Status.TIED) or not named:
        return state.next(step, "not needed: no rate-independent effect is named")
    # Lowest and highest frequency (Hz) of the motion in all records.
    records = [part for item in (experiment.training, *experiment.tests) for part in item.records]
    bands = [
        occupied_band(part.drop_history(part.motion.position), part.motion.sampling_time, _FUNDAMENTAL)
        for part in records
    ]
    low, high = min(edges[0] for edges in bands), max(edges[1] for edges in bands)
    apart, failed = high >= _APART * low, _not_predicted(state, named)
    rates = f"rates from {low:.3g} to {high:.3g} Hz"
    if apart and not failed:
        return state.next(
            step, f"{effects_text(named)} predicts all records with one set of constants ({rates})"
        )
    known = {frozenset(item.effects) for item in state.tied_with}
    rivals = [item for item in _rivals(state, named, effects) if frozenset(item.effects) not in known]
    tied = [*state.tied_with, *rivals]
    status = Status.TIED if tied else Status.UNEXPLAINED if apart else Status.NAMED
    missed = " and ".join(failed)
    if apart:
        kind = "other_rates_missed"
        sentence = (
            f"The constants of {experiment.training.name} do not predict records at other rates: {missed} (rates from {low:.3g} "
            f"to {high:.3g} Hz). The records thus do not show that {effects_text(named)} acts at every speed; relaxation on many "
            "time scales and springs of large strain were tried instead."
        )
    else:
        kind = "one_rate"
        sentence = (
            f"All records move at nearly one rate ({low:.3g} to {high:.3g} Hz), so they do not show that {effects_text(named)} "
            "acts at every speed. Repeat the same path ten times as fast or as slowly."
        )
    finding = Finding(kind, sentence, high / low, "1")
    others = ", ".join(effects_text(item.effects) for item in rivals) or "no other effects"
    seen = f"{missed} not predicted" if apart else "too alike to show rate independence"
    reason = f"{rates}: {seen}; {others} explain the unseen records as well"
    return state.next(step, reason, finding, status=status, tied_with=tied)


def compare_records(state: DiagnosisState) -> DiagnosisState:
    """Report unseen records that the model misses though it leaves only noise in training, and stiffness that falls."""
    findings = [*train_on_others(state), *falling_stiffness(state.experiment)]
    kinds = ", ".join(item.kind.replace("_", " ") for item in findings)
    return state.next("compare records", kinds or "no record contradicts the others", *findings)


def missed_records(state: DiagnosisState) -> list[str]:
    """Return the unseen records with an error far above the noise, of a model that leaves only noise in training."""
    experiment, model = state.experiment, state.model
    noise = experiment.noise or model.train_rms
    tissue = model.fit.structure.base.system == "tissue" and not experiment.session and not experiment.points
    if not tissue or model.train_rms > COMPLETE * noise:
        return []
    trained = {item.name for item in experiment.training.records}
    return [name for name, rms in model.unseen_rms.items() if rms > FAR * noise and name not in trained]


def train_on_others(state: DiagnosisState) -> list[Finding]:
    """Report the errors of the selected model fitted to the unseen records, and to all."""
    left = missed_records(state)
    if not left:
        return []
    experiment, model = state.experiment, state.model

    def fitted(names: list[str]):
        chosen = Experiment.prepare_unrepaired(experiment.records, replace(state.settings, train=names))
        return refit(model.fit.structure, model.fit.nonlinear, chosen.shift_origin(experiment.surface))

    first = [item.name for item in experiment.training.records]
    unseen = [item.name for item in experiment.tests]
    try:
        turned, joint = fitted(unseen), fitted([*first, *unseen])
    except InputError:
        return []  # the others move too little, or have another rate: they cannot be training records
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
    """Report a stiffness that falls through all records, in their order."""
    records = experiment.records
    if len(records) < 2 or experiment.session or experiment.points:
        return []
    slopes = []
    for record in records:
        parts = zip(*(np.array_split(record[role], _STRETCHES) for role in ("input", "output")), strict=True)
        least = _MOVES * float(np.ptp(record["input"]))
        for position, force in parts:
            if np.ptp(position) < least:
                return []  # a hold shows no stiffness
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


def _not_predicted(state: DiagnosisState, named: list[str]) -> list[str]:
    """Return the unseen records with an error far above that of training that other sizes of the named effects would remove."""
    model, experiment = state.model, state.experiment
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
    """Return the share of the squared error on a record that another size of the named effects removes."""
    of_base = np.zeros(len(fit.structure.base.linear), dtype=bool)
    of_forms = [np.full(len(form.linear), form.effect in named) for form in fit.structure.forms]
    larger = fit.linear * np.where(np.concatenate([of_base, *of_forms]), 2.0, 1.0)
    force = fit.structure.simulate(data.motion, larger, fit.nonlinear) + fit.zero - fit.simulate(data.motion)
    error = data.trim(data.force - fit.simulate(data.motion))
    part = data.trim(force)
    error, part = error - error.mean(), part - part.mean()
    return float((error @ part) ** 2 / max((error @ error) * (part @ part), 1e-300))


def _rivals(state: DiagnosisState, named: list[str], effects: Mapping[str, Effect]) -> list[Candidate]:
    """Fit relaxations instead of the mechanism, without and with a spring; return those with a similar unseen error."""
    experiment, start = state.experiment, state.model
    for name in named:
        start = drop_effect(start, name, experiment)
    relaxing, springs = (
        {name: effects[name] for name in names if name in effects} for names in (_RIVALS, _SPRINGS)
    )
    alone = extend(start, relaxing, experiment)[:1]
    beside = [item for model in alone for item in extend(model, springs, experiment)[:1]]
    return [item for item in alone + beside if item.test_rms <= _AS_GOOD * state.model.test_rms]


TISSUE_STEPS = (
    repair_sensor_faults,
    estimate_noise_floor,
    check_direction,
    *SEARCH,
    reweigh_errors,
    find_ties,
    compare_zeros,
    compare_with_linear_dynamics,
    check_lead,
    report_zeros,
    check_rate_independence,
    compare_records,
    search_formula,
)
PENDULUM_STEPS = (estimate_noise_floor, *SEARCH, reweigh_errors, find_ties, report_zeros)
