"""One mathematical form of a hidden effect: what it does to motion or force, and how strong it may be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lumbar.twin.hidden_effects.hidden_tissue import Tissue
from lumbar.twin.hidden_effects.tool_motion import ToolMotion

OUTSIDE = "outside"
"""Mechanism of the forms that belong to no entry of the catalogue."""


@dataclass(frozen=True)
class Scales:
    """Sizes of an experiment without its effect, by which strengths and shapes are chosen."""

    amplitude: float
    """Largest displacement, mm."""
    speed: float
    acceleration: float
    """`speed`, `acceleration`: RMS of the multisine, mm/s and mm/s²."""
    force: float
    """RMS of the multisine's force, N."""
    peak: float
    """Its largest magnitude, N."""
    elastic: float
    relaxing: float
    relaxation_s: float
    """`elastic`, `relaxing`, `relaxation_s`: of the tissue, N/mm and s."""
    path: float
    """Path travelled in the multisine, mm."""
    duration: float
    """Duration of the multisine, s."""

    @classmethod
    def of(cls, motion: ToolMotion, tissue: Tissue) -> Scales:
        """Measure them on the multisine."""
        force = tissue.force(motion)
        return cls(
            amplitude=float(np.abs(motion.position).max()),
            speed=float(motion.velocity.std()),
            acceleration=float(motion.acceleration.std()),
            force=float(force.std()),
            peak=float(np.abs(force).max()),
            elastic=tissue.elastic,
            relaxing=tissue.relaxing,
            relaxation_s=tissue.relaxation_s,
            path=float(motion.path[-1]),
            duration=motion.step * len(motion.position),
        )


@dataclass(frozen=True)
class HiddenForm:
    """A hidden effect in one mathematical form."""

    mechanism: str
    """Name in the catalogue, or `OUTSIDE`."""
    name: str
    """Of the form, unique within the mechanism."""
    place: str
    """``"mount"``: ``act(motion, strength, **shape)`` returns the motion that reaches the tissue. ``"tissue"``:
    ``act(motion, tissue, strength, **shape)`` returns a force beside the tissue's. ``"sensor"``: ``act(motion, force,
    strength, **shape)`` returns what becomes of the whole force."""
    act: Callable
    unit: str
    """Unit of the strength."""
    strengths: Callable[..., tuple[float, float]]
    """``strengths(scales, **shape)`` returns the weakest and the strongest strength, both positive; a threshold weakens an
    effect as it grows, so the first may be the larger."""
    draw: Callable[[np.random.Generator, Scales], dict] = lambda rng, scales: {}
    """``draw(rng, scales)`` returns the other parameters; their names end in the unit where they have one."""

    @property
    def label(self) -> str:
        """Mechanism and form in one word."""
        return f"{self.mechanism}:{self.name}"

    def strength(self, scales: Scales, shape: dict, severity: float) -> float:
        """Strength at a severity between 0 (weakest) and 1 (strongest), evenly spaced in its logarithm."""
        weakest, strongest = self.strengths(scales, **shape)
        return float(weakest * (strongest / weakest) ** severity)


def additive(unit_size: Callable[..., float]) -> Callable[..., tuple[float, float]]:
    """Strengths of an effect that adds a force: from 10⁻⁴ to 3 times the size of the tissue's force.

    Parameters
    ----------
    unit_size : callable
        ``unit_size(scales, **shape)``: size of the added force at strength 1.
    """

    def strengths(scales: Scales, **shape) -> tuple[float, float]:
        full = scales.force / unit_size(scales, **shape)
        return 1e-4 * full, 3.0 * full

    return strengths


def between(weakest: float, strongest: float) -> Callable[..., tuple[float, float]]:
    """Strengths given as numbers."""
    return lambda scales, **shape: (weakest, strongest)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Random number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
