"""Diagnosis of forward records: named by what the turned-round records ask for, confirmed by simulation from force to motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.forward.carried import carried, response_of
from lumbar.tissue.diagnosis.forward.confirmation import Confirmation
from lumbar.tissue.diagnosis.forward.forward_base import (
    better_base,
    chosen_base,
    prepared_forward,
    shortened,
    simulated,
    simulated_base,
)
from lumbar.tissue.diagnosis.forward.sensor import sensor_candidates
from lumbar.tissue.diagnosis.selection.forward_selection import (
    Candidate,
    evaluate,
    is_adequate,
    unseen_improvement,
)
from lumbar.tissue.diagnosis.selection.linear_gate import linear_alternative, linear_finding
from lumbar.tissue.diagnosis.selection.null_distribution import shipped
from lumbar.tissue.diagnosis.selection.offsets import offsets
from lumbar.tissue.diagnosis.selection.selection import Selection
from lumbar.tissue.diagnosis.selection.thresholds import TIED, UNSEEN
from lumbar.tissue.diagnosis.selection.verdict import Verdict
from lumbar.tissue.effects.catalogue import MOTION_SENSOR
from lumbar.tissue.models.bases import CHOSEN_BY_DATA, Base
from lumbar.tissue.models.force_balance import can_be_simulated
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.structure import Structure

_LEAST_EXPLAINED = 0.05
"""Share of the motion's variance that a base must explain for effects to be looked for beside it."""
_POLISHED = 4
"""Evaluations of the error on all of long records, from the fit to their beginning."""


def diagnose_forward(records: list[Record], settings: DiagnosisSettings) -> Verdict:
    """Diagnose what a base model is missing on forward records (force in, motion out).

    Parameters
    ----------
    records : list of Record
        With the force as channel ``input`` and the motion as ``output``.

    Returns
    -------
    Verdict
        In the unit of the motion; its fits simulate from force to motion.

    Raises
    ------
    InputError
        For a base with contact, and for records that cannot be used.
    """
    experiment, base = prepared_base(records, settings)
    found = _confirmed(shortened(experiment), base, settings)
    if found.experiment is not experiment:
        found = _on_all(found, experiment, settings)
    found, linear = _beside_linear(_behind_sensor(found, settings))
    zeros = [replace(item, kind="motion_offset") for item in offsets(found)]
    return replace(found, findings=(*zeros, *linear), diagnosed_again=False)


def prepared_base(records: list[Record], settings: DiagnosisSettings) -> tuple[Experiment, Candidate]:
    """Forward records ready for a diagnosis, and the base that is named or that they ask for, on their beginning."""
    experiment = prepared_forward(records, settings)
    base = chosen_base(shortened(experiment), settings.base)
    if experiment.error_dwarfs_noise(base.train_rms):
        experiment, fit = experiment.unwhitened(), base.fit
        base = simulated(shortened(experiment), fit.structure, fit.linear, fit.nonlinear, fit.zero)
    return experiment, base


def forward_catalogue(catalogue: dict[str, Effect], base: Base) -> dict[str, Effect]:
    """The effects that can be simulated from force to motion, without what the base has itself."""
    known = set(base.form.parsed.columns)
    found = {}
    for name, effect in catalogue.items():
        forms = tuple(
            form for form in effect.forms if can_be_simulated(form) and not known >= set(form.parsed.columns)
        )
        if forms:
            found[name] = replace(effect, forms=forms)
    return found


def _confirmed(experiment: Experiment, base: Candidate, settings: DiagnosisSettings) -> Verdict:
    """Name by the turned-round records, keep what simulation confirms; once effects are known, ask for the base again."""
    data = experiment.training
    if base.train_rms**2 > (1 - _LEAST_EXPLAINED) * float(np.var(data.settled(data.force))):
        # The motion hardly follows the force: nothing can be carried through a response that is not there.
        return Confirmation(experiment, base, settings).diagnosis()
    found, seen = _named(experiment, base, settings)
    if settings.base != CHOSEN_BY_DATA or not found.selected:
        return found
    other = better_base(found.model, seen)
    return found if other is None else _named(experiment, simulated_base(experiment, other), settings)[0]


def _named(
    experiment: Experiment, base: Candidate, settings: DiagnosisSettings
) -> tuple[Verdict, Experiment]:
    """A diagnosis with one base, and the turned-round records that it was searched on."""
    model = base.fit.structure.base
    usable = replace(settings, catalogue=forward_catalogue(settings.candidates, model))
    response = response_of(model, base.fit.linear, base.fit.nonlinear)
    seen = carried(experiment, response)
    turned = evaluate(fit_base(Structure(model), seen.training), seen)
    named = Selection(seen, turned, usable, shipped("tissue")).diagnosis()
    rivals = [*named.tied_with, *(item.candidate for item in named.ranking)]
    # A constant force moves what it acts on by the static response.
    static = float(response(np.zeros(1))[0].real)
    judge = Confirmation(experiment, base, usable, named.path[1:], rivals, lambda fit: -fit.zero * static)
    return judge.diagnosis(), seen


def _on_all(found: Verdict, experiment: Experiment, settings: DiagnosisSettings) -> Verdict:
    """The same models fitted to all of long records and judged there, with the best rival."""
    fit = found.base.fit
    base = simulated(experiment, fit.structure, fit.linear, fit.nonlinear, fit.zero, _POLISHED)
    usable = replace(settings, catalogue=forward_catalogue(settings.candidates, fit.structure.base))
    rivals = [item.candidate for item in found.ranking if set(item.candidate.effects) != set(found.selected)]
    named = [*found.path[1:], *found.tied_with, *rivals[:1]]
    return Confirmation(experiment, base, usable, named, evaluations=_POLISHED).diagnosis()


def _behind_sensor(found: Verdict, settings: DiagnosisSettings) -> Verdict:
    """Linear dynamics behind a sensor that is not linear, where they surely explain all records better."""
    experiment, null = found.experiment, shipped("tissue")
    if is_adequate(found.model, experiment):
        return found
    forms = {name: settings.candidates[name].forms for name in MOTION_SENSOR}
    for before, after in sorted(sensor_candidates(experiment, forms), key=lambda pair: pair[1].score):
        judge = Selection(experiment, before, settings, null, singles=[])
        surely = unseen_improvement(found.model, after, experiment) > UNSEEN
        if not (judge.passes(before, after) and surely and after.score < found.model.score - TIED):
            continue
        judge.tried = [after]
        share = judge.share_removed(after)
        return replace(
            found,
            base=before,
            verdict=judge.verdict(after, [], share),
            path=[before, after],
            tied_with=[],
            ranking=[*judge.ranking(after), *found.ranking],
            explainable_share_removed=share,
            verdict_after=judge.verdict_after(after, None),
        )
    return found


def _beside_linear(found: Verdict) -> tuple[Verdict, list[Finding]]:
    """Where linear dynamics of higher order surely explain more, they are told and nothing is named."""
    experiment = found.experiment
    if is_adequate(found.model, experiment):
        return found, []
    linear = linear_alternative(found.model, experiment)
    if linear is None:
        return found, []
    said = [linear_finding(linear, found.model, experiment)]
    return replace(found, verdict="unexplained", tied_with=[], verdict_after="unexplained"), said
