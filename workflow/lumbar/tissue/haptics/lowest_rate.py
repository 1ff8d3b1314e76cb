"""The lowest rate from which on a model is passive, or stable, on a device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.haptics.closed_loop import SampledModel, largest_stable_gain
from lumbar.tissue.haptics.passivity import required_damping
from lumbar.tissue.haptics.rendered_model import exported_at, rendered
from lumbar.tissue.models.fitted_model import FittedModel

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
    device, slowest = settings.device, 1.0 / model.sampling_time

    @cache
    def loop_at(rate: float) -> SampledModel | None:
        """The model at a rate; None where it has no counterpart there."""
        try:
            return rendered(exported_at(model, settings, rate), replace(device, rate_Hz=rate)).loops[0]
        except (InputError, NumericalError):
            return None

    def passive(rate: float) -> bool:
        loop = loop_at(rate)
        return loop is not None and required_damping(loop, _POINTS).damping <= device.damping_N_s_m

    def stable(rate: float) -> bool:
        loop = loop_at(rate)
        return loop is not None and largest_stable_gain(loop, device)[0] > 1.0

    return _lowest(slowest, passive), _lowest(slowest, stable)


def _lowest(slowest: float, safe: Callable[[float], bool]) -> float | None:
    """Go down from the fastest rate to the first that is not safe, then halve the interval."""
    rates = [float(rate) for rate in np.geomspace(slowest, max(FASTEST_HZ, slowest), _SCANNED)]
    unsafe = next((rate for rate in reversed(rates) if not safe(rate)), None)
    if unsafe is None:
        return slowest
    if unsafe == rates[-1]:
        return slowest if safe(slowest) else None
    safe_from = rates[rates.index(unsafe) + 1]
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(unsafe * safe_from))
        unsafe, safe_from = (unsafe, middle) if safe(middle) else (middle, safe_from)
    return safe_from
