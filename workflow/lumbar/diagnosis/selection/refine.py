"""Adding effects that the user names: base and effects refitted jointly, never worse than the base."""

from __future__ import annotations

from lumbar.diagnosis.fitting.diagnosis_settings import DiagnosisSettings, prepare_for
from lumbar.diagnosis.fitting.identifiability import check_excited
from lumbar.diagnosis.fitting.preparation import Experiment
from lumbar.diagnosis.selection.base_choice import choose_base
from lumbar.diagnosis.selection.forward_selection import Candidate, exchange, extend
from lumbar.diagnosis.selection.refined_model import fitted_model, model_name
from lumbar.effects.catalogue import choose, without_channels
from lumbar.errors import InputError, NumericalError
from lumbar.models.fitted_model import FittedModel
from lumbar.models.form import Effect
from lumbar.records.record import Record


def refine(
    records: list[Record], effects: list[str], settings: DiagnosisSettings
) -> tuple[Experiment, list[Candidate]]:
    """Add effects to a base model in the order given, each in the form that fits best.

    Parameters
    ----------
    records : list of Record
    effects : list of str
        Names in the catalogue.
    settings : DiagnosisSettings
        Base, training record, periods and catalogue.

    Returns
    -------
    Experiment
    list of Candidate
        The ladder: base, base and first effect, ….

    Raises
    ------
    InputError
        For an unknown effect, for one that needs channels which the records do not have, and for one that the training
        record does not excite.
    NumericalError
        If a fit does not converge, or an effect makes the model worse on the record it is fitted to.
    """
    chosen = {effect.name: effect for effect in choose(effects, settings.candidates)}
    experiment = prepare_for(records, settings)
    chosen = _with_channels(chosen, experiment)
    surfaced, ladder = _climbed(experiment, chosen, settings.base)
    if experiment.error_dwarfs_noise(ladder[-1].train_rms):
        surfaced, ladder = _climbed(experiment.unwhitened(), chosen, settings.base)
    return surfaced, ladder


def refined_fit(records: list[Record], effects: list[str], settings: DiagnosisSettings) -> FittedModel:
    """Refine a base model by these effects and return the last model of the ladder.

    Parameters
    ----------
    records : list of Record
    effects : list of str
        Effects to add to the base.
    settings : DiagnosisSettings
        ``train`` names the training record.
    """
    experiment, ladder = refine(records, effects, settings)
    return fitted_model(ladder[-1], experiment)


def _climbed(
    experiment: Experiment, chosen: dict[str, Effect], base: str
) -> tuple[Experiment, list[Candidate]]:
    """Records from the tissue's surface on, and ladder of fitted models: base, base and first effect, ….

    Raises
    ------
    InputError, NumericalError
        As `refine`.
    """
    experiment, first = choose_base(experiment, base, chosen)
    ladder = [first]
    for name in chosen:
        # The best by likelihood and number of parameters: a form with more of them always fits a little better.
        rung = extend(ladder[-1], {name: chosen[name]}, experiment)[0]
        if rung.fit.squared_error > ladder[-1].fit.squared_error * (1 + 1e-6):
            raise NumericalError(
                f"{name}: added to {model_name(ladder[-1].fit)} it raises the error on {experiment.training.name} from "
                f"{ladder[-1].train_rms:.4g} to {rung.train_rms:.4g} {experiment.output_unit}; leave it out"
            )
        form = rung.fit.structure.forms[-1]
        nonlinear = rung.fit.nonlinear[len(ladder[-1].fit.nonlinear) :]
        check_excited(ladder[-1].fit, form, experiment.training, nonlinear, model_name(ladder[-1].fit))
        ladder.append(rung)
    if len(chosen) > 1:
        # Forms were chosen one by one; with all effects in place another form of one may fit better.
        best = exchange(ladder[-1], chosen, experiment)
        ladder[-1] = best if set(best.effects) == set(chosen) else ladder[-1]
    if not ladder[-1].fit.converged:
        raise NumericalError(
            f"{first.fit.structure.base.name} with {', '.join(chosen)}: the fit on {experiment.training.name} did not converge; "
            "the data may not excite what is asked"
        )
    return experiment, ladder


def _with_channels(chosen: dict[str, Effect], experiment: Experiment) -> dict[str, Effect]:
    """Return the effects with the forms that the records' channels allow."""
    usable, left_out = without_channels(chosen, experiment.training.motion.channels)
    for name in chosen:
        if name not in usable:
            missing = {role: None for form, roles in left_out if form.effect == name for role in roles}
            raise InputError(f"{name} needs channels that the records do not have: {', '.join(missing)}")
    return usable
