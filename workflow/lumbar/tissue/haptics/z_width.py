"""The Z-width of a device: which stiffness it can render, against its damping and the rate.

J. E. Colgate and J. M. Brown, Factors affecting the Z-width of a haptic display, Proc. IEEE International Conference on
Robotics and Automation (1994) 3205–3210.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.settings.device import DeviceSettings
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.haptics.closed_loop import SampledModel, largest_stable_gain
from lumbar.tissue.haptics.passivity import required_damping
from lumbar.tissue.haptics.rendered_model import exported_at, rendered
from lumbar.tissue.models.fitted_model import FittedModel

_FASTEST_PLOTTED_HZ = 10_000.0
_RATES, _DAMPINGS, _POINTS = 9, 9, 400


@dataclass(frozen=True)
class ZWidth:
    """What a device can render."""

    rates: np.ndarray
    """Shape (rates,): hz."""
    needed: dict[str, np.ndarray]
    """Dict of str to numpy.ndarray, each of shape (rates,): damping in N·s/m that makes a device passive with a model, by
    its name; NaN where it has no counterpart at a rate."""
    damping: np.ndarray
    """Shape (dampings,): of the device, N·s/m."""
    stiffness: dict[float, tuple[np.ndarray, np.ndarray]]
    """Dict of float to tuple of numpy.ndarray, each of shape (dampings,): by rate: largest stiffness in N/m of a spring,
    behind the same moving average, that is passive, and that is stable in the hand."""


def z_width(models: Sequence[FittedModel], settings: RuntimeSettings) -> ZWidth:
    """Return the damping that models need by rate, and the stiffnesses that the device can render by its damping.

    Parameters
    ----------
    models : sequence of FittedModel
        Transfer functions; at least one.
    """
    slowest = 1.0 / models[0].sampling_time
    rates = np.geomspace(slowest, max(_FASTEST_PLOTTED_HZ, slowest), _RATES)
    needed = {model.name: np.array([_needed(model, rate, settings) for rate in rates]) for model in models}
    damping = np.geomspace(
        settings.device.damping_N_s_m / 10.0, settings.device.damping_N_s_m * 10.0, _DAMPINGS
    )
    samples = exported_at(models[0], settings, slowest).moving_average
    ends = dict.fromkeys([slowest, max(slowest, settings.device.rate_Hz)])
    return ZWidth(
        rates, needed, damping, {rate: _stiffnesses(damping, rate, samples, settings.device) for rate in ends}
    )


def _needed(model: FittedModel, rate: float, settings: RuntimeSettings) -> float:
    device = replace(settings.device, rate_Hz=rate)
    try:
        return required_damping(
            rendered(exported_at(model, settings, rate), device).loops[0], _POINTS
        ).damping
    except (InputError, NumericalError):
        return np.nan


def _stiffnesses(
    damping: np.ndarray, rate: float, samples: int, device: DeviceSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Of a spring behind the mean of so many samples."""
    average = np.full(samples, 1.0 / samples)
    spring = SampledModel("spring", average, np.ones(1), 1.0 / rate).late(1e-3 * device.delay_ms)
    devices = [replace(device, damping_N_s_m=float(value)) for value in damping]
    # The damping needed is proportional to the stiffness.
    passive = damping / required_damping(spring, _POINTS).damping
    return passive, np.array([largest_stable_gain(spring, item)[0] for item in devices])
