"""A refined model as a `FittedModel`: for ``refined.json``, Table 3.1 and the export."""

from __future__ import annotations

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import derived_estimates, estimates
from lumbar.tissue.diagnosis.selection.forward_selection import Candidate
from lumbar.tissue.identification.metrics import fit_ratio, mean_residual, variance_accounted_for
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.model_data import OUTPUT_ERROR, FittedParameter, Port, Scores
from lumbar.tissue.models.models_file import models_document
from lumbar.tissue.signals.motion_range import motion_range


def model_name(fit: Fit) -> str:
    """Base and effects, e.g. ``"KB+coulomb_friction"``."""
    return "+".join([fit.structure.base.name, *fit.structure.effects])


def fitted_model(candidate: Candidate, experiment: Experiment) -> FittedModel:
    """Return one model with its parameters, the elements of its base and its errors.

    One-step errors, ridge and condition number belong to difference equations and are left empty.
    """
    fit, training = candidate.fit, experiment.training
    units = experiment.input_unit, experiment.output_unit
    parameters = estimates(fit, training, *units)
    try:
        derived, refused = derived_estimates(fit, training, *units), ""
    except NumericalError as error:
        derived, refused = [], str(error)
    vaf, fit_percent, residual = _free_run(fit, training)
    scores = Scores(
        vaf_percent=vaf,
        fit_percent=fit_percent,
        mean_residual=residual,
        tests=tuple(test.name for test in experiment.tests),
        vaf_tests_percent=tuple(_free_run(fit, test)[0] for test in experiment.tests),
        nmse_tests=(None,) * len(experiment.tests),
        train_rms=candidate.train_rms,
        test_rms=candidate.test_rms,
        free_parameters=len(parameters),
        rank=len(parameters),
        mru_percent=_largest_relative_uncertainty(parameters),
    )
    return FittedModel(
        name=model_name(fit),
        structure=fit.structure,
        sampling_time=training.motion.sampling_time,
        input=Port(experiment.input_quantity, experiment.input_unit, experiment.surface),
        output=Port(experiment.output_quantity, experiment.output_unit, fit.zero),
        base=fit.structure.base.name,
        estimator=OUTPUT_ERROR,
        trained_on=training.name,
        parameters=(*parameters, *derived),
        no_parameters_because=refused,
        scores=scores,
        remark="base and effects fitted together by free-run simulation error",
        valid_for=motion_range(training.motion.position + experiment.surface, training.motion.sampling_time),
    )


def refined_document(path: list[Candidate], experiment: Experiment, data: str) -> dict:
    """Return the content of ``refined.json``: every model of the path whose base has a name by which it can be read back."""
    floor = None if experiment.floor is None else experiment.floor.rms
    named = [item for item in path if item.fit.structure.base.name in BASES]
    return models_document([fitted_model(item, experiment) for item in named], data, floor)


def _free_run(fit: Fit, data: FitData) -> tuple[float, float, float]:
    """VAF, FIT and mean residual of the free run, both signals about their means as for the identified models."""
    measured, simulated = data.settled(data.force), data.settled(fit.simulate(data.motion))
    measured, simulated = measured - np.mean(measured), simulated - np.mean(simulated)
    return tuple(metric(measured, simulated) for metric in (variance_accounted_for, fit_ratio, mean_residual))


def _largest_relative_uncertainty(parameters: list[FittedParameter]) -> float | None:
    """MRU (Eq. 3.16) from the intervals; a parameter at its bound 0, to rounding, has no relative uncertainty."""
    relative = [
        100 * (item.high - item.low) / (2 * 1.96 * abs(item.value))
        for item in parameters
        if abs(item.value) > 1e-8 * max(abs(item.low), abs(item.high))
    ]
    return max(relative, default=None)
