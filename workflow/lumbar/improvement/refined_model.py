"""A refined model as plain data: for ``refined.json``, the tables and the export."""

from __future__ import annotations

from lumbar.improvement.fitting import Fit
from lumbar.improvement.preparation import Experiment
from lumbar.improvement.search import Candidate
from lumbar.improvement.uncertainty import estimates


def model_name(fit: Fit) -> str:
    """Base and effects, e.g. ``"KB+coulomb_friction"``."""
    return "+".join([fit.structure.base.name, *fit.structure.effects])


def model_entry(candidate: Candidate, experiment: Experiment) -> dict:
    """Return one model with all that is needed to simulate it, its errors and its parameters with intervals."""
    fit = candidate.fit
    base_amplitudes, base_shapes = len(fit.structure.base.amplitudes), len(fit.structure.base.shapes)
    effects, amplitude, shape = [], base_amplitudes, base_shapes
    for form in fit.structure.forms:
        effects.append(
            {
                "effect": form.effect,
                "form": form.name,
                "amplitudes": fit.amplitudes[amplitude : amplitude + len(form.amplitudes)],
                "shapes": fit.shapes[shape : shape + len(form.shapes)],
            }
        )
        amplitude += len(form.amplitudes)
        shape += len(form.shapes)
    found = estimates(fit, experiment.training, experiment.input_unit, experiment.output_unit)
    return {
        "name": model_name(fit),
        "base": fit.structure.base.name,
        "amplitudes": fit.amplitudes[:base_amplitudes],
        "shapes": fit.shapes[:base_shapes],
        "effects": effects,
        "trained_on": experiment.training.name,
        "train_rms": candidate.train_rms,
        "test_rms": candidate.test_rms,
        "parameters": [vars(item) for item in found],
    }


def refined_document(ladder: list[Candidate], experiment: Experiment, data: str) -> dict:
    """Return the content of ``refined.json``: every rung of the ladder as a model."""
    return {
        "schema": "lumbar.refined/1",
        "data": data,
        "sampling_time_s": experiment.training.motion.sampling_time,
        "input_unit": experiment.input_unit,
        "output_unit": experiment.output_unit,
        "noise_floor_rms": None if experiment.floor is None else experiment.floor.rms,
        "models": [model_entry(item, experiment) for item in ladder],
    }
