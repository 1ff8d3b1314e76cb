"""The passivity condition of a sampled virtual environment: how much damping a device needs for any passive hand.

J. E. Colgate and G. G. Schenkel, Passivity of a class of sampled-data systems: application to haptic interfaces, Journal
of Robotic Systems 14 (1997) 37–47: a device with damping b behind a hold of the force of H(z) is passive if and only if

    b > T/2 · 1/(1 − cos ωT) · Re{(1 − exp(−jωT)) H(exp(jωT))}   for 0 ≤ ω ≤ π/T.

With the force late by a part τ of the sampling time the same argument holds with another disc. The sampled admittance of
hand and device is −(1 − exp(−jωT))/T · Σₙ exp(−jωₙτ) Yₙ/ωₙ², ωₙ = ω + 2πn/T, and every Yₙ may lie anywhere in the disc of
centre and radius 1/(2b). Its characteristic equation has no root for any of them where |2b − L S(τ)| > |L| S(0), with
L = (1 − exp(−jωT)) H/T and S(τ) = Σₙ exp(−jωₙτ)/ωₙ²; the condition above is τ = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.tissue.haptics.closed_loop import SampledModel, all_angles

_REFINED = 101


@dataclass(frozen=True)
class RequiredDamping:
    """Damping that makes a device passive with a model, and the frequency that asks for it."""

    damping: float
    """N·s/m; 0 where the model needs none."""
    frequency: float
    """Hz."""


def alias_sums(model: SampledModel, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """S(0) and S(τ) of the condition at every angle, in s²; shapes of `angles`."""
    period, forward = model.sampling_time, np.exp(1j * angles)
    in_time = period**2 / (2.0 * (1.0 - np.cos(angles)))
    if not model.delay:
        return in_time, in_time.astype(complex)
    # −T times the transform of max(kT − τ, 0), a double integrator sampled late.
    return in_time, -period * (period * forward / (forward - 1.0) ** 2 - model.delay / (forward - 1.0))


def damping_at(model: SampledModel, angles: np.ndarray) -> np.ndarray:
    """Damping that the condition asks for at every angle ωT.

    Parameters
    ----------
    angles : numpy.ndarray
        Radians in (0, π].

    Returns
    -------
    numpy.ndarray
        N·s/m, shape of `angles`.
    """
    loop = (1.0 - np.exp(-1j * angles)) * model.response(angles) / model.sampling_time
    in_time, late = alias_sums(model, angles)
    shifted = loop * late
    if not model.delay:
        return shifted.real
    # In exact arithmetic |S(τ)| ≤ S(0): the root is real.
    inside = np.abs(loop * in_time) ** 2 - shifted.imag**2
    return (shifted.real + np.sqrt(np.maximum(inside, 0.0))) / 2.0


def required_damping(model: SampledModel, points: int = 2000) -> RequiredDamping:
    """Return the smallest damping with which the device is passive, whatever passive hand holds it.

    Parameters
    ----------
    model : SampledModel
        Stable; its gain counts.
    points : int
        Angles at which the condition is looked at before the neighbourhood of the worst is looked at again.
    """
    angles = all_angles(points)
    worst = int(damping_at(model, angles).argmax())
    angles = np.linspace(angles[max(worst - 1, 0)], angles[min(worst + 1, len(angles) - 1)], _REFINED)
    values = damping_at(model, angles)
    worst = int(values.argmax())
    frequency = angles[worst] / (2.0 * np.pi * model.sampling_time)
    return RequiredDamping(max(float(values[worst]), 0.0), float(frequency))
