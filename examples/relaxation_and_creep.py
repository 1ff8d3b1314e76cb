"""Stress-relaxation and creep tests of two known tissues, as records: python examples/relaxation_and_creep.py FOLDER.

Relaxation: F = ∫ (t − s + 0.02 s)^−0.2 dσ(z(s)), σ = exp(z / 0.5 mm) − 1, ramps of 1, 4 and 15 s to 2 mm, held for 60 s.
Creep: 0.5 ż + 1.2 z + 0.3 z³ = F, three weights of 0.5, 1.5 and 3 N in turn, 20 s each, then 20 s without weight.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import fftconvolve

NOISE_N, NOISE_MM = 0.03, 0.005
FINE_S, STEP_S = 0.005, 0.05


def relaxation(ramp_s: float, noise: np.random.Generator) -> np.ndarray:
    """Return time (s), position (mm) and force (N) of one test in columns."""
    time = np.arange(0, 60, FINE_S)
    position = 2 * np.clip(time / ramp_s, 0, 1)
    changes = np.diff(np.expm1(position / 0.5), prepend=0)
    force = fftconvolve(changes, (time + 0.02) ** -0.2)[: len(time)] * 10 / np.expm1(4)
    force += NOISE_N * noise.standard_normal(len(time))
    return np.column_stack([time, position, force])[:: round(STEP_S / FINE_S)]


def creep(noise: np.random.Generator) -> np.ndarray:
    """Return time (s), position (mm) and force (N) of a test with weights in columns."""
    time = np.arange(0, 80, STEP_S)
    weights = np.array([0.5, 1.5, 3.0, 0.0])
    position = np.zeros(len(time))
    for number, weight in enumerate(weights):
        part = slice(400 * number, 400 * (number + 1) + 1)
        begin = position[part][0]
        motion = solve_ivp(
            lambda _, z, weight=weight: (weight - 1.2 * z - 0.3 * z**3) / 0.5,
            (0, 20),
            [begin],
            t_eval=np.linspace(0, 20, len(position[part])),
            rtol=1e-8,
        )
        position[part] = motion.y[0]
    measured = position + NOISE_MM * noise.standard_normal(len(time))
    return np.column_stack([time, measured, np.repeat(weights, 400)])


if __name__ == "__main__":
    generator = np.random.default_rng(1)
    tests = {f"relaxation/ramp_{ramp}s.csv": relaxation(ramp, generator) for ramp in (1, 4, 15)}
    tests["creep/weights.csv"] = creep(generator)
    for name, columns in tests.items():
        path = Path(sys.argv[1]) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, columns, fmt="%.6g", delimiter=",", header="time_s,position_mm,force_N", comments="")
