"""Effects of the measuring channel: delay, saturation, drift, disturbance."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from hidden_effects.form import HiddenForm, additive, between
from lumbar.twin.two_hidden_effects import BAND_HZ, log_uniform


def transport(motion, force, strength):
    """F(t − T): before the record the force was what it is at the start."""
    return CubicSpline(motion.time, force)(np.maximum(motion.time - strength, 0.0))


def all_pass(motion, force, strength):
    """First-order Padé approximant (1 − sT/2)/(1 + sT/2), by the trapezoidal rule."""
    ratio = strength / motion.step
    change = force - force[0]
    return force[0] + lfilter([(1 - ratio) / (1 + ratio), 1.0], [1.0, (1 - ratio) / (1 + ratio)], change)


def clipped(motion, force, strength):
    """The channel ends at ±F_s."""
    return np.clip(force, -strength, strength)


def soft_clip(motion, force, strength, sharpness):
    """Saturation with a rounded knee."""
    return force / (1 + np.abs(force / strength) ** sharpness) ** (1 / sharpness)


def tanh_clip(motion, force, strength):
    """F_s tanh(F/F_s)."""
    return strength * np.tanh(force / strength)


def linear_drift(motion, tissue, strength, duration_s):
    """Zero that moves evenly, by `strength` in `duration_s`."""
    return strength * motion.time / duration_s


def settling_drift(motion, tissue, strength, settling_s):
    """Zero that settles exponentially, as a warming amplifier's."""
    return -strength * np.expm1(-motion.time / settling_s)


def root_drift(motion, tissue, strength, duration_s):
    """Zero that moves as the square root of time, as by diffusion."""
    return strength * np.sqrt(motion.time / duration_s)


def creeping_drift(motion, tissue, strength, time_s):
    """Zero that moves as the logarithm of time, as a creeping load cell's."""
    return strength * np.log1p(motion.time / time_s)


def harmonics(motion, tissue, strength, frequency_Hz, phase_rad, overtones):
    """Periodic force with its overtones, unrelated to the motion."""
    angle = 2 * np.pi * frequency_Hz * motion.time + phase_rad
    return strength * sum(
        share * np.sin(order * angle) for order, share in enumerate((1.0, *overtones), start=1)
    )


def square_wave(motion, tissue, strength, frequency_Hz, phase_rad):
    """Force that switches between two values, as a pump's."""
    return strength * np.sign(np.sin(2 * np.pi * frequency_Hz * motion.time + phase_rad))


def _disturbance(rng, scales):
    # Off the multisine's lines: between two of them, at least 15 % of their spacing away from either.
    line = rng.integers(2, 45)
    return {
        "frequency_Hz": float(BAND_HZ[0] * (line + rng.uniform(0.15, 0.85))),
        "phase_rad": float(rng.uniform(0, 2 * np.pi)),
    }


_FORCE = additive(lambda scales, **shape: 1.0)
_LIMIT = lambda scales, **shape: (scales.peak, 0.5 * scales.force)  # noqa: E731

FORMS = (
    HiddenForm("delay", "transport", "sensor", transport, "s", between(1e-5, 0.04)),
    HiddenForm("delay", "all_pass", "sensor", all_pass, "s", between(1e-5, 0.04)),
    HiddenForm("saturation", "clip", "sensor", clipped, "N", _LIMIT),
    HiddenForm(
        "saturation",
        "rounded",
        "sensor",
        soft_clip,
        "N",
        lambda s, sharpness: (4 * s.peak, 0.5 * s.force),
        lambda rng, s: {"sharpness": rng.uniform(4.0, 10.0)},
    ),
    HiddenForm("saturation", "tanh", "sensor", tanh_clip, "N", lambda s: (20 * s.peak, 0.5 * s.force)),
    HiddenForm(
        "drift", "linear", "tissue", linear_drift, "N", _FORCE, lambda rng, s: {"duration_s": s.duration}
    ),
    HiddenForm(
        "drift",
        "settling",
        "tissue",
        settling_drift,
        "N",
        _FORCE,
        lambda rng, s: {"settling_s": s.duration * log_uniform(rng, 0.1, 0.6)},
    ),
    HiddenForm("drift", "root", "tissue", root_drift, "N", _FORCE, lambda rng, s: {"duration_s": s.duration}),
    HiddenForm(
        "drift",
        "creep",
        "tissue",
        creeping_drift,
        "N",
        additive(lambda s, time_s: np.log1p(0.5 * s.duration / time_s)),
        lambda rng, s: {"time_s": log_uniform(rng, 1.0, 10.0)},
    ),
    HiddenForm(
        "periodic_disturbance",
        "sine",
        "tissue",
        harmonics,
        "N",
        _FORCE,
        lambda rng, s: {**_disturbance(rng, s), "overtones": []},
    ),
    HiddenForm(
        "periodic_disturbance",
        "overtones",
        "tissue",
        harmonics,
        "N",
        _FORCE,
        lambda rng, s: {**_disturbance(rng, s), "overtones": [rng.uniform(0.1, 0.4), rng.uniform(0.05, 0.2)]},
    ),
    HiddenForm("periodic_disturbance", "square", "tissue", square_wave, "N", _FORCE, _disturbance),
)
