"""Diagnosis of forward records: named by what the turned-round records ask for, confirmed by simulation from force to motion."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.forward.forward_base import (
    EVALUATIONS,
    beginning,
    better_base,
    choose_forward_base,
    fit_by_simulation,
    prepare_forward,
    response_of,
    resume_fit,
    simulate_base,
    turn_round,
)
from lumbar.tissue.diagnosis.forward.sensor import sensor_candidates
from lumbar.tissue.diagnosis.selection.candidate import (
    Candidate,
    add_form,
    fit_base,
    is_adequate,
    unseen_improvement,
)
from lumbar.tissue.diagnosis.selection.findings import linear_alternative, offsets
from lumbar.tissue.diagnosis.selection.forward_selection import Selection
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult, Status
from lumbar.tissue.diagnosis.selection.thresholds import TIED, UNSEEN
from lumbar.tissue.effects.catalogue import MOTION_SENSOR, with_forms_that
from lumbar.tissue.models.bases import CHOSEN_BY_DATA, Base
from lumbar.tissue.models.driven_motion import can_be_simulated
from lumbar.tissue.models.form import Effect, Form
from lumbar.tissue.models.structure import ForwardStructure

_RIVALS = 5
"""Sets of effects, beside those named, that are simulated."""
_LEAST_EXPLAINED = 0.05
"""Share of the motion's variance that a base must explain for effects to be looked for beside it."""
_POLISHED = 4
"""Evaluations of the error on all of long records, from the fit to their beginning."""


def diagnose_forward(records: list[Record], settings: DiagnosisSettings) -> DiagnosisResult:
    """Diagnose what a base model is missing on forward records (force in, motion out).

    The records have the force as channel ``input`` and the motion as ``output``. The verdict is in the unit of the
    motion; its fits simulate from force to motion.

    Raises
    ------
    InputError
        For a base with contact, and for records that cannot be used.
    """
    experiment, base = prepare_with_base(records, settings)
    found = _diagnose(beginning(experiment), base, settings)
    if found.experiment is not experiment:
        found = _on_all(found, experiment, settings)
    found = _behind_sensor(found, settings)
    findings = [replace(item, kind="motion_offset") for item in offsets(found)]
    adequate = is_adequate(found.model, experiment)
    alternative = None if adequate else linear_alternative(found.model, experiment)
    if alternative is not None:
        # Where linear dynamics of higher order surely explain more, they are told and nothing is named.
        found = replace(found, status=Status.UNEXPLAINED, tied_with=[], refined_status=Status.UNEXPLAINED)
        findings.append(alternative[1])
    return replace(found, findings=tuple(findings), diagnosed_again=False)


def prepare_with_base(records: list[Record], settings: DiagnosisSettings) -> tuple[Experiment, Candidate]:
    """Forward records ready for a diagnosis, and the base that is named or that they ask for, on their beginning."""
    experiment = prepare_forward(records, settings)
    base = choose_forward_base(beginning(experiment), settings.base)
    if experiment.error_dwarfs_noise(base.train_rms):
        experiment = experiment.without_whitening()
        base = resume_fit(beginning(experiment), base)
    return experiment, base


def forward_catalogue(catalogue: dict[str, Effect], base: Base, data: FitData) -> dict[str, Effect]:
    """The effects that can be simulated from force to motion, without what the base has itself, as large as the data ask."""
    known = set(base.form.parsed_equation.columns)

    def new(form: Form) -> bool:
        return can_be_simulated(form) and not known >= set(form.parsed_equation.columns)

    return with_forms_that(catalogue, new, data.scale)


