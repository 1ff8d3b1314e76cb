"""Entries of models.json for models with effects: every form with C code once, and some combinations."""

from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES

BASE_NUMBERS = {
    "LE": ([0.8], []),
    "Maxwell": ([6.0], [0.04]),
    "KV": ([0.8, 0.02], []),
    "KB": ([0.8, 6.0], [0.04]),
    "pendulum": ([0.002, 0.02, -0.9], []),
}

FORM_NUMBERS = {
    "hardening_stiffness/cubic": ([0.02], []),
    "hardening_stiffness/exponential": ([0.2], [1.5]),
    "hardening_stiffness/bilinear": ([0.7], [0.9]),
    "hardening_stiffness/power": ([0.02], [3.3]),
    "strain_softening/cubic": ([0.005], []),
    "strain_softening/bilinear": ([0.2], [0.9]),
    "quadratic_stiffness/quadratic": ([-0.1], []),
    "quadratic_stiffness/two_sided": ([0.3], []),
    "quadratic_stiffness/rounded": ([0.3], [0.4]),
    "quadratic_stiffness/deep": ([0.3], [0.4]),
    "quadratic_stiffness/shallow": ([0.3], [0.4]),
    "coulomb_friction/coulomb": ([0.8], [0.7]),
    "coulomb_friction/arctangent": ([0.8], [0.7]),
    "coulomb_friction/stribeck": ([0.5, 0.4], [0.6, 4.0]),
    "hysteresis/dahl": ([0.6], [0.3]),
    "hysteresis/bouc_wen": ([0.6], [0.3]),
    "hysteresis/bouc_wen_general": ([0.6], [0.3, 1.2]),
    "hysteresis/elastoplastic": ([0.6], [0.3]),
    "hysteresis/iwan": ([0.6, 0.3, 0.2, 0.1], [0.9]),
    "contact_loss/sharp": ([], [0.5]),
    "contact_loss/soft": ([], [0.5, 0.1]),
    "depth_dependent_damping/bilinear": ([0.01, 0.02], []),
    "depth_dependent_damping/one_sided": ([0.01, 0.02], []),
    "depth_dependent_damping/hunt_crossley": ([0.01, 0.02], [1.4]),
    "viscous_damping/dashpot": ([0.01], []),
    "quadratic_damping/quadratic": ([0.0005], []),
    "quadratic_damping/power": ([0.002], [1.7]),
    "quadratic_damping/sinh": ([0.1], [20.0]),
    "inertia/mass": ([2e-4], []),
    "second_relaxation/maxwell_branch": ([0.5], [0.7]),
    "relaxation_spectrum/power_law": ([0.1], [5.0, 0.4]),
    "delay/pure": ([], [0.0234]),
    "saturation/sharp": ([], [2.0]),
    "saturation/soft": ([], [3.0]),
    "saturation/rounded": ([], [2.0, 5.0]),
    "drift/linear": ([0.01], []),
    "drift/settling": ([0.4], [2.0]),
    "drift/power": ([0.1], [0.6]),
    "softening/path": ([0.3], [40.0]),
    "softening/time": ([0.3], [3.0]),
    "softening/path_to_floor": ([0.3], [40.0]),
    "softening/whole_force": ([], [0.3, 40.0]),
    "periodic_disturbance/sine": ([0.2, -0.1], [1.234]),
    "periodic_disturbance/overtones": (
        [0.2, -0.1, 0.1, 0.05, -0.04, 0.03, 0.02, 0.02, 0.02, -0.01, 0.01, 0.0, 0.004, 0.003],
        [1.234],
    ),
    "backlash/play": ([], [0.2]),
}
"""Linear and nonlinear parameters by form: positions of a few mm, forces of a few N."""


def effect_entry(base: str, *keys: str, **more) -> dict:
    """Entry of a base with effects in these forms."""
    added = {key: FORM_NUMBERS[key] for key in keys}
    return {**entry_of_effects(base, added, TISSUE), **more}


def entry_of_effects(base: str, added: dict[str, tuple[list, list]], catalogue) -> dict:
    """Entry of a base with effects: linear and nonlinear parameters by key of the form, in its own order."""
    found = [("", BASES[base], BASE_NUMBERS[base])]
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
