"""Which physical effect a model is missing: from records to a verdict."""

from __future__ import annotations

from dataclasses import replace

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings, prepare_for
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.linear.direction import direction_or_sign
from lumbar.tissue.diagnosis.linear.linear_dynamics import nonlinear_share
from lumbar.tissue.diagnosis.selection.base_choice import base_beside, choose_base, linear_base
from lumbar.tissue.diagnosis.selection.candidate import Candidate, fit_base, is_adequate, refit
from lumbar.tissue.diagnosis.selection.findings import (
    apparent_zeros,
    linear_alternative,
    offsets,
    zeros_moved,
)
from lumbar.tissue.diagnosis.selection.forward_selection import Selection
from lumbar.tissue.diagnosis.selection.verdict import Verdict
from lumbar.tissue.effects.catalogue import usable_effects
from lumbar.tissue.models.bases import CHOSEN_BY_DATA, Base

_NONLINEAR = 0.1
"""Share of what the best linear model leaves that is surely not linear, from which on something nonlinear is missing."""
_ZEROS_HELP = 0.9
"""Factor on the unseen error below which a zero of its own for every record is taken."""


def diagnose(records: list[Record], settings: DiagnosisSettings | None = None) -> Verdict:
    """Diagnose what a base model is missing on a set of records.

    There is one record per excitation, with channels ``input`` and ``output``.

    Raises
    ------
    InputError
        For an unknown base and for records that cannot be used (`prepare`).
    """
    settings = settings or DiagnosisSettings()
    if settings.forward:
        from lumbar.tissue.diagnosis.forward.forward_diagnosis import diagnose_forward

        return diagnose_forward(records, settings)
    experiment = prepare_for(records, settings)
    usable, not_tried = usable_effects(
        settings.candidates, experiment.training.motion.channels, experiment.training.scale
    )
    settings = replace(settings, catalogue=usable)
    if settings.system == "tissue" and not isinstance(settings.base, Base):
        # As recorded: a command that jumps between levels would be taken for a coarse sensor, and smoothed.
        as_recorded = settings.prepare(records) if experiment.faults else experiment
        turned = direction_or_sign(as_recorded, settings.layout)
        if turned is not None:
            return replace(_unexplained(as_recorded, settings, turned), not_tried=not_tried)
    found = _search(experiment, settings)
    if experiment.error_dwarfs_noise(found.model.train_rms):
        found = _search(experiment.without_whitening(), settings)
    found, zeros = _with_own_zeros(found, settings)
    found, linear = _beside_linear(found, settings)
    return replace(
        found, not_tried=not_tried, findings=(*experiment.faults, *offsets(found), *zeros, *linear)
    )


def _with_own_zeros(found: Verdict, settings: DiagnosisSettings) -> tuple[Verdict, list[Finding]]:
    """Search again with a zero of its own for every record, where the model or a smaller one does much better with them.

    Where records differ in their zeros, what accumulates (a drift) may pass for the difference. Where they do not, a model that
    lacks a relaxation would have them differ all the same: a zero of its own counts only where the record begins with it.
    """
    experiment = found.experiment
    if settings.system != "tissue" or experiment.own_zeros:
        return found, []
    with_zeros = experiment.with_own_zeros()

    def helps(item: Candidate) -> bool:
        refitted = refit(item.fit.structure, item.fit.nonlinear, with_zeros)
        return refitted.test_rms < _ZEROS_HELP * item.test_rms

    accumulating = any(settings.candidates[name].accumulates for name in found.selected)
    if not (accumulating or any(helps(item) for item in found.path)):
        return found, []
    again = _search(with_zeros, settings)
    better = again.model.test_rms < _ZEROS_HELP * found.model.test_rms
    simpler = len(again.selected) < len(found.selected)
    as_good = again.model.test_rms < found.model.test_rms / _ZEROS_HELP
    if not (better or (simpler and as_good)):
        return found, []
    if zeros_moved(again):
        return again, []
    if set(found.selected) != set(again.selected):
        # What is named hangs on zeros that did not move.
        found = replace(found, verdict="unexplained", tied_with=[])
    after = "unexplained" if found.verdict_after == "adequate" else found.verdict_after
    return replace(found, verdict_after=after), [apparent_zeros(again)]


def _beside_linear(found: Verdict, settings: DiagnosisSettings) -> tuple[Verdict, list[Finding]]:
    """Ask whether linear dynamics of higher order explain more than the effects that were selected.

    If so, and nothing nonlinear is left beside them, only linear effects are searched for. If something nonlinear is, no
    effect of the catalogue explains it.
    """
    experiment = found.experiment
    only_linear = bool(found.selected) and all(settings.candidates[name].linear for name in found.selected)
    if settings.system != "tissue" or (is_adequate(found.model, experiment) and not only_linear):
        return found, []
    alternative = linear_alternative(found.model, experiment)
    if alternative is None:
        return found, []
    linear, finding = alternative
    base = linear_base(linear.fit)
    found = replace(found, linear=base and fit_base(base, experiment))
    if (nonlinear_share(experiment, linear.fit) or 0.0) > _NONLINEAR:
        return replace(found, verdict="unexplained", tied_with=[]), [finding]
    only = {name: effect for name, effect in settings.candidates.items() if effect.linear}
    if not set(found.selected) <= set(only):
        again = _search(experiment, replace(settings, catalogue=only))
        if linear_alternative(again.model, experiment) is None:
            return again, [finding]
        found = replace(again, linear=found.linear)
    return replace(found, verdict="unexplained", tied_with=[]), [finding]


def _unexplained(experiment: Experiment, settings: DiagnosisSettings, turned: Finding) -> Verdict:
    """No effect is looked for in records whose input and output, or a sign, are the wrong way round."""
    experiment, base = choose_base(experiment, settings.base, settings.candidates)
    return Verdict(experiment, base, "unexplained", [base], [], [], 0.0, "unexplained", findings=(turned,))


def _search(experiment: Experiment, settings: DiagnosisSettings) -> Verdict:
    """Choose the base and select effects; once they are known, choose the base again."""
    experiment, base = choose_base(experiment, settings.base, settings.candidates)
    found = Selection(experiment, base, settings).diagnosis()
    if settings.base != CHOSEN_BY_DATA or found.model is found.base:
        return found
    other = base_beside(found.model, experiment)
    if other is None:
        return found
    return Selection(*choose_base(experiment, other, settings.candidates), settings).diagnosis()