def _diagnose(experiment: Experiment, base: Candidate, settings: DiagnosisSettings) -> DiagnosisResult:
    """Name by the turned-round records, keep what simulation confirms; once effects are known, ask for the base again."""
    data = experiment.training
    if base.train_rms**2 > (1 - _LEAST_EXPLAINED) * float(np.var(data.trim(data.force))):
        # The motion hardly follows the force: nothing can be carried through a response that is not there.
        return Confirmation(experiment, base, settings).result()
    found, seen = _diagnose_with_base(experiment, base, settings)
    if settings.base != CHOSEN_BY_DATA or not found.selected:
        return found
    other = better_base(found.model, seen)
    return (
        found
        if other is None
        else _diagnose_with_base(experiment, simulate_base(experiment, other), settings)[0]
    )


def _diagnose_with_base(
    experiment: Experiment, base: Candidate, settings: DiagnosisSettings
) -> tuple[DiagnosisResult, Experiment]:
    """A diagnosis with one base, and the turned-round records that it was searched on."""
    model = base.fit.structure.base
    usable = replace(settings, catalogue=forward_catalogue(settings.searched, model, experiment.training))
    response = response_of(model, base.fit.linear, base.fit.nonlinear)
    seen = turn_round(experiment, response)
    named = Selection(seen, fit_base(model, seen), usable).result()
    rivals = [*named.tied_with, *(item.candidate for item in named.ranking)]
    # A constant force moves what it acts on by the static response.
    static = float(response(np.zeros(1))[0].real)
    judge = Confirmation(experiment, base, usable, named.path[1:], rivals, lambda fit: -fit.zero * static)
    return judge.result(), seen


def _on_all(found: DiagnosisResult, experiment: Experiment, settings: DiagnosisSettings) -> DiagnosisResult:
    """The same models fitted to all of long records and judged there, with the best rival."""
    base = resume_fit(experiment, found.base, _POLISHED)
    model, data = base.fit.structure.base, experiment.training
    usable = replace(settings, catalogue=forward_catalogue(settings.searched, model, data))
    rivals = [item.candidate for item in found.ranking if set(item.candidate.effects) != set(found.selected)]
    named = [*found.path[1:], *found.tied_with, *rivals[:1]]
    return Confirmation(experiment, base, usable, named, evaluations=_POLISHED).result()


def _behind_sensor(found: DiagnosisResult, settings: DiagnosisSettings) -> DiagnosisResult:
    """Linear dynamics behind a sensor that is not linear, where they explain all records better than all that was tried."""
    experiment = found.experiment
    if is_adequate(found.model, experiment):
        return found
    forms = {name: settings.candidates[name].forms for name in MOTION_SENSOR}
    best = min([found.model.score, *(item.candidate.score for item in found.ranking)])
    for before, after in sorted(sensor_candidates(experiment, forms), key=lambda pair: pair[1].score):
        judge = Selection(experiment, before, settings, singles=[])
        surely = unseen_improvement(found.model, after, experiment) > UNSEEN
        if not (surely and after.score < best - TIED and judge.passes(before, after)):
            continue
        judge.tried = [after]
        share = judge.share_removed(after)
        return replace(
            found,
            base=before,
            status=judge.status(after, [], share),
            path=[before, after],
            tied_with=[],
            ranking=[*judge.ranking(after), *found.ranking],
            explainable_share_removed=share,
            refined_status=judge.refined_status(after, None),
        )
    return found


