"""Addition of effects named by the user: base and effects are refitted jointly; and sentences on the error ladder."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import check_excited, derived_estimates, estimates
from lumbar.tissue.diagnosis.selection import sentences
from lumbar.tissue.diagnosis.selection.base_choice import find_base
from lumbar.tissue.diagnosis.selection.candidate import Candidate, is_adequate, order_effects
from lumbar.tissue.diagnosis.selection.forward_selection import exchange, extend
from lumbar.tissue.effects.catalogue import choose, usable_effects
from lumbar.tissue.identification.metrics import free_run_errors
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.fitted_model import FittedModel, models_document
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.model_data import OUTPUT_ERROR, MotionRange, Port, Scores
from lumbar.tissue.models.motion import SpatialMotion
from lumbar.tissue.models.structure import ForwardStructure
from lumbar.tissue.signals.spectrum import motion_range


def model_name(fit: Fit) -> str:
    """Return the names of base and effects, e.g. ``"KB+coulomb_friction"``."""
    return "+".join([fit.structure.base.name, *fit.structure.effects])


def fitted_model(candidate: Candidate, experiment: Experiment) -> FittedModel:
    """Return a model with parameters, elements and errors; one-step errors, ridge and condition number are empty."""
    fit, training = candidate.fit, experiment.training
    units = experiment.input_unit, experiment.output_unit
    parameters, spatial = estimates(fit, training, *units), fit.structure.base.spatial
    structure, base = fit.structure, fit.structure.base.name
    if spatial is not None:
        # Axes that were found are those of the model; how far they may be turned from there are further numbers.
        fixed = spatial.freeze(fit.nonlinear[: len(spatial.nonlinear)])
        structure, base = replace(structure, base=fixed.structural), spatial.base.name
        signed = {item.name for item in spatial.nonlinear if item.signed}
        turning = {item.name for item in spatial.turning}
        for index, item in enumerate(parameters):
            if item.name in signed and not item.effect:
                low, high, derived = item.low - item.value, item.high - item.value, item.name in turning
                parameters[index] = replace(item, value=0.0, low=low, high=high, derived=derived)
    try:
        # Elements are springs and dashpots, from position to force, also if the force is the input.
        between = units[::-1] if isinstance(structure, ForwardStructure) else units
        derived, failure = derived_estimates(fit, training, *between), ""
    except NumericalError as error:
        derived, failure = [], str(error)
    # MRU (Eq. 3.16) from the intervals; a parameter at its bound 0, to rounding, has no relative uncertainty.
    uncertainties = [
        100 * (item.high - item.low) / (2 * 1.96 * abs(item.value))
        for item in parameters
        if item.value and abs(item.value) > 1e-8 * max(abs(item.low), abs(item.high))
    ]
    scores = Scores(
        **_free_run(fit, training),
        tests=tuple(test.name for test in experiment.tests),
        vaf_tests_percent=tuple(_free_run(fit, test)["vaf_percent"] for test in experiment.tests),
        nmse_tests=(None,) * len(experiment.tests),
        train_rms=candidate.train_rms,
        test_rms=candidate.test_rms,
        free_parameters=len(parameters),
        rank=len(parameters),
        mru_percent=max(uncertainties, default=None),
    )
    return FittedModel(
        name=model_name(fit).replace(" ", "_"),  # a file may have the name
        structure=structure,
        sampling_time=training.motion.sampling_time,
        input=Port(experiment.input_quantity, experiment.input_unit, experiment.surface),
        output=Port(experiment.output_quantity, experiment.output_unit, 0.0 if spatial else fit.zero),
        base=base,
        estimator=OUTPUT_ERROR,
        trained_on=training.name,
        parameters=(*parameters, *derived),
        no_parameters_because=failure,
        scores=scores,
        remark="base and effects fitted together by free-run simulation error",
        valid_for=None if experiment.points else _valid_for(experiment),
        zeros=tuple(fit.zeros.reshape(-1, len(spatial.axes)).mean(axis=0).tolist()) if spatial else (),
        rests=experiment.rest if spatial and any(experiment.rest) else (),
    )


def _valid_for(experiment: Experiment) -> MotionRange:
    """Return the ranges of the motion of the training records; with several axes, the ranges over all axes."""
    motion = experiment.training.motion
    if not isinstance(motion, SpatialMotion):
        return motion_range(motion.position + experiment.surface, motion.sampling_time)
    moving = [part for part in motion.parts if np.ptp(part.position) > 0]
    along = [motion_range(part.position, part.sampling_time) for part in moving]
    ends = {"lowest": min, "highest": max, "speed": max, "lowest_Hz": min, "highest_Hz": max}
    return MotionRange(**{key: end(getattr(item, key) for item in along) for key, end in ends.items()})


def refined_document(path: list[Candidate], experiment: Experiment, source_label: str) -> dict:
    """Return the content of ``refined.json``: every model of the path with a base that can be read back by name."""
    models = []
    for item in path:
        base = item.fit.structure.base
        if base.is_user_defined or base.spatial or base.name in BASES:
            models.append(fitted_model(item, experiment))
    return models_document(models, source_label, None if experiment.floor is None else experiment.floor.rms)


def _free_run(fit: Fit, data: FitData) -> dict[str, float]:
    """Return the errors of the free run; means are subtracted from both signals, as for identified models."""
    measured, simulated = data.trim(data.force), data.trim(fit.simulate(data.motion))
    return free_run_errors(measured - np.mean(measured), simulated - np.mean(simulated))


def refine(
    records: list[Record], effects: list[str], settings: DiagnosisSettings
) -> tuple[Experiment, list[Candidate]]:
    """Add effects to a base model in the order given, each in the form that fits best.

    Effects are names in the catalogue of the settings, which also define base and training record. The returned candidates are
    the models from the base to the last model, each with one more effect.

    Raises
    ------
    InputError
        For an unknown effect, an effect that needs channels missing in the records, and an effect that the training record does
        not excite.
    NumericalError
        If a fit with effects does not converge, or an effect makes the model worse on the training record.
    """
    chosen = {effect.name: effect for effect in choose(effects, settings.candidates)}
    if settings.forward:
        from lumbar.tissue.diagnosis.forward.forward_diagnosis import refine_forward

        return refine_forward(records, chosen, settings)
    experiment = Experiment.from_records(records, settings)
    # Each effect with the forms that the records' channels allow.
    usable, left_out = usable_effects(chosen, experiment.training.motion.channels, experiment.training.scale)
    for name in chosen:
        if name not in usable:
            missing = {role: None for form, roles in left_out if form.effect == name for role in roles}
            raise InputError(f"{name} needs channels that the records do not have: {', '.join(missing)}")
    surfaced, base = find_base(experiment, settings.base, usable)
    path = add_in_turn(surfaced, base, usable)
    if experiment.error_dwarfs_noise(path[-1].train_rms):
        surfaced, base = find_base(experiment.drop_whitening(), settings.base, usable)
        path = add_in_turn(surfaced, base, usable)
    return surfaced, path


def add_in_turn(experiment: Experiment, first: Candidate, chosen: dict[str, Effect]) -> list[Candidate]:
    """Add effects one after the other, each in the form that fits best; return the models from the base to the last.

    Raises
    ------
    InputError, NumericalError
        See `refine`.
    """
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
        if set(best.effects) == chosen.keys():
            path[-1] = order_effects(best, chosen)  # in the order given, as the models before
    if chosen and not path[-1].fit.converged:
        raise NumericalError(
            f"{first.fit.structure.base.name} with {', '.join(chosen)}: the fit on {experiment.training.name} did not converge; "
            "the data may not excite what is asked"
        )
    return path


def ladder_sentences(path: Sequence[Candidate], experiment: Experiment) -> list[str]:
    """Return sentences on the models of a path and their errors, then on the noise floor and the verdict.

    The verdict reports whether the last model leaves only noise, and which effects gain no more than their parameters cost: the
    gain is the log-likelihood of all records, the cost half the logarithm of their size for every parameter (Schwarz, Ann.
    Statist. 6 (1978) 461-464).
    """
    unit, floor, model = experiment.output_unit, experiment.floor, path[-1]
    training = sentences.distinguishing_digits([item.train_rms for item in path], 4)
    unseen = sentences.distinguishing_digits([item.test_rms for item in path], 4)
    names = [path[0].fit.structure.base.name, *(f"+ {name}" for name in model.effects)]
    changes = [""]
    for before, after in pairwise(path):
        change = 100 * (after.test_rms / before.test_rms - 1)
        changes.append(f" ({change:+.2g} %)" if abs(change) < 10 else f" ({change:+.0f} %)")
    lines = [
        f"{name}: {trained} {unit} in training, {other} on {experiment.test_data}{change}"
        for name, trained, other, change in zip(names, training, unseen, changes, strict=True)
    ]
    still = "still " if model.effects else ""
    if floor is None:
        verdict = f"Verdict: it is unknown whether something is {still}missing."
    else:
        times = sentences.times_floor(max(model.train_rms, model.test_rms), floor)
        left = f"the remaining error is at most {times} times the noise floor"
        verdict = f"Verdict: something is {still}missing: {left}; locate shows where it is."
        if is_adequate(model, experiment):
            verdict = f"Verdict: {left}, only noise as far as these records show."
    idle = [after.effects[-1] for before, after in pairwise(path) if after.score >= before.score]
    if idle:
        verdict += f" These records do not support {sentences.effects_text(idle)}: no more is gained than parameters cost."
    if len(idle) < len(path) - 1:
        verdict += " Use diagnose to see whether other effects do as well."
    return [*lines, sentences.noise_sentence(experiment), verdict]
