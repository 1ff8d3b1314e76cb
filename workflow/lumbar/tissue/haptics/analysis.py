"""One model on one device in one hand: damping needed, largest stable gain, and the loop in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lumbar.settings.device import DeviceSettings
from lumbar.tissue.haptics.closed_loop import largest_stable_gain
from lumbar.tissue.haptics.passivity import required_damping
from lumbar.tissue.haptics.rendered_model import RenderedModel
from lumbar.tissue.haptics.simulation import (
    LoopRun,
    difference_equation,
    encoder_ripple,
    one_step,
    simulate,
)


@dataclass(frozen=True)
class Analysis:
    """What the linear analysis says of a model in the loop; of a model with effects the worst of its linearisations."""

    name: str
    rate: float
    """At which positions are sampled and the force changes, in Hz."""
    device: DeviceSettings
    damping: float
    damping_frequency: float
    """`damping`, `damping_frequency`: smallest damping of the device for a passive loop in N·s/m, and the frequency in Hz
    that asks for it."""
    gain: float
    gain_frequency: float
    """`gain`, `gain_frequency`: largest stable factor on the model's force, and the frequency in Hz of the oscillation
    that begins there."""
    linearised: bool
    """Whether the model has effects."""

    @property
    def passive(self) -> bool:
        """Whether the device is passive with the model, in any passive hand."""
        return self.damping <= self.device.damping_N_s_m

    @property
    def stable(self) -> bool:
        """Whether the loop is stable in the hand of the settings."""
        return self.gain > 1.0

    @property
    def finding(self) -> str:
        """A few words with the numbers."""
        kind = "its linearisations need" if self.linearised else "it needs"
        passive = "its linearisations are passive in any hand" if self.linearised else "passive in any hand"
        state = passive if self.passive else "stable in this hand, not passive" if self.stable else "UNSTABLE"
        begins = f", where it oscillates at {self.gain_frequency:.3g} Hz" if np.isfinite(self.gain) else ""
        return (
            f"{self.name} at {self.rate:.4g} Hz: {state} ({kind} {self.damping:.3g} N·s/m to be passive; largest stable gain "
            f"{self.gain:.3g}{begins})"
        )


def analyse(model: RenderedModel, device: DeviceSettings) -> Analysis:
    """Analyse the loop of a model, or of all its linearisations."""
    dampings = [required_damping(item) for item in model.loops]
    worst = max(dampings, key=lambda found: found.damping)
    gain = min(largest_stable_gain(item, device) for item in model.loops)
    rate = 1.0 / model.loops[0].sampling_time
    return Analysis(
        model.name, rate, device, worst.damping, worst.frequency, *gain, linearised=model.linearised
    )


def run_loop(
    model: RenderedModel, device: DeviceSettings, force_of: Callable[[float], float] | None = None
) -> LoopRun:
    """Simulate a push into the model and what follows.

    Parameters
    ----------
    force_of : callable, optional
        From a position to its force in the model's units, sample by sample: the FMU itself. A model with effects needs it;
        a linear one is simulated by its difference equation without it.
    """
    first = model.loops[0]
    ripple = max(
        encoder_ripple(item, device) if largest_stable_gain(item, device)[0] > 1.0 else one_step(item, device)
        for item in model.loops
    )
    step = difference_equation(first) if force_of is None else model.in_loop(force_of)
    return simulate(step, first.sampling_time, device, model.limit, delay=first.delay, ripple=ripple)