class Confirmation(Selection):
    """Keeps what passes by simulation, as the search does by the turned-round records.

    Parameters
    ----------
    experiment : Experiment
        Forward records.
    base : Candidate
        Simulated on them.
    settings : DiagnosisSettings
    named, rivals : sequence of Candidate
        Models that were named, and others.
    zero_of : callable
        From a fit of theirs to the zero of the motion's sensor.
    evaluations : int
        Of the error, at most, to fit one of them.
    """

    def __init__(
        self,
        experiment: Experiment,
        base: Candidate,
        settings: DiagnosisSettings,
        named: Sequence[Candidate] = (),
        rivals: Sequence[Candidate] = (),
        zero_of: Callable[[Fit], float] = lambda fit: fit.zero,
        evaluations: int = EVALUATIONS,
    ):
        super().__init__(experiment, base, settings, singles=[])
        self.named = named
        self.rivals = rivals
        self.zero_of = zero_of
        self.evaluations = evaluations

    @cached_property
    def selected_path(self) -> list[Candidate]:
        """Simulate what was named, and its rivals; from the base on to larger sets that pass, the best of each step."""
        self.simulate(self.named)
        rivals = self.rivals
        best = min([self.base, *self.tried], key=lambda item: item.score)
        if is_adequate(best, self.experiment):
            # What is larger explains nothing more.
            rivals = [item for item in rivals if len(item.effects) <= len(best.effects)]
        self.simulate(rivals[:_RIVALS])
        path = [self.base]
        while larger := [item for item in self.tried if self.follows(path[-1], item)]:
            path.append(min(larger, key=lambda item: (len(item.effects), item.score)))
        return path

    def simulate(self, models: Sequence[Candidate]) -> None:
        """Fit models by their simulation, each set of forms once."""
        known = {item.fit.structure.forms for item in self.tried}
        for item in models:
            structure = ForwardStructure(self.base.fit.structure.base, item.fit.structure.forms)
            if structure.forms and structure.forms not in known:
                known.add(structure.forms)
                start = item.fit.linear, item.fit.nonlinear, self.zero_of(item.fit)
                found = fit_by_simulation(self.experiment, structure, *start, self.evaluations)
                if np.isfinite(found.score):
                    self.tried.append(found)

    def fitted_on(self, model: Candidate) -> Candidate:
        """The same model, its simulation fitted from where it ended."""
        return resume_fit(self.experiment, model, self.evaluations)

    def follows(self, before: Candidate, after: Candidate) -> bool:
        """Whether a larger set may be selected after another one."""
        may = self.passes if before is self.base else self.is_further
        return set(after.effects) > set(before.effects) and may(before, after)

    def further(self, model: Candidate) -> Candidate | None:
        """What was not named turned round is not looked for."""
        return None


def refine_forward(
    records: list[Record], effects: dict[str, Effect], settings: DiagnosisSettings
) -> tuple[Experiment, list[Candidate]]:
    """Add effects in the order given, each in the form that fits best turned round, all refitted by simulation.

    The records have the force as channel ``input`` and the motion as ``output``. The candidates are the path: base,
    base and first effect, ….

    Raises
    ------
    InputError
        For an effect that cannot be simulated from force to motion, or that the base has itself.
    NumericalError
        If an effect makes the model worse.
    """
    experiment, base = prepare_with_base(records, settings)
    model = base.fit.structure.base
    usable = forward_catalogue(effects, model, experiment.training)
    for name in effects:
        if name not in usable:
            known = ", ".join(forward_catalogue(settings.candidates, model, experiment.training))
            raise InputError(
                f"{name}: it cannot be added to {model.name} from force to motion; those that can are {known}"
            )
    short = beginning(experiment)
    seen = turn_round(short, response_of(model, base.fit.linear, base.fit.nonlinear))
    turned = fit_base(model, seen)
    path = [base if short is experiment else resume_fit(experiment, base)]
    for effect in usable.values():
        added = [add_form(turned, form, seen) for form in effect.forms]
        turned = min(added, key=lambda item: item.score)
        structure = ForwardStructure(model, turned.fit.structure.forms)
        start = turned.fit.linear, turned.fit.nonlinear, path[-1].fit.zero
        found = fit_by_simulation(short, structure, *start)
        found = found if short is experiment else resume_fit(experiment, found)
        if found.fit.squared_error > path[-1].fit.squared_error * (1 + 1e-6):
            raise NumericalError(
                f"{effect.name}: added, it raises the error on {experiment.training.name} from {path[-1].train_rms:.4g} to "
                f"{found.train_rms:.4g} {experiment.output_unit}; leave it out"
            )
        path.append(found)
    return experiment, path
