"""Effects that the user names, added to the base of forward records one after the other."""

from __future__ import annotations

from lumbar.base.errors import InputError, NumericalError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.joint_fit import add, fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.forward.carried import carried, response_of
from lumbar.tissue.diagnosis.forward.forward_base import shortened, simulated
from lumbar.tissue.diagnosis.forward.forward_diagnosis import forward_catalogue, prepared_base
from lumbar.tissue.diagnosis.selection.forward_selection import Candidate, evaluate
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.forward_structure import ForwardStructure
from lumbar.tissue.models.structure import Structure


def refine_forward(
    records: list[Record], effects: dict[str, Effect], settings: DiagnosisSettings
) -> tuple[Experiment, list[Candidate]]:
    """Add effects in the order given, each in the form that fits best turned round, all refitted by simulation.

    Parameters
    ----------
    records : list of Record
        With the force as channel ``input`` and the motion as ``output``.

    Returns
    -------
    Experiment
    list of Candidate
        The path: base, base and first effect, ….

    Raises
    ------
    InputError
        For an effect that cannot be simulated from force to motion, or that the base has itself.
    NumericalError
        If an effect makes the model worse.
    """
    experiment, base = prepared_base(records, settings)
    model = base.fit.structure.base
    usable = forward_catalogue(effects, model)
    for name in effects:
        if name not in usable:
            known = ", ".join(forward_catalogue(settings.candidates, model))
            raise InputError(
                f"{name}: it cannot be added to {model.name} from force to motion; those that can are {known}"
            )
    short = shortened(experiment)
    seen = carried(short, response_of(model, base.fit.linear, base.fit.nonlinear))
    turned, path = evaluate(fit_base(Structure(model), seen.training), seen), [_on(experiment, base)]
    for effect in usable.values():
        added = [evaluate(add(turned.fit, form, seen.training), seen) for form in effect.forms]
        turned = min(added, key=lambda item: item.score)
        structure = ForwardStructure(model, turned.fit.structure.forms)
        found = simulated(short, structure, turned.fit.linear, turned.fit.nonlinear, path[-1].fit.zero)
        found = _on(experiment, found)
        if found.fit.squared_error > path[-1].fit.squared_error * (1 + 1e-6):
            raise NumericalError(
                f"{effect.name}: added, it raises the error on {experiment.training.name} from {path[-1].train_rms:.4g} to "
                f"{found.train_rms:.4g} {experiment.output_unit}; leave it out"
            )
        path.append(found)
    return experiment, path


def _on(experiment: Experiment, model: Candidate) -> Candidate:
    """A model that was fitted to the beginning of records, fitted to all of them."""
    if shortened(experiment) is experiment:
        return model
    fit = model.fit
    return simulated(experiment, fit.structure, fit.linear, fit.nonlinear, fit.zero)
