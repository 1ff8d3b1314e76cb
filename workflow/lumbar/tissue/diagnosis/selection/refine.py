"""Adding effects that the user names: base and effects refitted jointly, never worse than the base."""

from __future__ import annotations

from lumbar.base.errors import InputError, NumericalError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings, prepare_for
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import check_excited
from lumbar.tissue.diagnosis.selection.base_choice import choose_base
from lumbar.tissue.diagnosis.selection.forward_selection import Candidate, exchange, extend
from lumbar.tissue.diagnosis.selection.refined_model import fitted_model, model_name
from lumbar.tissue.effects.catalogue import choose, without_channels
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.form import Effect


def refine(
    records: list[Record], effects: list[str], settings: DiagnosisSettings
) -> tuple[Experiment, list[Candidate]]:
    """Add effects to a base model in the order given, each in the form that fits best.

    Parameters
    ----------
    effects : list of str
        Names in the catalogue.
    settings : DiagnosisSettings
        Base, training record and catalogue.

    Returns
    -------
    Experiment
    list of Candidate
        The path: base, base and first effect, ….

    Raises
    ------
    InputError
        For an unknown effect, for one that needs channels which the records do not have, and for one that the training
        record does not excite.
    NumericalError
        If a fit does not converge, or an effect makes the model worse on the record it is fitted to.
    """
    chosen = {effect.name: effect for effect in choose(effects, settings.candidates)}
    if settings.forward:
        from lumbar.tissue.diagnosis.forward.forward_refine import refine_forward

        return refine_forward(records, chosen, settings)
    experiment = prepare_for(records, settings)
    chosen = _with_channels(chosen, experiment)
    surfaced, path = _added_in_turn(experiment, chosen, settings.base)
    if experiment.error_dwarfs_noise(path[-1].train_rms):
        surfaced, path = _added_in_turn(experiment.unwhitened(), chosen, settings.base)
    return surfaced, path


def refined_fit(records: list[Record], effects: list[str], settings: DiagnosisSettings) -> FittedModel:
    """Refine a base model by these effects and return the last model of the path.

    Parameters
    ----------
    effects : list of str
        Effects to add to the base.
    settings : DiagnosisSettings
        ``train`` names the training record.
    """
    experiment, path = refine(records, effects, settings)
    return fitted_model(path[-1], experiment)


def _added_in_turn(
    experiment: Experiment, chosen: dict[str, Effect], base: str
) -> tuple[Experiment, list[Candidate]]:
    """Records from the tissue's surface on, and path of fitted models: base, base and first effect, ….

    Raises
    ------
    InputError, NumericalError
        As `refine`.
    """
    experiment, first = choose_base(experiment, base, chosen)
    path = [first]
    for name in chosen:
        # The best by likelihood and number of parameters: a form with more of them always fits a little better.
        more = extend(path[-1], {name: chosen[name]}, experiment)[0]
        if more.fit.squared_error > path[-1].fit.squared_error * (1 + 1e-6):
            raise NumericalError(
                f"{name}: added to {model_name(path[-1].fit)} it raises the error on {experiment.training.name} from "
                f"{path[-1].train_rms:.4g} to {more.train_rms:.4g} {experiment.output_unit}; leave it out"
            )
        form = more.fit.structure.forms[-1]
        nonlinear = more.fit.nonlinear[len(path[-1].fit.nonlinear) :]
        check_excited(path[-1].fit, form, experiment.training, nonlinear, model_name(path[-1].fit))
        path.append(more)
    if len(chosen) > 1:
        # Forms were chosen one by one; with all effects in place another form of one may fit better.
        best = exchange(path[-1], chosen, experiment)
        path[-1] = best if set(best.effects) == set(chosen) else path[-1]
    if not path[-1].fit.converged:
        raise NumericalError(
            f"{first.fit.structure.base.name} with {', '.join(chosen)}: the fit on {experiment.training.name} did not converge; "
            "the data may not excite what is asked"
        )
    return experiment, path


def _with_channels(chosen: dict[str, Effect], experiment: Experiment) -> dict[str, Effect]:
    """Return the effects with the forms that the records' channels allow."""
    usable, left_out = without_channels(chosen, experiment.training.motion.channels)
    for name in chosen:
        if name not in usable:
            missing = {role: None for form, roles in left_out if form.effect == name for role in roles}
            raise InputError(f"{name} needs channels that the records do not have: {', '.join(missing)}")
    return usable
