"""How fast V may grow on the boundary of an ellipse: the largest V̇/ρ on V = x̄ᵀSx̄ = ρ, with the true sine.

The ellipse is the unit circle in normal coordinates z, chosen so that the first one is the angle:

    e = √ρ·a·z1,   ω = √ρ·(p·z1 + q·z2),   a = √(s22/det S),  p = −a·s12/s22,  q = 1/√s22

so that s12·e + s22·ω = √(ρ·s22)·z2 and, along an S(t) with −Ṡ = M + SA_c + A_cᵀS under the linear loop A_c,

    V̇/ρ = −(α·z1² + 2β·z1·z2 + γ·z2²) − κ·z2·h(√ρ·a·z1),   κ = 2·(σmgℓ/I)·√(s22/ρ)

where [[α, β], [β, γ]] is M in normal coordinates and h the remainder of the sine. For the solution of Eq. 4.2 with
the feedback of Eq. 4.4 M is Q + SBR⁻¹BᵀS. On the circle this is a function of one angle; its maximum is found by
sampling and Newton's method.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from lumbar.lifting.stability.model.pendulum_loop import Pendulums, remainder
from lumbar.lifting.stability.model.riccati import determinant

SAMPLES = 48
"""Points on the boundary among which Newton's starts are chosen, for semi-axes up to `SMALL_SEMI_AXIS`."""
SECTORS = 4
"""Parts of the boundary that each give one start, likewise."""
SMALL_SEMI_AXIS = 2.0
"""Largest |e| on the ellipse in rad for which these are enough: a wider one has more peaks."""
MOST_DOUBLINGS = 4
"""How often samples and sectors are doubled for wider ellipses."""
LARGEST_SEMI_AXIS = SMALL_SEMI_AXIS * 2**MOST_DOUBLINGS
"""Largest |e| in rad up to which the maximum is reliable: five turns, beyond any useful basin."""
NEWTON_STEPS = 2


@cache
def _circle(samples: int) -> tuple[np.ndarray, ...]:
    """Cos φ, sin φ, cos²φ, 2·cos φ·sin φ, sin²φ at the samples."""
    position = np.linspace(0.0, 2 * np.pi, samples, endpoint=False)
    c, s = np.cos(position), np.sin(position)
    return c, s, c**2, 2 * c * s, s**2


@dataclass(frozen=True)
class NormalForm:
    """V̇/ρ in normal coordinates, apart from the level ρ; every entry has shape (..., pendulums)."""

    angle: np.ndarray
    amplitude: np.ndarray
    alpha: np.ndarray
    beta: np.ndarray
    gamma: np.ndarray
    coupling: np.ndarray
    """2·(σmgℓ/I)·√s22: κ is this divided by √ρ."""


def normal_form(pendulums: Pendulums, angle: np.ndarray, cost: np.ndarray, decay: np.ndarray) -> NormalForm:
    """Bring the closed loop into normal coordinates.

    Parameters
    ----------
    angle : numpy.ndarray, shape (..., pendulums)
        θ0 in rad.
    cost, decay : numpy.ndarray, shape (..., pendulums, 3)
        S of V = x̄ᵀSx̄ and M = −V̇ of the linear loop.
    """
    s22 = cost[..., 2]
    m11, m12, m22 = np.moveaxis(decay, -1, 0)
    a, p, q = normal_axes(cost)
    return NormalForm(
        angle=angle,
        amplitude=a,
        alpha=m11 * a**2 + 2 * m12 * a * p + m22 * p**2,
        beta=(m12 * a + m22 * p) * q,
        gamma=m22 * q**2,
        coupling=2 * pendulums.gravity_torque / pendulums.inertia * np.sqrt(s22),
    )


