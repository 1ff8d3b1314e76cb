"""A diagnosis as a sequence of named steps: from records to the physical effect that a base model is missing."""

from collections.abc import Sequence

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.records.rests import find_two_levels
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.preparation import Experiment, prepare
from lumbar.tissue.diagnosis.linear.direction import direction_or_sign
from lumbar.tissue.diagnosis.selection.alternatives import (
    check_lead,
    compare_with_linear_dynamics,
    compare_zeros,
    report_zeros,
)
from lumbar.tissue.diagnosis.selection.base_choice import SEARCH, find_base, reweigh_errors
from lumbar.tissue.diagnosis.selection.candidate import Candidate, drop_effect, is_adequate, refit
from lumbar.tissue.diagnosis.selection.diagnosis_result import (
    UNUSABLE,
    DiagnosisResult,
    DiagnosisState,
    Status,
    run,
)
from lumbar.tissue.diagnosis.selection.forward_selection import extend, find_ties, report_noise
from lumbar.tissue.diagnosis.selection.one_ramp import check_motion, check_one_ramp
from lumbar.tissue.diagnosis.selection.sentences import effects_text, readable
from lumbar.tissue.diagnosis.selection.thresholds import COMPLETE
from lumbar.tissue.diagnosis.sensors.sensor_faults import repair
from lumbar.tissue.effects.catalogue import usable_effects
from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.form import Effect
from lumbar.tissue.signals.spectrum import occupied_band

_MAX_TEST_ERROR_FLOORS = 2.0
"""Largest unseen error, in noise floors, of a model that leaves only noise in training and is valid for all records."""
_SEGMENTS = 4
"""Number of segments of a record; a stiffness is estimated in each."""
_MAX_RANK_CORRELATION = -0.9
"""Largest rank correlation of stiffness and order of all segments if the stiffness falls throughout."""
_MIN_RANGE_SHARE = 0.2
"""Smallest range of a segment, as a share of the record's range."""
_MIN_FALL_SHARE = 0.01
"""Smallest relative fall of the stiffness."""
_MIN_RATE_RATIO = 2.0
"""Smallest ratio of the highest to the lowest rate of motion in records that show whether a force depends on rate."""
_MAX_ERROR_RATIO = 1.5
"""Largest ratio of the unseen error to the training error of a predicted record (if its force is larger, errors are relative to
the forces); and largest ratio of the error of a tied rival to that of the model."""
_FUNDAMENTAL_POWER = 0.9
"""Share of the power that defines the rates of a motion: it excludes the harmonics of a triangle, which has one rate."""
_RELAXATIONS = ("relaxation_spectrum", "second_relaxation")
_LARGE_STRAIN_SPRINGS = ("hardening_stiffness", "strain_softening", "quadratic_stiffness")
"""Alternatives to a rate-independent mechanism: relaxation, without or with a spring of large strain."""
_MIN_SHARE_REMOVED_BY_RESIZING = 0.5
"""Smallest share of the error on a record that another size of the mechanism removes if the record contradicts the mechanism;
otherwise another effect is missing on this record."""


def diagnose(
    records: Sequence[Record], settings: DiagnosisSettings | None = None, findings: Sequence[Finding] = ()
) -> DiagnosisResult:
    """Diagnose what a base model is missing on a set of records.

    Parameters
    ----------
    records : sequence of Record
        One record per excitation, with channels ``input`` and ``output``, or a pair of channels for every axis.
    settings : DiagnosisSettings, optional
        Settings of the diagnosis; default settings if None.
    findings : sequence of Finding
        Known properties of the records, which are added to the result.

    Returns
    -------
    DiagnosisResult

    Raises
    ------
    InputError
        For a base that such records cannot have, and for records that cannot be used.
    """
    settings = settings or DiagnosisSettings()
    steps = PENDULUM_STEPS if settings.system == "pendulum" else TISSUE_STEPS
    if any(record.axes for record in records):
        from lumbar.tissue.diagnosis.spatial.spatial_diagnosis import SPATIAL_STEPS

        steps = SPATIAL_STEPS
    elif settings.forward:
        from lumbar.tissue.diagnosis.forward.forward_diagnosis import FORWARD_STEPS

        steps = FORWARD_STEPS
    elif any(record.points for record in records):
        from lumbar.tissue.diagnosis.selection.static_points import POINT_STEPS

        steps = POINT_STEPS
    start = DiagnosisState(list(records), settings, DiagnosisResult(findings=tuple(findings)))
    return run(steps, start).result


