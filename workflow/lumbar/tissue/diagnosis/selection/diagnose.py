"""A diagnosis as a sequence of named steps: from records to the physical effect that a base model is missing."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.linear.direction import direction_or_sign
from lumbar.tissue.diagnosis.selection.alternatives import (
    check_lead,
    compare_with_linear_dynamics,
    compare_zeros,
    report_zeros,
)
from lumbar.tissue.diagnosis.selection.base_choice import SEARCH, find_base, reweigh_errors
from lumbar.tissue.diagnosis.selection.forward_selection import find_ties
from lumbar.tissue.diagnosis.selection.rates import check_rate_independence, compare_records
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult, DiagnosisState, Status, run
from lumbar.tissue.diagnosis.sensors.sensor_faults import repair
from lumbar.tissue.effects.catalogue import usable_effects
from lumbar.tissue.models.bases import Base


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
        experiment = Experiment.as_recorded(state.records, settings)
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