def normal_axes(cost: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a, p, q of the ellipse x̄ᵀSx̄ = 1: e = a·z1, ω = p·z1 + q·z2 with z on the unit circle."""
    s12, s22 = cost[..., 1], cost[..., 2]
    amplitude = np.sqrt(s22 / determinant(cost))
    return amplitude, -amplitude * s12 / s22, 1 / np.sqrt(s22)


def boundary_growth(form: NormalForm, level: np.ndarray) -> np.ndarray:
    """Return the largest V̇/ρ on the boundary V = ρ in 1/s.

    Parameters
    ----------
    form : NormalForm
        Entries of shape (...,).
    level : numpy.ndarray, shape (...)
        ρ > 0; axes before those of `form` are levels of the same pendulums.

    Returns
    -------
    numpy.ndarray, shape (...)
        The boundary moves inward everywhere if this is negative; {V ≤ ρ(t)} is invariant as long as ρ̇/ρ
        is not below it.
    """
    root = np.sqrt(level)
    semi_axis, kappa = form.amplitude * root, form.coupling / root
    doublings = int(np.clip(np.ceil(np.log2(semi_axis.max() / SMALL_SEMI_AXIS)), 0, MOST_DOUBLINGS))
    values = _growth_samples(form, semi_axis, kappa, SAMPLES << doublings)
    start, sampled = _candidates(values, SECTORS << doublings)
    polished = _newton(form, semi_axis, kappa, start, 2 * np.pi / values.shape[-1])
    return np.maximum(sampled, polished).max(axis=-1)


def _growth_samples(form: NormalForm, semi_axis: np.ndarray, kappa: np.ndarray, samples: int) -> np.ndarray:
    c, s, c2, cs2, s2 = _circle(samples)
    values = kappa[..., None] * s * remainder(form.angle[..., None], semi_axis[..., None] * c)
    values += form.alpha[..., None] * c2
    values += form.beta[..., None] * cs2
    values += form.gamma[..., None] * s2
    return np.negative(values, out=values)


def _candidates(values: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return position and height of the highest sample in each of `count` sectors, shape (..., count).

    The growth is nearly the same on opposite sides of the ellipse, so the highest sample of all may belong
    to the lower of two peaks: every sector's best is polished.
    """
    samples = values.shape[-1]
    sectors = values.reshape(*values.shape[:-1], count, samples // count)
    start = (sectors.argmax(axis=-1) + np.arange(count) * (samples // count)) * (2 * np.pi / samples)
    return start, sectors.max(axis=-1)


def _newton(
    form: NormalForm, semi_axis: np.ndarray, kappa: np.ndarray, start: np.ndarray, spacing: float
) -> np.ndarray:
    """Climb from each start to its peak and return the heights, shape (..., starts).

    The quadratic part of V̇/ρ is −((α + γ)/2 + Re(((α − γ)/2 − iβ)·z²)) of z = exp iφ.
    """
    angle, semi_axis, kappa = form.angle[..., None], semi_axis[..., None], kappa[..., None]
    half = (0.5 * (form.alpha - form.gamma) - 1j * form.beta)[..., None]
    mean = (0.5 * (form.alpha + form.gamma))[..., None]
    sine, cosine = np.sin(angle), np.cos(angle)
    position = start
    for _ in range(NEWTON_STEPS):
        z = np.exp(1j * position)
        quadratic = half * z * z
        s = z.imag
        error, across = semi_axis * z.real, semi_axis * s
        there = np.exp(1j * (angle + error))
        # The remainder of the sine and its slope: where to climb may be rounded, heights may not.
        h1 = there.real - cosine
        h = there.imag - sine - error * cosine
        slope = 2 * quadratic.imag - kappa * (z.real * h - across * s * h1)
        bend = 4 * quadratic.real + kappa * s * (h + 3 * error * h1 + across * across * there.imag)
        # A step is taken only where the function bends down, and never past the neighbouring samples.
        step = np.divide(-slope, bend, out=np.zeros_like(slope), where=bend < 0)
        position = position + np.minimum(np.maximum(step, -spacing), spacing)
    z = np.exp(1j * position)
    return -mean - (half * z * z).real - kappa * z.imag * remainder(angle, semi_axis * z.real)