def repair_sensor_faults(state: DiagnosisState) -> DiagnosisState:
    """Repair faults of the sensors and their clocks."""
    repaired, faults = repair(state.records)
    kinds = ", ".join(f"{item.kind.replace('_', ' ')} in {item.record}" for item in faults)
    return state.next("repair sensor faults", kinds or "no fault", *faults, repaired=(repaired, faults))


def estimate_noise_floor(state: DiagnosisState) -> DiagnosisState:
    """Prepare the records, estimate their noise, and leave out effects that need missing channels."""
    settings = state.settings
    experiment = Experiment.from_records(state.records, settings, state.repaired)
    floor, training = experiment.floor, experiment.training
    usable, not_tried = usable_effects(settings.searched, training.motion.channels, training.scale)
    noise = (
        f"{floor.rms:.3g} {experiment.output_unit} from {floor.periods} periods"
        if floor
        else "unknown: no record repeats"
    )
    changes = {"prepared": experiment, "experiment": experiment, "not_tried": not_tried}
    changes |= {"settings": settings.limit(usable), "effects": {**settings.candidates, **usable}}
    return state.next("estimate the noise floor", f"{noise}; {len(usable)} effects can be tried", **changes)


def check_direction(state: DiagnosisState) -> DiagnosisState:
    """Stop if input and output are exchanged or a sign is inverted: no effect is searched in such records."""
    step, settings, experiment = "check direction and signs", state.settings, state.result.experiment
    if isinstance(settings.base, Base):
        return state.next(step, "not needed: the user-defined base has its own input and output")
    if experiment.faults:
        # A command that jumps between levels would be mistaken for a coarse sensor, and smoothed.
        experiment = prepare(state.records, **settings.preparation)
    finding = direction_or_sign(experiment, settings.layout)
    if finding is None:
        return state.next(step, "input, output and signs are those of a tissue")
    experiment, base = find_base(experiment, settings.base, settings.candidates)
    changes = {**UNUSABLE, "experiment": experiment, "base": base, "path": [base]}
    others = tuple(item for item in state.result.findings if item not in state.result.experiment.faults)
    reason = f"{finding.kind}: these records are not what a tissue model takes"
    return state.next(step, reason, finding, findings=others, **changes)


def leave_out_unshown(state: DiagnosisState) -> DiagnosisState:
    """Leave out the effects that a position of two levels cannot show: all but linear effects with memory."""
    step, levels = "leave out effects that two levels cannot show", find_two_levels(state.records)
    if levels is None or isinstance(state.settings.base, Base):
        return state.next(
            step, "not needed: the position takes other values too, or the base is user-defined"
        )

    def is_shown(effect: Effect) -> bool:
        # Levels that are not visited equally often make hysteresis look like a drift, so effects of time are left out too.
        return effect.linear and any(form.hand_written or form.state for form in effect.forms)

    shown = {name: effect for name, effect in state.effects.items() if is_shown(effect)}
    hidden = [readable(name) for name in state.settings.searched if name not in shown]
    unit = state.result.experiment.input_unit
    sentence = (
        f"The {state.result.experiment.input_quantity} jumps between two levels, {levels.values[0]:.4g} and "
        f"{levels.values[1]:.4g} {unit}, at which every curve is a straight line. Not identifiable and not searched: "
        f"{', '.join(hidden)}; use a multisine or five levels."
    )
    searched = {name: effect for name, effect in state.settings.catalogue.items() if name in shown}
    changes = {"settings": state.settings.limit(searched), "effects": shown}
    return state.next(step, f"{len(hidden)} effects", Finding("two_levels", sentence, 2, "1"), **changes)


def search_formula(state: DiagnosisState) -> DiagnosisState:
    """Search a short formula for the error that no effect of the catalogue explains."""
    step, result = "search a formula", state.result
    # One more effect may pass and leave only noise: then the catalogue is not exhausted.
    further = result.further is not None and is_adequate(result.further, result.experiment, COMPLETE)
    is_error_left = result.status == Status.UNEXPLAINED or (result.complete is False and not further)
    if result.orientation is not None or not is_error_left:
        reason = "not needed: nothing is known to be left that effects of the catalogue do not explain"
        return state.next(step, reason)
    if not state.settings.propose_law:
        return state.next(step, "left out: the settings do not ask for it")
    from lumbar.tissue.diagnosis.law.proposal import propose

    proposal = propose(result.experiment, result.base, result.model)
    if proposal.law is None:
        return state.next(step, "no short formula explains what is left", proposal=proposal)
    changes = {"status": Status.UNEXPLAINED, "tied_with": []} if proposal.is_imitated else {}
    reason = f"a law is proposed: {proposal.form.equation}"
    return state.next(step, reason, proposal.finding, proposal=proposal, **changes)


