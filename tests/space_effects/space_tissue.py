"""Force of a tissue in several axes with hidden effects, integrated on a grid 40 times finer than the samples.

Nothing here comes from the project: the cases are to judge its models.
"""

import numpy as np
from scipy.signal import lfilter
from space_motions import Motion


def branch(motion: Motion, tau_s: float) -> np.ndarray:
    """Elongation q of a Maxwell branch, q' = v - q/τ, q(0) = 0, exact for speeds linear within a step."""
    x = motion.step / tau_s
    late = tau_s * (1 + np.expm1(-x) / x)
    early = -tau_s * np.expm1(-x) - late
    driven = np.zeros_like(motion.velocity)
    driven[1:] = early * motion.velocity[:-1] + late * motion.velocity[1:]
    return lfilter([1.0], [1.0, -np.exp(-x)], driven, axis=0)


def dahl_state(motion: Motion, distance_mm: float) -> np.ndarray:
    """State r of r' = (v - |v| r)/d, r(0) = 0, exact for steps along a line."""
    steps = np.diff(motion.position, axis=0)
    lengths = np.linalg.norm(steps, axis=1, keepdims=True)
    decay = np.exp(-lengths / distance_mm)
    gained = steps / np.maximum(lengths, 1e-300) * (1 - decay)
    state = np.zeros_like(motion.position)
    for n in range(len(steps)):
        state[n + 1] = decay[n] * state[n] + gained[n]
    return state


def along(vector: np.ndarray, smoothing: float) -> np.ndarray:
    """Direction of a vector, smoothed about zero: tanh(|v|/v_s) v/|v|."""
    size = np.linalg.norm(vector, axis=1, keepdims=True)
    return np.tanh(size / smoothing) * vector / np.maximum(size, 1e-300)


def _square(vector: np.ndarray) -> np.ndarray:
    return np.sum(vector**2, axis=1, keepdims=True)


def _softening(motion: Motion, ks: float, s0: float) -> np.ndarray:
    return ks * motion.position * np.expm1(-motion.path / s0)[:, None]


def _contact(motion: Motion, k: float, n: list[float], d0: float, mu: float, vs: float) -> np.ndarray:
    normal = np.array(n)
    pressed = k * np.maximum(motion.position @ normal - d0, 0)[:, None]
    sliding = motion.velocity - np.outer(motion.velocity @ normal, normal)
    return pressed * (normal + mu * along(sliding, vs))


ADDED = {
    "coulomb_friction": lambda motion, Fc, vs: Fc * along(motion.velocity, vs),
    "hysteresis": lambda motion, Fh, d: Fh * dahl_state(motion, d),
    "hardening_stiffness": lambda motion, k3: k3 * _square(motion.position) * motion.position,
    "quadratic_damping": lambda motion, c2: c2 * np.sqrt(_square(motion.velocity)) * motion.velocity,
    "inertia": lambda motion, m: m * motion.acceleration,
    "softening": _softening,
    "contact_plane": _contact,
}
"""Force that each effect adds to the tissue's, N, by its name in the catalogue."""


def base_force(tissue: dict, motion: Motion) -> np.ndarray:
    """Force K_e z + B v + K_1 q of those matrices that the tissue has."""
    force = np.zeros_like(motion.position)
    if "K_e" in tissue:
        force += motion.position @ np.array(tissue["K_e"])
    if "B" in tissue:
        force += motion.velocity @ np.array(tissue["B"])
    if "K_1" in tissue:
        force += branch(motion, tissue["tau_s"]) @ np.array(tissue["K_1"])
    return force


def tissue_force(truth: dict, motion: Motion) -> np.ndarray:
    """Force on the tool, N: the tissue's and what effects add."""
    force = base_force(truth["tissue"], motion)
    for name, parameters in truth["effects"].items():
        if name in ADDED:
            force = force + ADDED[name](motion, **parameters)
    return force


def measured_force(truth: dict, motion: Motion) -> np.ndarray:
    """Force that the sensor tells, N, without zero and noise: late, turned or coupled, drifting, clipped, in this order."""
    force, effects = tissue_force(truth, motion), truth["effects"]
    if "delay" in effects:
        late = round(effects["delay"]["Td"] / motion.step)
        rest = tissue_force(truth, motion.hold_first_position())[:1]
        force = np.concatenate([np.repeat(rest, late, axis=0), force[: len(force) - late]])
    force = force @ np.array(truth["sensor"]).T
    if "drift" in effects:
        force = force + np.outer(motion.time, effects["drift"]["r"])
    if "saturation" in effects:
        limits = np.array([np.inf if limit is None else limit for limit in effects["saturation"]["Fs"]])
        force = np.clip(force, -limits, limits)
    return force
