"""A refined model as plain data: for ``refined.json``, the tables and the export."""

from __future__ import annotations

import numpy as np

from lumbar.effects.base import BASES
from lumbar.effects.catalogue import choose
from lumbar.effects.effect import Effect
from lumbar.effects.motion import Motion
from lumbar.effects.structure import Structure
from lumbar.errors import InputError
from lumbar.improvement.angle import for_base
from lumbar.improvement.fitting import Fit
from lumbar.improvement.preparation import Experiment
from lumbar.improvement.search import Candidate
from lumbar.improvement.uncertainty import estimates
from lumbar.records.record import Record


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
    amplitudes = np.concatenate([entry["amplitudes"], *(item["amplitudes"] for item in entry["effects"])])
    shapes = np.concatenate([entry["shapes"], *(item["shapes"] for item in entry["effects"])])
    motion = Motion.of(for_base(record, structure.base), offset=entry["input_offset"])
    return structure.simulate(motion, amplitudes, shapes) + entry["output_offset"]
