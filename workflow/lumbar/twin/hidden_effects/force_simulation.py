"""Force of a tissue with effects, and the strength at which an effect leaves a wanted residual."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from lumbar.twin.hidden_effects.hidden_form import HiddenForm, Scales
from lumbar.twin.hidden_effects.hidden_tissue import Tissue, kelvin_boltzmann_residual
from lumbar.twin.hidden_effects.tool_motion import ToolMotion

_TOLERANCE = 0.01
"""Relative accuracy of the wanted residual."""
_STEPS = 6
"""Severities tried on the way up."""


@dataclass(frozen=True)
class HiddenEffect:
    """A form with its strength and its other parameters."""

    form: HiddenForm
    strength: float
    shape: dict


def simulate(motion: ToolMotion, tissue: Tissue, effects: list[HiddenEffect]) -> np.ndarray:
    """Noise-free force on the simulation's grid, newtons.

    The motion passes the mount, the tissue answers with its own force and those beside it, and the sensor
    records the sum: effects act at these three places, in the given order within each.
    """
    placed = {
        place: [effect for effect in effects if effect.form.place == place]
        for place in ("mount", "tissue", "sensor")
    }
    for effect in placed["mount"]:
        motion = effect.form.act(motion, effect.strength, **effect.shape)
    force = tissue.force(motion)
    beside = [effect.form.act(motion, tissue, effect.strength, **effect.shape) for effect in placed["tissue"]]
    for extra in beside:
        force = force + extra
    for effect in placed["sensor"]:
        force = effect.form.act(motion, force, effect.strength, **effect.shape)
    return force


def residual_rms(motion: ToolMotion, tissue: Tissue, effects: list[HiddenEffect]) -> float:
    """RMS of what the best Kelvin–Boltzmann model leaves of the noise-free force, newtons."""
    force = motion.sampled(simulate(motion, tissue, effects))
    return float(np.sqrt(np.mean(kelvin_boltzmann_residual(motion, force) ** 2)))


def calibrated(
    form: HiddenForm, shape: dict, wanted_N: float, motion: ToolMotion, tissue: Tissue, scales: Scales
) -> HiddenEffect:
    """Effect whose residual, left by the best Kelvin–Boltzmann model of the multisine, is `wanted_N`.

    The strongest admissible effect is returned when even that leaves less.
    """

    def excess(severity: float) -> float:
        effect = HiddenEffect(form, form.strength(scales, shape, severity), shape)
        rms = residual_rms(motion, tissue, [effect])
        return float(np.log(max(rms, 1e-9 * scales.force) / wanted_N))

    severity = _crossing(excess)
    return HiddenEffect(form, form.strength(scales, shape, severity), shape)


def _crossing(excess) -> float:
    """Least severity at which the excess vanishes, found from below; where it stays negative, its best place.

    The residual need not grow with the strength throughout (a very fast branch replaces the base's own, a signal
    clipped to nothing is explained by no tissue): the weakest effect that will do is the plausible one.
    """
    known = {0.0: excess(0.0)}
    for step in range(1, _STEPS + 1):
        low, high = (step - 1) / _STEPS, step / _STEPS
        known[high] = excess(high)
        if known[high] > 0:
            return 0.0 if known[low] > 0 else _root(excess, low, high, known[low], known[high])
    return max(known, key=known.get)


def _root(excess, low: float, high: float, at_low: float, at_high: float) -> float:
    known = {low: at_low, high: at_high}

    def cached(severity: float) -> float:
        value = known[severity] if severity in known else excess(severity)
        known[severity] = value
        return 0.0 if abs(value) < _TOLERANCE else value

    return float(brentq(cached, low, high, xtol=1e-4))