def check_rate_independence(state: DiagnosisState) -> DiagnosisState:
    """Name a rate-independent mechanism only if other rates are predicted without new constants.

    Otherwise it is tied with relaxations, without or with a spring of large strain, that explain the unseen records equally well.
    The status is unexplained if records of other rates contradict the mechanism and there is no such relaxation.
    """
    step, result, effects = "check rate independence", state.result, state.effects
    experiment = result.experiment
    named = [name for name in result.selected if effects[name].rate_independent]
    if result.status not in (Status.NAMED, Status.TIED) or not named:
        return state.next(step, "not needed: no rate-independent effect is named")
    if any(item.kind == "one_ramp" for item in result.findings):
        return state.next(step, "not needed: one ramp has one rate, and its rivals are tied")
    # Lowest and highest frequency (Hz) of the motion in all records.
    records = [part for item in (experiment.training, *experiment.tests) for part in item.records]
    motions = [(part.drop_history(part.motion.position), part.motion.sampling_time) for part in records]
    motions = [motion for motion in motions if np.ptp(motion[0]) > 0]
    lows, highs = zip(*(occupied_band(*motion, _FUNDAMENTAL_POWER) for motion in motions), strict=True)
    low, high = min(lows), max(highs)
    rates_differ, failed = high >= _MIN_RATE_RATIO * low, _unpredicted_records(result, named)
    rates = f"rates from {low:.3g} to {high:.3g} Hz"
    if rates_differ and not failed:
        reason = f"{effects_text(named)} predicts all records with one set of constants ({rates})"
        return state.next(step, reason)
    known = {frozenset(item.effects) for item in result.tied_with}
    rivals = [item for item in _fit_rivals(result, named, effects) if frozenset(item.effects) not in known]
    tied, missed = [*result.tied_with, *rivals], " and ".join(failed)
    status = Status.TIED if tied else Status.UNEXPLAINED if rates_differ else Status.NAMED
    if rates_differ:
        kind, outcome = "other_rates_missed", f"{missed} not predicted"
        sentence = (
            f"The constants of {experiment.training.name} do not predict records at other rates: {missed} (rates from {low:.3g} "
            f"to {high:.3g} Hz). The records thus do not show that {effects_text(named)} acts at every speed; relaxation on many "
            "time scales and springs of large strain were tried instead."
        )
    else:
        kind, outcome = "one_rate", "too similar to show rate independence"
        sentence = (
            f"All records move at nearly one rate ({low:.3g} to {high:.3g} Hz), so they do not show that {effects_text(named)} "
            "acts at every speed. Repeat the same path ten times as fast or as slowly."
        )
    others = ", ".join(effects_text(item.effects) for item in rivals) or "no other effects"
    reason = f"{rates}: {outcome}; {others} explain the unseen records as well"
    finding = Finding(kind, sentence, high / low, "1")
    return state.next(step, reason, finding, status=status, tied_with=tied)


def compare_records(state: DiagnosisState) -> DiagnosisState:
    """Report unseen records that the model does not predict although it leaves only noise in training, and falling stiffness."""
    findings = [*_train_on_others(state), *_falling_stiffness(state.result.experiment)]
    return state.report("compare records", findings, "no record contradicts the others")


def _train_on_others(state: DiagnosisState) -> list[Finding]:
    """Report the errors of fits to the unseen records and to all records, if the model leaves only noise in training."""
    experiment, model = state.result.experiment, state.result.model
    noise = experiment.noise or model.train_rms
    is_other = model.fit.structure.base.system != "tissue" or experiment.session or experiment.points
    if is_other or model.train_rms > COMPLETE * noise:
        return []
    first = [item.name for item in experiment.training.records]
    unseen_rms = {name: rms for name, rms in model.unseen_rms.items() if name not in first}
    missed = {name: rms for name, rms in unseen_rms.items() if rms > _MAX_TEST_ERROR_FLOORS * noise}
    if not missed:
        return []
    unseen = [item.name for item in experiment.tests]
    fitted = []
    try:
        for names in (unseen, [*first, *unseen]):
            chosen = prepare(experiment.records, **{**state.settings.preparation, "train": names})
            chosen = chosen.shift_origin(experiment.surface)
            fitted.append(refit(model.fit.structure, model.fit.nonlinear, chosen))
    except InputError:
        return []  # the others move too little, or have another rate: they cannot be training records
    exchanged, joint = fitted
    worst = max(joint.train_rms, joint.test_rms)
    unit, trained, others = experiment.output_unit, " and ".join(first), " and ".join(unseen)
    outcome = (
        "so one set of parameters describes all records: fit them together with --train"
        if worst <= _MAX_TEST_ERROR_FLOORS * noise
        else "so no single set of parameters describes all of them"
    )
    sentence = (
        f"Of {trained} only noise is left, of {' and '.join(missed)} up to {max(missed.values()):.3g} {unit}; the same model "
        f"fitted to {others} leaves {exchanged.train_rms:.3g} {unit} there and {exchanged.test_rms:.3g} {unit} of {trained}, and "
        f"fitted to all together it leaves {worst:.3g} {unit}, {outcome}. What came before a record may matter (softening, wear, "
        "slow recovery): use --session if they were recorded one after another, in the order of their names."
    )
    return [Finding("trained_otherwise", sentence, exchanged.test_rms, unit)]


