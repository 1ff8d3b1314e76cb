"""Limits of a device: the lowest rates at which models are passive and stable, and the Z-width.

J. E. Colgate and J. M. Brown, Factors affecting the Z-width of a haptic display, Proc. IEEE International Conference on
Robotics and Automation (1994) 3205–3210.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.haptics.closed_loop import SampledModel, largest_stable_gain
from lumbar.tissue.haptics.rendered_model import export_at, render_model
from lumbar.tissue.haptics.ticks import PeriodicModel, required_damping
from lumbar.tissue.models.fitted_model import FittedModel

FASTEST_HZ = 20_000.0
_SCAN_RATES, _HALVINGS, _CHECK_RATES, _ANGLES = 8, 8, 60, 400
"""Numbers of rates in the first scan, halvings between two rates, rates in the last check, and angles for the damping."""
_MAX_PLOTTED_HZ, _PLOTTED_RATES, _PLOTTED_DAMPINGS = 10_000.0, 9, 9


def lowest_rates(model: FittedModel, settings: RuntimeSettings) -> tuple[float | None, float | None]:
    """Return the lowest rates in Hz for a passive and a stable loop of a transfer function, on a servo as fast as the model.

    Rates between the rate of identification and `FASTEST_HZ` are searched to about 1 %, for some models only multiples of the
    former; None if the model is safe at none of them. With a limit on the force's rate no rate is passive.
    """
    device, slowest = settings.device, 1.0 / model.sampling_time
    loop_at = cache(partial(_loop_at, model, settings))

    def passive(rate: float) -> bool:
        loop = None if settings.output_rate_limit else loop_at(rate)
        return loop is not None and required_damping(loop, _ANGLES) <= device.damping_N_s_m

    def stable(rate: float) -> bool:
        loop = loop_at(rate)
        return loop is not None and largest_stable_gain(loop, device).gain > 1.0

    rates = [float(rate) for rate in np.geomspace(slowest, max(FASTEST_HZ, slowest), _SCAN_RATES)]
    between = loop_at(rates[1]) is not None
    if not between:  # it runs only at multiples of its own rate
        rates = [slowest * count for count in dict.fromkeys(round(rate / slowest) for rate in rates)]
    return _lowest(rates, passive, between), _lowest(rates, stable, between)


def _loop_at(
    model: FittedModel, settings: RuntimeSettings, rate: float
) -> SampledModel | PeriodicModel | None:
    """Return the loop of a model on a servo of a rate; None if it cannot be exported or rendered at this rate."""
    device = settings.device.model_copy(update={"rate_Hz": rate})
    try:
        return render_model(export_at(model, settings, rate), device).loops[0]
    except (InputError, NumericalError):
        return None


def _lowest(rates: list[float], safe: Callable[[float], bool], between: bool) -> float | None:
    """Return the lowest of `rates` above all unsafe rates; with `between`, refine it by halving.

    Many rates above the result are checked; if any is unsafe, the search is repeated among the checked rates.
    """
    first = next((index for index in reversed(range(len(rates))) if not safe(rates[index])), -1)
    if first == len(rates) - 1:
        return None
    safe_from = rates[first + 1]
    if not between:
        return safe_from
    if first >= 0:
        unsafe = rates[first]
        for _ in range(_HALVINGS):
            middle = float(np.sqrt(unsafe * safe_from))
            unsafe, safe_from = (unsafe, middle) if safe(middle) else (middle, safe_from)
    above = [float(rate) for rate in np.geomspace(safe_from, rates[-1], _CHECK_RATES)]
    return safe_from if all(map(safe, above)) else _lowest(above, safe, between)


@dataclass(frozen=True)
class ZWidth:
    """The required damping of models as a function of rate, and the renderable stiffness as a function of device damping."""

    rates: np.ndarray
    """Rates in Hz, shape (rates,)."""
    needed: dict[str, np.ndarray]
    """By model: damping in N·s/m for a passive device, shape (rates,); NaN if the model has no counterpart at a rate."""
    damping: np.ndarray
    """Damping of the device in N·s/m, shape (dampings,)."""
    stiffness: dict[float, tuple[np.ndarray, np.ndarray]]
    """By rate: largest passive and largest stable stiffness of a spring with the moving average, N/m, shape (dampings,)
    each."""


def z_width(models: Sequence[FittedModel], settings: RuntimeSettings) -> ZWidth:
    """Return the damping required by transfer functions at each rate, and the renderable stiffness for each damping."""
    slowest = 1.0 / models[0].sampling_time
    rates = np.geomspace(slowest, max(_MAX_PLOTTED_HZ, slowest), _PLOTTED_RATES)
    loops = {model.name: [_loop_at(model, settings, rate) for rate in rates] for model in models}
    needed = {
        name: np.array([required_damping(loop, _ANGLES) if loop else np.nan for loop in at_rates])
        for name, at_rates in loops.items()
    }
    device = settings.device
    damping = np.geomspace(device.damping_N_s_m / 10.0, device.damping_N_s_m * 10.0, _PLOTTED_DAMPINGS)
    devices = [device.model_copy(update={"damping_N_s_m": float(value)}) for value in damping]
    # A spring behind the mean over the same number of samples.
    samples = export_at(models[0], settings, slowest).moving_average
    average, stiffness = np.full(samples, 1.0 / samples), {}
    for rate in dict.fromkeys([slowest, max(slowest, device.rate_Hz)]):
        spring = SampledModel("spring", average, np.ones(1), 1.0 / rate).late(1e-3 * device.delay_ms)
        # The damping needed is proportional to the stiffness.
        passive = damping / required_damping(spring, _ANGLES)
        stiffness[rate] = passive, np.array([largest_stable_gain(spring, item).gain for item in devices])
    return ZWidth(rates, needed, damping, stiffness)
