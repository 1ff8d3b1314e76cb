"""Entries of models.json for models with effects: every form with C code once, and some combinations."""

from pathlib import Path

import numpy as np
import yaml
from periodic_records import record

from lumbar.tissue.effects.catalogue import TISSUE, catalogues_with
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.twin.examples import example_records

BASE_NUMBERS = {
    "LE": ([0.8], []),
    "Maxwell": ([6.0], [0.04]),
    "KV": ([0.8, 0.02], []),
    "KB": ([0.8, 6.0], [0.04]),
    "pendulum": ([0.002, 0.02, -0.9], []),
}

QUASI_LINEAR_NUMBERS = {
    "QLV": ([0.5, 2.0], [0.8, 0.04]),
    "QLV-2": ([0.5, 2.0, 3.0], [0.8, 0.02, 0.5]),
    "QLV-power": ([0.6], [0.8, 0.01, 0.2]),
}
"""Linear and nonlinear parameters of the quasi-linear bases."""
FORM_NUMBERS = yaml.safe_load(Path(__file__).with_name("effect_numbers.yaml").read_text(encoding="utf-8"))


def effect_entry(base: str, *keys: str, **more) -> dict:
    """Entry of a base with effects in these forms."""
    added = {key: FORM_NUMBERS[key] for key in keys}
    return {**entry_of_effects(base, added, TISSUE), **more}


def base_model(base: str = "KB") -> FittedModel:
    """Return a base with known parameters and without effects."""
    return FittedModel.from_json(effect_entry(base), catalogues_with([]))


def record_of_model(model: FittedModel, position: np.ndarray, error, name: str = "multisine"):
    """Return a record of a model's force and an error, a function of position, velocity and time."""
    made = record(position, np.zeros(len(position)), name)
    error = error(position, np.gradient(position, made.sampling_time), made.time)
    return made.with_values(output=model.simulate(made) + error)


def records_of_effect(key: str) -> list:
    """Return the example's motions on a Kelvin–Boltzmann tissue with one effect, and noise of 0.01 N."""
    model = FittedModel.from_json(effect_entry("KB", key), catalogues_with([]))
    records, random = [], np.random.default_rng(50)
    for item in example_records():
        force = model.simulate(item)
        records.append(item.with_values(output=force + 0.01 * random.standard_normal(len(force))))
    return records


def entry_of_effects(base: str, added: dict[str, tuple[list, list]], catalogue) -> dict:
    """Entry of a base with effects: linear and nonlinear parameters by key of the form, in its own order."""
    found = [("", BASES[base], {**BASE_NUMBERS, **QUASI_LINEAR_NUMBERS}[base])]
    for key, numbers in added.items():
        effect, form = key.split("/")
        found.append((effect, next(item for item in catalogue[effect].forms if item.name == form), numbers))
    return {
        "name": "+".join([base, *(effect for effect, *_ in found[1:])]),
        "base": base,
        "structure": {"effects": [{"effect": effect, "form": form.name} for effect, form, _ in found[1:]]},
        "sampling_time": 0.01,
        "input": {"quantity": "position", "unit": "mm"},
        "output": {"quantity": "force", "unit": "N"},
        "trained_on": "multisine",
        "estimator": "output_error",
        "parameters": [
            parameter(item.name, value, effect)
            for effect, part, numbers in found
            for items, values in zip((part.linear, part.nonlinear), numbers, strict=True)
            for item, value in zip(items, values, strict=True)
        ],
    }


def parameter(name: str, value, effect: str = "") -> dict:
    """Parameter of an entry."""
    return {"name": name, "symbol": "", "unit": "", "value": value, "effect": effect}


COMBINATIONS = (
    ("KB", "coulomb_friction/stribeck", "hysteresis/bouc_wen", "inertia/mass"),
    ("KV", "backlash/play", "delay/pure", "softening/whole_force", "saturation/soft"),
    ("Maxwell", "delay/pure", "second_relaxation/maxwell_branch", "contact_loss/soft", "drift/settling"),
    ("LE", "hardening_stiffness/exponential", "periodic_disturbance/sine"),
)
"""Base and forms."""


FIVE_EFFECTS = effect_entry(
    "KB",
    "delay/pure",
    "coulomb_friction/stribeck",
    "hysteresis/bouc_wen",
    "hardening_stiffness/exponential",
    "softening/path",
)
"""As many effects as a model on a device is likely to have, each of another kind."""