def _falling_stiffness(experiment: Experiment) -> list[Finding]:
    """Report a stiffness that falls from record to record and within all records."""
    records = experiment.records
    if len(records) < 2 or experiment.session or experiment.points:
        return []
    slopes = []
    for record in records:
        least = _MIN_RANGE_SHARE * float(np.ptp(record["input"]))
        segments = (np.array_split(record[role], _SEGMENTS) for role in ("input", "output"))
        for position, force in zip(*segments, strict=True):
            if np.ptp(position) <= least:
                return []  # a hold shows no stiffness
            moved = position - position.mean()
            slopes.append(float(moved @ force / (moved @ moved)))
    ranks = np.argsort(np.argsort(slopes))
    order = float(np.corrcoef(ranks, np.arange(len(slopes)))[0, 1])
    if order > _MAX_RANK_CORRELATION or slopes[-1] >= (1 - _MIN_FALL_SHARE) * slopes[0]:
        return []
    unit = f"{experiment.output_unit}/{experiment.input_unit}"
    sentence = (
        f"The stiffness falls through all records, in the order of their names, from {slopes[0]:.4g} to {slopes[-1]:.4g} {unit}. "
        "If they were recorded one after another on one specimen, use --session: each then begins where the one before it ended."
    )
    return [Finding("falling_stiffness", sentence, slopes[-1], unit)]


def _unpredicted_records(result: DiagnosisResult, named: list[str]) -> list[str]:
    """Return unseen records with a far larger error than in training, which other sizes of the named effects would remove."""
    model, experiment, fit = result.model, result.experiment, result.model.fit
    least = max(model.train_rms, experiment.noise)
    trained = float(np.std(experiment.training.trim(experiment.training.force)))
    # The named effects by themselves: the simulation with twice their size less that with their size.
    of_forms = [np.full(len(form.linear), form.effect in named) for form in fit.structure.forms]
    is_named = np.concatenate([np.zeros(len(fit.structure.base.linear), dtype=bool), *of_forms])
    larger = fit.linear * np.where(is_named, 2.0, 1.0)
    failed = []
    for item in experiment.tests:
        size = float(np.std(item.trim(item.force)))
        if model.unseen_rms[item.name] <= _MAX_ERROR_RATIO * least * max(1.0, size / trained):
            continue
        simulated = fit.simulate(item.motion)
        part = item.trim(fit.structure.simulate(item.motion, larger, fit.nonlinear) + fit.zero - simulated)
        error = item.trim(item.force - simulated)
        error, part = error - error.mean(), part - part.mean()
        removed = (error @ part) ** 2 / max((error @ error) * (part @ part), 1e-300)
        if removed > _MIN_SHARE_REMOVED_BY_RESIZING:
            failed.append(item.name)
    return failed


def _fit_rivals(result: DiagnosisResult, named: list[str], effects: dict[str, Effect]) -> list[Candidate]:
    """Fit relaxations instead of the mechanism, without and with a spring; return models with a similar unseen error."""
    experiment, start = result.experiment, result.model
    for name in named:
        start = drop_effect(start, name, experiment)
    kinds = (_RELAXATIONS, _LARGE_STRAIN_SPRINGS)
    relaxations, springs = ({name: effects[name] for name in kind if name in effects} for kind in kinds)
    rivals = extend(start, relaxations, experiment)[:1]
    rivals += [item for model in rivals for item in extend(model, springs, experiment)[:1]]
    return [item for item in rivals if item.test_rms <= _MAX_ERROR_RATIO * result.model.test_rms]


TISSUE_STEPS = (
    repair_sensor_faults,
    estimate_noise_floor,
    check_motion,
    check_direction,
    leave_out_unshown,
    *SEARCH,
    reweigh_errors,
    find_ties,
    compare_zeros,
    compare_with_linear_dynamics,
    check_lead,
    report_zeros,
    check_one_ramp,
    check_rate_independence,
    report_noise,
    compare_records,
    search_formula,
)
PENDULUM_STEPS = (estimate_noise_floor, *SEARCH, reweigh_errors, find_ties, report_zeros)
