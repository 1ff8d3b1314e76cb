"""The lowest rate from which on a model is passive, or stable, on a device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lumbar.errors import NumericalError
from lumbar.haptics.closed_loop import largest_stable_gain
from lumbar.haptics.passivity import required_damping
from lumbar.haptics.rendered_model import exported_at, rendered
from lumbar.haptics.sampled_model import SampledModel
from lumbar.models.fitted_model import FittedModel
from lumbar.settings.runtime import RuntimeSettings

FASTEST_HZ = 20_000.0
_SCANNED, _HALVINGS, _POINTS = 8, 8, 400


def lowest_rates(model: FittedModel, settings: RuntimeSettings) -> tuple[float | None, float | None]:
    """Lowest rates in Hz for a passive and for a stable loop, on a servo that is as fast as the model.

    Parameters
    ----------
    model : FittedModel
        A transfer function.
    settings : RuntimeSettings
        Moving average, device and hand.

    Returns
    -------
    tuple of (float or None)
        To about a percent, from the rate of identification up to `FASTEST_HZ`; None where the model is not safe up to
        there, or has no counterpart at other rates and is not safe at its own.
    """
    device = settings.device
    passive = _lowest(
        model, settings, lambda loop: required_damping(loop, _POINTS).damping <= device.damping_N_s_m
    )
    return passive, _lowest(model, settings, lambda loop: largest_stable_gain(loop, device)[0] > 1.0)


def _lowest(
    model: FittedModel, settings: RuntimeSettings, safe: Callable[[SampledModel], bool]
) -> float | None:
    """Go down from the fastest rate to the first that is not safe, then halve the interval."""

    def holds(rate: float) -> bool:
        device = replace(settings.device, rate_Hz=rate)
        try:
            return safe(rendered(exported_at(model, settings, rate), device).loops[0])
        except NumericalError:
            return False  # no counterpart at this rate

    slowest = 1.0 / model.sampling_time
    rates = np.geomspace(slowest, max(FASTEST_HZ, slowest), _SCANNED)
    safe_from = None
    for rate in rates[::-1]:
        if not holds(float(rate)):
            break
        safe_from = float(rate)
    if safe_from is None:
        return slowest if holds(slowest) else None
    if safe_from == slowest:
        return slowest
    low = float(rates[rates < safe_from].max())
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * safe_from))
        low, safe_from = (low, middle) if holds(middle) else (middle, safe_from)
    return safe_from
