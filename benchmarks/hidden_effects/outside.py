"""Effects that no entry of the catalogue describes: the right answer to them is "unexplained".

Two of them are near neighbours of an entry, which may absorb part of them: a spring-pot's relaxation spectrum
looks like further Maxwell branches, and a branch with a power-law dashpot damps nonlinearly.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import fftconvolve

from hidden_effects.form import OUTSIDE, HiddenForm, additive, between
from lumbar.twin.two_hidden_effects import log_uniform

_STREAMS = {"multisine": 0, "chirp": 1, "noise": 2}


def texture(motion, tissue, strength, length_mm, phase_rad):
    """Stiffness that varies along the path with a short wavelength, as over fibres."""
    angle = 2 * np.pi * motion.position / length_mm + phase_rad
    return strength * (np.sin(angle) - np.sin(phase_rad))


def telegraph(motion, tissue, strength, dwell_s, event_seed):
    """Force that jumps between two values at random times, as a tool that touches a second structure."""
    rng = np.random.default_rng([event_seed, _STREAMS[motion.record]])
    duration = motion.step * len(motion.position)
    count = rng.poisson(duration / dwell_s)
    switches = np.sort(rng.uniform(0.0, duration, count))
    return strength * (-1.0) ** np.searchsorted(switches, motion.time)


def even_in_speed(motion, tissue, strength):
    """C v²: a force that grows with speed and does not change sign with it."""
    return strength * motion.velocity**2


def gain_flutter(motion, force, strength, band_Hz, event_seed):
    """Sensitivity that wanders at random in a low band."""
    rng = np.random.default_rng([event_seed, _STREAMS[motion.record]])
    lines = np.arange(1, 41) * band_Hz / 40
    phases, gains = rng.uniform(0, 2 * np.pi, len(lines)), rng.rayleigh(size=len(lines))
    # Lines below 2 Hz, so a spline through every twentieth point is exact to 10⁻⁸.
    knots = motion.time[:: motion.stride]
    wander = np.sin(2 * np.pi * np.outer(knots, lines) + phases) @ gains
    return force * (1 + strength * CubicSpline(knots, wander / wander.std())(motion.time))


def relaxation_with_depth(motion, tissue, strength, length_mm):
    """The branch relaxes the faster the deeper the tool: 1/τ times exp(strength tanh(z/length))."""
    rate = np.exp(strength * np.tanh(motion.position / length_mm)) / tissue.relaxation_s
    half = 0.5 * motion.step * rate
    before = np.concatenate([half[:1], half[:-1]])
    decay, gain = ((1 - before) / (1 + half)).tolist(), (tissue.relaxing / (1 + half)).tolist()
    change = np.diff(motion.position, prepend=motion.position[0]).tolist()
    force, value = [], 0.0
    for keep, share, moved in zip(decay, gain, change, strict=True):
        value = keep * value + share * moved
        force.append(value)
    return np.array(force) - (tissue.force(motion) - tissue.elastic * motion.position)


def spring_pot(motion, tissue, strength, order):
    """Fractional damping η dᵅz/dtᵅ from rest (Grünwald and Letnikov's sum)."""
    number = np.arange(1, len(motion.position))
    weights = np.concatenate([[1.0], np.cumprod((number - 1 - order) / number)])
    moved = motion.position - motion.position[0]
    return strength * fftconvolve(moved, weights)[: len(moved)] / motion.step**order


def power_law_branch(motion, tissue, strength, exponent):
    """A second Maxwell branch whose dashpot gives v ∝ F|F|^(p−1), of the tissue's own time constant at force F*.

    Ḟ = k v − (k/η) F |F/F*|^(p−1), with the rate of the last grid point (Rosenbrock–Euler).
    """
    stiffness = strength
    reference = stiffness * np.abs(motion.position).max() / 4
    rate = motion.step / tissue.relaxation_s
    change = (stiffness * np.diff(motion.position, prepend=motion.position[0])).tolist()
    force, value, power = [], 0.0, exponent - 1
    for moved in change:
        value = (value + moved) / (1 + rate * (abs(value) / reference) ** power)
        force.append(value)
    return np.array(force)


_FORCE = additive(lambda scales, **shape: 1.0)


def _seeded(rng):
    return {"event_seed": int(rng.integers(2**31))}


FORMS = (
    HiddenForm(
        OUTSIDE,
        "texture",
        "tissue",
        texture,
        "N",
        _FORCE,
        lambda rng, s: {
            "length_mm": s.amplitude * rng.uniform(0.08, 0.2),
            "phase_rad": float(rng.uniform(0, 2 * np.pi)),
        },
    ),
    HiddenForm(
        OUTSIDE,
        "telegraph",
        "tissue",
        telegraph,
        "N",
        _FORCE,
        lambda rng, s: {"dwell_s": log_uniform(rng, 0.3, 1.5), **_seeded(rng)},
    ),
    HiddenForm(
        OUTSIDE, "even_in_speed", "tissue", even_in_speed, "N s^2/mm^2", additive(lambda s: s.speed**2)
    ),
    HiddenForm(
        OUTSIDE,
        "gain_flutter",
        "sensor",
        gain_flutter,
        "1",
        between(1e-4, 0.6),
        lambda rng, s: {"band_Hz": log_uniform(rng, 0.5, 2.0), **_seeded(rng)},
    ),
    HiddenForm(
        OUTSIDE,
        "relaxation_with_depth",
        "tissue",
        relaxation_with_depth,
        "1",
        between(1e-3, 3.0),
        lambda rng, s: {"length_mm": s.amplitude * rng.uniform(0.2, 0.6)},
    ),
    HiddenForm(
        OUTSIDE,
        "spring_pot",
        "tissue",
        spring_pot,
        "N s^a/mm",
        additive(lambda s, order: s.speed**order * (0.5 * s.amplitude) ** (1 - order)),
        lambda rng, s: {"order": rng.uniform(0.3, 0.7)},
    ),
    HiddenForm(
        OUTSIDE,
        "power_law_branch",
        "tissue",
        power_law_branch,
        "N/mm",
        additive(lambda s, exponent: 0.5 * s.amplitude),
        lambda rng, s: {"exponent": rng.uniform(1.8, 3.0)},
    ),
)
