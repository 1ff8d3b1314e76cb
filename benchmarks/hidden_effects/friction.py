"""Dry friction, presliding hysteresis and play in the mount."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hidden_effects.form import HiddenForm, additive
from hidden_effects.rate_independent import bouc_wen, dahl, play, smooth_play, stop
from lumbar.twin.two_hidden_effects import log_uniform


def coulomb_sign(motion, tissue, strength):
    """F_c sign v."""
    return strength * np.sign(motion.velocity)


def coulomb_tanh(motion, tissue, strength, speed_mm_s):
    """F_c tanh(v/v_s)."""
    return strength * np.tanh(motion.velocity / speed_mm_s)


def coulomb_arctan(motion, tissue, strength, speed_mm_s):
    """F_c (2/π) arctan(v/v_s)."""
    return strength * 2 / np.pi * np.arctan(motion.velocity / speed_mm_s)


def stribeck(motion, tissue, strength, speed_mm_s, breakaway, stribeck_mm_s):
    """Friction that falls from its breakaway value to F_c as the speed grows."""
    excess = (breakaway - 1) * np.exp(-((motion.velocity / stribeck_mm_s) ** 2))
    return strength * (1 + excess) * np.tanh(motion.velocity / speed_mm_s)


def dahl_friction(motion, tissue, strength, yield_mm, exponent):
    """Dahl's presliding friction."""
    return strength * dahl(motion.position, yield_mm, exponent)


def bouc_wen_friction(motion, tissue, strength, yield_mm, sharpness, loading):
    """Bouc–Wen hysteresis."""
    return strength * bouc_wen(motion.position, yield_mm, sharpness, loading)


def elastoplastic(motion, tissue, strength, yield_mm):
    """One Jenkins element: a spring that slides."""
    return strength * stop(motion.position, yield_mm) / yield_mm


def iwan(motion, tissue, strength, yields_mm):
    """Parallel Jenkins elements of equal strength (Iwan)."""
    return strength * np.mean([stop(motion.position, length) / length for length in yields_mm], axis=0)


def _follow_with_gap(motion, position):
    """Motion behind the mount; play has corners, so speed and acceleration are differences."""
    velocity = np.gradient(position, motion.step)
    return replace(
        motion, position=position, velocity=velocity, acceleration=np.gradient(velocity, motion.step)
    )


def sharp_play(motion, strength):
    """A gap of ±strength between tool and tissue."""
    return _follow_with_gap(motion, play(motion.position, strength))


def gradual_play(motion, strength, rounding):
    """A gap whose flanks yield a little; the rounding is a share of the half gap."""
    return _follow_with_gap(motion, smooth_play(motion.position, strength, rounding * strength))


def _smoothing(rng, scales):
    return {"speed_mm_s": log_uniform(rng, 0.2, 1.5)}


def _yield(rng, scales):
    return {"yield_mm": scales.amplitude * rng.uniform(0.1, 0.35)}


_FORCE = additive(lambda scales, **shape: 1.0)
_GAP = lambda scales, **shape: (1e-4 * scales.amplitude, 0.3 * scales.amplitude)  # noqa: E731

FORMS = (
    HiddenForm("coulomb_friction", "sign", "tissue", coulomb_sign, "N", _FORCE),
    HiddenForm("coulomb_friction", "tanh", "tissue", coulomb_tanh, "N", _FORCE, _smoothing),
    HiddenForm("coulomb_friction", "arctan", "tissue", coulomb_arctan, "N", _FORCE, _smoothing),
    HiddenForm(
        "coulomb_friction",
        "stribeck",
        "tissue",
        stribeck,
        "N",
        _FORCE,
        lambda rng, s: {
            **_smoothing(rng, s),
            "breakaway": rng.uniform(1.2, 1.8),
            "stribeck_mm_s": s.speed * rng.uniform(0.05, 0.3),
        },
    ),
    HiddenForm(
        "hysteresis",
        "dahl",
        "tissue",
        dahl_friction,
        "N",
        _FORCE,
        lambda rng, s: {**_yield(rng, s), "exponent": 1.0},
    ),
    HiddenForm(
        "hysteresis",
        "dahl_steep",
        "tissue",
        dahl_friction,
        "N",
        _FORCE,
        lambda rng, s: {**_yield(rng, s), "exponent": rng.uniform(1.3, 2.0)},
    ),
    HiddenForm(
        "hysteresis",
        "bouc_wen",
        "tissue",
        bouc_wen_friction,
        "N",
        _FORCE,
        lambda rng, s: {
            **_yield(rng, s),
            "sharpness": rng.uniform(1.0, 3.0),
            "loading": rng.uniform(0.4, 0.9),
        },
    ),
    HiddenForm("hysteresis", "elastoplastic", "tissue", elastoplastic, "N", _FORCE, _yield),
    HiddenForm(
        "hysteresis",
        "iwan",
        "tissue",
        iwan,
        "N",
        _FORCE,
        lambda rng, s: {
            "yields_mm": [s.amplitude * share for share in np.sort(rng.uniform(0.05, 0.6, 5)).tolist()]
        },
    ),
    HiddenForm("backlash", "sharp", "mount", sharp_play, "mm", _GAP),
    HiddenForm(
        "backlash",
        "gradual",
        "mount",
        gradual_play,
        "mm",
        _GAP,
        lambda rng, s: {"rounding": rng.uniform(0.02, 0.1)},
    ),
)
