"""Damping, inertia and further relaxation."""

from __future__ import annotations

import numpy as np

from hidden_effects.form import HiddenForm, additive
from lumbar.twin.two_hidden_effects import RATE_HZ, log_uniform, maxwell_force


def damping_with_depth(motion, tissue, strength, offset_mm):
    """λ(z + z₀)v."""
    return strength * (motion.position + offset_mm) * motion.velocity


def hunt_crossley(motion, tissue, strength, exponent):
    """λ zⁿ v on the side of contact."""
    return strength * np.maximum(motion.position, 0.0) ** exponent * motion.velocity


def quadratic(motion, tissue, strength):
    """c₂ v|v|."""
    return strength * motion.velocity * np.abs(motion.velocity)


def power(motion, tissue, strength, exponent):
    """C |v|ᵖ sign v."""
    return strength * np.sign(motion.velocity) * np.abs(motion.velocity) ** exponent


def hyperbolic(motion, tissue, strength, speed_mm_s):
    """F sinh(v/v_s)."""
    return strength * np.sinh(motion.velocity / speed_mm_s)


def inertia(motion, tissue, strength):
    """M z̈; strength in N s²/mm, that is tonnes."""
    return strength * motion.acceleration


def second_branch(motion, tissue, strength, relaxation_s):
    """A second Maxwell branch."""
    return maxwell_force(motion.position, motion.step, strength, relaxation_s)


def _fast(rng, scales):
    # A branch faster than the sampling is a dashpot to every observer.
    return {"relaxation_s": max(scales.relaxation_s / log_uniform(rng, 4.0, 20.0), 1 / RATE_HZ)}


def _branch_size(scales, relaxation_s):
    return scales.speed * relaxation_s if relaxation_s < scales.relaxation_s else 0.5 * scales.amplitude


FORMS = (
    HiddenForm(
        "depth_dependent_damping",
        "bilinear",
        "tissue",
        damping_with_depth,
        "N s/mm^2",
        additive(lambda s, offset_mm: 0.5 * s.amplitude * s.speed),
        lambda rng, s: {"offset_mm": rng.uniform(0.0, 0.2) * s.amplitude},
    ),
    HiddenForm(
        "depth_dependent_damping",
        "hunt_crossley",
        "tissue",
        hunt_crossley,
        "N s/mm^(1+n)",
        additive(lambda s, exponent: (0.5 * s.amplitude) ** exponent * s.speed),
        lambda rng, s: {"exponent": rng.uniform(1.0, 1.5)},
    ),
    HiddenForm(
        "quadratic_damping", "quadratic", "tissue", quadratic, "N s^2/mm^2", additive(lambda s: s.speed**2)
    ),
    HiddenForm(
        "quadratic_damping",
        "power",
        "tissue",
        power,
        "N (s/mm)^p",
        additive(lambda s, exponent: s.speed**exponent),
        lambda rng, s: {"exponent": rng.uniform(1.7, 2.5)},
    ),
    HiddenForm(
        "quadratic_damping",
        "hyperbolic",
        "tissue",
        hyperbolic,
        "N",
        additive(lambda s, speed_mm_s: np.sinh(s.speed / speed_mm_s)),
        lambda rng, s: {"speed_mm_s": s.speed * rng.uniform(0.5, 0.9)},
    ),
    HiddenForm("inertia", "mass", "tissue", inertia, "N s^2/mm", additive(lambda s: s.acceleration)),
    HiddenForm(
        "second_relaxation",
        "slow",
        "tissue",
        second_branch,
        "N/mm",
        additive(_branch_size),
        lambda rng, s: {"relaxation_s": log_uniform(rng, 6.0, 40.0) * s.relaxation_s},
    ),
    HiddenForm("second_relaxation", "fast", "tissue", second_branch, "N/mm", additive(_branch_size), _fast),
)
