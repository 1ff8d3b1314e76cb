"""A refined model as plain data: for ``refined.json``, the tables and the export."""

from __future__ import annotations

import numpy as np

from lumbar.diagnosis.fitting.joint_fit import Fit
from lumbar.diagnosis.fitting.measured_angle import for_base
from lumbar.diagnosis.fitting.preparation import Experiment
from lumbar.diagnosis.fitting.uncertainty import estimates
from lumbar.diagnosis.selection.forward_selection import Candidate
from lumbar.effects.catalogue import choose
from lumbar.errors import InputError
from lumbar.models.bases import BASES
from lumbar.models.form import Effect
from lumbar.models.motion import Motion
from lumbar.models.structure import Structure
from lumbar.records.record import Record


def model_name(fit: Fit) -> str:
    """Base and effects, e.g. ``"KB+coulomb_friction"``."""
    return "+".join([fit.structure.base.name, *fit.structure.effects])


def model_entry(candidate: Candidate, experiment: Experiment) -> dict:
    """Return one model with all that is needed to simulate it, its errors and its parameters with intervals."""
    fit = candidate.fit
    base_linear, base_nonlinear = len(fit.structure.base.linear), len(fit.structure.base.nonlinear)
    effects, linear_parameter, shape = [], base_linear, base_nonlinear
    for form in fit.structure.forms:
        effects.append(
            {
                "effect": form.effect,
                "form": form.name,
                "amplitudes": fit.linear[linear_parameter : linear_parameter + len(form.linear)],
                "shapes": fit.nonlinear[shape : shape + len(form.nonlinear)],
            }
        )
        linear_parameter += len(form.linear)
        shape += len(form.nonlinear)
    found = estimates(fit, experiment.training, experiment.input_unit, experiment.output_unit)
    return {
        "name": model_name(fit),
        "base": fit.structure.base.name,
        "amplitudes": fit.linear[:base_linear],
        "shapes": fit.nonlinear[:base_nonlinear],
        "effects": effects,
        "input_offset": experiment.input_offset,
        "output_offset": experiment.output_offset,
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
        "input_quantity": experiment.input_quantity,
        "output_quantity": experiment.output_quantity,
        "input_unit": experiment.input_unit,
        "output_unit": experiment.output_unit,
        "noise_floor_rms": None if experiment.floor is None else experiment.floor.rms,
        "models": [model_entry(item, experiment) for item in ladder],
    }


def simulate_entry(entry: dict, record: Record, catalogue: dict[str, Effect]) -> np.ndarray:
    """Simulate a model from its plain data on a record, shape (samples,).

    Raises
    ------
    InputError
        If the entry names an effect or form that the catalogue does not have.
    """
    forms = []
    for item in entry["effects"]:
        (effect,) = choose([item["effect"]], catalogue)
        form = next((form for form in effect.forms if form.name == item["form"]), None)
        if form is None:
            raise InputError(f"{entry['name']}: {item['effect']} has no form {item['form']!r}")
        forms.append(form)
    structure = Structure(BASES[entry["base"]], tuple(forms))
    linear = np.concatenate([entry["amplitudes"], *(item["amplitudes"] for item in entry["effects"])])
    nonlinear = np.concatenate([entry["shapes"], *(item["shapes"] for item in entry["effects"])])
    motion = Motion.of(for_base(record, structure.base), offset=entry["input_offset"])
    return structure.simulate(motion, linear, nonlinear) + entry["output_offset"]
