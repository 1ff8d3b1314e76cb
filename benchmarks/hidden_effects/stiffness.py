"""Elastic effects: hardening, direction-dependent stiffness, loss of contact, softening."""

from __future__ import annotations

import numpy as np

from hidden_effects.form import HiddenForm, additive, between
from lumbar.twin.two_hidden_effects import log_uniform


def cubic(motion, tissue, strength):
    """k₃z³."""
    return strength * motion.position**3


def quintic(motion, tissue, strength):
    """k₅z⁵."""
    return strength * motion.position**5


def exponential(motion, tissue, strength, length_mm):
    """Fung's exponential, made odd; its linear part belongs to the tissue."""
    depth = np.abs(motion.position) / length_mm
    return strength * np.sign(motion.position) * (np.expm1(depth) - depth)


def bilinear(motion, tissue, strength, knee_mm):
    """Additional spring beyond a displacement in either direction."""
    return strength * np.sign(motion.position) * np.maximum(np.abs(motion.position) - knee_mm, 0.0)


def quadratic(motion, tissue, strength):
    """k₂z²."""
    return strength * motion.position**2


def one_sided(motion, tissue, strength):
    """Additional spring in one direction only."""
    return strength * np.maximum(motion.position, 0.0)


def smooth_one_sided(motion, tissue, strength, radius_mm):
    """Additional spring in one direction, engaging gradually."""
    return 0.5 * strength * (motion.position + np.hypot(motion.position, radius_mm) - radius_mm)


def contact_lost(motion, force, strength):
    """The tool pulls no harder than the pre-load F₀."""
    return np.maximum(force, -strength)


def contact_lost_gradually(motion, force, strength, width_N):
    """Contact that is lost over a range of force: softplus."""
    return width_N * np.logaddexp(0.0, (force + strength) / width_N) - strength


def _softened_stiffness(motion, tissue, share):
    return -share * tissue.elastic * motion.position


def softening_by_path(motion, tissue, strength, path_mm):
    """Stiffness at rest falls exponentially with the path travelled."""
    return _softened_stiffness(motion, tissue, strength * -np.expm1(-motion.path / path_mm))


def softening_to_floor(motion, tissue, strength, path_mm):
    """Stiffness at rest falls linearly with the path travelled, then stays."""
    return _softened_stiffness(motion, tissue, strength * np.minimum(motion.path / path_mm, 1.0))


def softening_by_time(motion, tissue, strength, time_s):
    """Stiffness at rest falls exponentially with time."""
    return _softened_stiffness(motion, tissue, strength * -np.expm1(-motion.time / time_s))


def softening_of_all(motion, force, strength, path_mm):
    """The whole force falls exponentially with the path travelled."""
    return force * (1 + strength * np.expm1(-motion.path / path_mm))


def _fading_path(rng, scales):
    return {"path_mm": scales.path * log_uniform(rng, 0.1, 0.5)}


_THRESHOLD = lambda scales, **shape: (scales.peak, 0.05 * scales.force)  # noqa: E731
_SOFTENED = between(1e-3, 0.95)

FORMS = (
    HiddenForm(
        "hardening_stiffness",
        "cubic",
        "tissue",
        cubic,
        "N/mm^3",
        additive(lambda s: (0.5 * s.amplitude) ** 3),
    ),
    HiddenForm(
        "hardening_stiffness",
        "quintic",
        "tissue",
        quintic,
        "N/mm^5",
        additive(lambda s: (0.5 * s.amplitude) ** 5),
    ),
    HiddenForm(
        "hardening_stiffness",
        "exponential",
        "tissue",
        exponential,
        "N",
        additive(lambda s, length_mm: (0.5 * s.amplitude / length_mm) ** 2),
        lambda rng, s: {"length_mm": s.amplitude * rng.uniform(0.25, 0.7)},
    ),
    HiddenForm(
        "hardening_stiffness",
        "bilinear",
        "tissue",
        bilinear,
        "N/mm",
        additive(lambda s, knee_mm: 0.5 * s.amplitude),
        lambda rng, s: {"knee_mm": s.amplitude * rng.uniform(0.25, 0.6)},
    ),
    HiddenForm(
        "quadratic_stiffness",
        "quadratic",
        "tissue",
        quadratic,
        "N/mm^2",
        additive(lambda s: (0.5 * s.amplitude) ** 2),
    ),
    HiddenForm(
        "quadratic_stiffness", "one_sided", "tissue", one_sided, "N/mm", additive(lambda s: 0.5 * s.amplitude)
    ),
    HiddenForm(
        "quadratic_stiffness",
        "smooth_one_sided",
        "tissue",
        smooth_one_sided,
        "N/mm",
        additive(lambda s, radius_mm: 0.5 * s.amplitude),
        lambda rng, s: {"radius_mm": s.amplitude * rng.uniform(0.1, 0.4)},
    ),
    HiddenForm("contact_loss", "sharp", "sensor", contact_lost, "N", _THRESHOLD),
    HiddenForm(
        "contact_loss",
        "gradual",
        "sensor",
        contact_lost_gradually,
        "N",
        _THRESHOLD,
        lambda rng, s: {"width_N": s.force * rng.uniform(0.02, 0.1)},
    ),
    HiddenForm("softening", "path_exponential", "tissue", softening_by_path, "1", _SOFTENED, _fading_path),
    HiddenForm("softening", "path_to_floor", "tissue", softening_to_floor, "1", _SOFTENED, _fading_path),
    HiddenForm(
        "softening",
        "time_exponential",
        "tissue",
        softening_by_time,
        "1",
        _SOFTENED,
        lambda rng, s: {"time_s": s.duration * log_uniform(rng, 0.1, 0.5)},
    ),
    HiddenForm("softening", "whole_force", "sensor", softening_of_all, "1", _SOFTENED, _fading_path),
)
