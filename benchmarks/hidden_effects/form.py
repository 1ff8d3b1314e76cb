"""One mathematical form of a hidden effect: what it does to motion or force, and how strong it may be and is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lumbar.twin.two_hidden_effects import Tissue, ToolMotion, severity_leaving

OUTSIDE = "outside"
"""Mechanism of the forms that belong to no entry of the catalogue."""


@dataclass(frozen=True)
class Scales:
    """Sizes of an experiment without its effect, by which strengths and shapes are chosen."""

    amplitude: float
    """Largest displacement, mm."""
    speed: float
    """RMS velocity of the multisine, mm/s."""
    acceleration: float
    """RMS acceleration of the multisine, mm/s²."""
    force: float
    """RMS of the multisine's force, N."""
    peak: float
    """Largest magnitude of this force, N."""
    elastic: float
    """Elastic stiffness of the tissue, N/mm."""
    relaxing: float
    """Relaxing stiffness of the tissue, N/mm."""
    relaxation_s: float
    """Relaxation time of the tissue."""
    path: float
    """Path travelled in the multisine, mm."""
    duration: float
    """Duration of the multisine, s."""

    @classmethod
    def measure(cls, motion: ToolMotion, tissue: Tissue) -> Scales:
        """Return the scales of the multisine."""
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
    """Name of the form, unique within the mechanism."""
    place: str
    """``"mount"``: ``act(motion, strength, **shape)`` returns the motion that reaches the tissue. ``"tissue"``:
    ``act(motion, tissue, strength, **shape)`` returns an additional force. ``"sensor"``: ``act(motion, force,
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


@dataclass(frozen=True)
class HiddenEffect:
    """A form with its strength and its other parameters."""

    form: HiddenForm
    strength: float
    shape: dict


def simulate(motion: ToolMotion, tissue: Tissue, effects: list[HiddenEffect]) -> np.ndarray:
    """Noise-free force on the simulation's grid, newtons.

    The motion passes the mount, the tissue answers with its own force and parallel forces, and the sensor
    records the sum: effects act at these three places, in the given order within each.
    """
    placed = {
        place: [effect for effect in effects if effect.form.place == place]
        for place in ("mount", "tissue", "sensor")
    }
    for effect in placed["mount"]:
        motion = effect.form.act(motion, effect.strength, **effect.shape)
    force = tissue.force(motion)
    parallel = [
        effect.form.act(motion, tissue, effect.strength, **effect.shape) for effect in placed["tissue"]
    ]
    for extra in parallel:
        force = force + extra
    for effect in placed["sensor"]:
        force = effect.form.act(motion, force, effect.strength, **effect.shape)
    return force


def calibrated(
    form: HiddenForm, shape: dict, wanted_N: float, motion: ToolMotion, tissue: Tissue, scales: Scales
) -> HiddenEffect:
    """Effect whose residual, left by the best Kelvin–Boltzmann model of the multisine, is `wanted_N`.

    The strongest admissible effect is returned when even that leaves less.
    """

    def effect_at(severity: float) -> HiddenEffect:
        return HiddenEffect(form, form.strength(scales, shape, severity), shape)

    severity = severity_leaving(
        wanted_N,
        motion,
        lambda severity: simulate(motion, tissue, [effect_at(severity)]),
        least_N=1e-9 * scales.force,
    )
    return effect_at(severity)
