"""Passivity of a sampled virtual environment: the damping it needs, the lowest rate it allows, and the Z-width of a device.

J. E. Colgate and G. G. Schenkel, Passivity of a class of sampled-data systems: application to haptic interfaces, Journal
of Robotic Systems 14 (1997) 37–47: a device with damping b behind a hold of the force of H(z) is passive if and only if

    b > T/2 · 1/(1 − cos ωT) · Re{(1 − exp(−jωT)) H(exp(jωT))}   for 0 ≤ ω ≤ π/T.

With forces that are late, or ticks that repeat only after several, the same is asked of all pieces of a period in which one
force acts. While the device moves by u within s seconds the force f takes in f u, and a damping b at least b u²/s, at an even
speed just that (Cauchy and Schwarz). With f = F(exp(jθ)) u over the pieces nothing is given out in the long run, whatever the
hand does, if and only if F + Fᴴ + 2b diag(1/s) ≥ 0 for every θ; with one piece the condition above.

J. E. Colgate and J. M. Brown, Factors affecting the Z-width of a haptic display, Proc. IEEE International Conference on
Robotics and Automation (1994) 3205–3210.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.settings.runtime import DeviceSettings, RuntimeSettings
from lumbar.tissue.haptics.closed_loop import SampledModel, all_angles, angles_near, largest_stable_gain
from lumbar.tissue.haptics.rendered_model import export_at, render_model
from lumbar.tissue.haptics.ticks import PeriodicModel, in_ticks
from lumbar.tissue.models.fitted_model import FittedModel

_REFINED, _FEWEST = 101, 12


def damping_at(model: SampledModel | PeriodicModel, angles: np.ndarray) -> np.ndarray:
    """Damping in N·s/m that the condition asks for at every angle θ in (0, π] over a period; shape (angles,)."""
    moves, seconds = by_moves(model, angles)
    weighted = np.sqrt(np.outer(seconds, seconds)) * (moves + moves.conj().swapaxes(1, 2))
    return -np.linalg.eigvalsh(weighted)[:, 0] / 2.0


def by_moves(model: SampledModel | PeriodicModel, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """F of every angle, (angles, pieces, pieces), and the seconds of the pieces of a period in which one force acts."""
    model = in_ticks(model)
    ticks = len(model.intervals)
    pieces = [(tick, age, seconds) for tick, parts in enumerate(model.acting) for age, seconds in parts]
    tick, age, seconds = (np.array(values) for values in zip(*pieces, strict=True))
    ahead = np.exp(1j * angles)[:, None, None]
    periods, shown = np.divmod(tick - age, ticks)
    forces = model.response(angles)[:, shown] * ahead ** periods[:, None]
    # The position of a tick is the sum of all moves before it.
    return forces @ ((tick < np.arange(ticks)[:, None]) + 1.0 / (ahead - 1.0)), seconds


def required_damping(model: SampledModel | PeriodicModel, points: int = 2000) -> float:
    """Return the smallest damping in N·s/m with which the device is passive with a stable model, whatever passive hand holds it.

    0 where the model needs none; infinite with a negative static stiffness, which gives out energy however slowly it is moved:
    no damping pays for that.

    Parameters
    ----------
    points : int
        Angles at which the condition is looked at before the neighbourhood of the worst is looked at again.
    """
    if model.static_stiffness < 0:
        return float("inf")
    ticking = in_ticks(model)
    intervals = ticking.intervals
    # An angle over a period of several ticks stands for as many frequencies.
    angles = all_angles(max(points // len(intervals), _FEWEST))
    resonances = angles_near(ticking.model.poles ** sum(map(len, ticking.taken)))
    angles = np.sort(np.concatenate([angles, resonances]))
    worst = int(damping_at(model, angles).argmax())
    refined = max(_REFINED // len(intervals), _FEWEST)
    angles = np.linspace(angles[max(worst - 1, 0)], angles[min(worst + 1, len(angles) - 1)], refined)
    return max(0.0, float(damping_at(model, angles).max()))


FASTEST_HZ = 20_000.0
_SCANNED, _HALVINGS, _CHECKED, _POINTS = 8, 8, 60, 400
"""Rates that are tried, halvings between two of them, rates above that are tried at last; angles of the damping needed."""


def lowest_rates(model: FittedModel, settings: RuntimeSettings) -> tuple[float | None, float | None]:
    """Lowest rates in Hz for a passive and a stable loop of a transfer function, on a servo that is as fast as the model.

    Returns
    -------
    tuple of (float or None)
        To about a percent, from the rate of identification up to `FASTEST_HZ`; of a model that runs at multiples of that alone
        one of some of them. None where the model is not safe up to there. With a limit on the force's rate none is passive.
    """
    device, slowest = settings.device, 1.0 / model.sampling_time

    @cache
    def loop_at(rate: float) -> SampledModel | PeriodicModel | None:
        return _loop_at(model, rate, settings)

    def passive(rate: float) -> bool:
        loop = None if settings.output_rate_limit else loop_at(rate)
        return loop is not None and required_damping(loop, _POINTS) <= device.damping_N_s_m

    def stable(rate: float) -> bool:
        loop = loop_at(rate)
        return loop is not None and largest_stable_gain(loop, device)[0] > 1.0

    rates = [float(rate) for rate in np.geomspace(slowest, max(FASTEST_HZ, slowest), _SCANNED)]
    between = loop_at(rates[1]) is not None
    if not between:  # it runs at multiples of its own rate alone
        rates = [slowest * count for count in dict.fromkeys(round(rate / slowest) for rate in rates)]
    return _lowest(rates, passive, between), _lowest(rates, stable, between)


def _loop_at(
    model: FittedModel, rate: float, settings: RuntimeSettings
) -> SampledModel | PeriodicModel | None:
    """The model on a servo at a rate; None where it has no counterpart there."""
    try:
        return render_model(
            export_at(model, settings, rate), settings.device.model_copy(update={"rate_Hz": rate})
        ).loops[0]
    except (InputError, NumericalError):
        return None


def _lowest(rates: list[float], safe: Callable[[float], bool], between: bool) -> float | None:
    """Go down from the fastest of these rates to the first that is not safe, and halve the interval if there are rates in it.

    What is found holds at many rates above, or the search begins anew among these.
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
    above = [float(rate) for rate in np.geomspace(safe_from, rates[-1], _CHECKED)]
    return safe_from if all(map(safe, above)) else _lowest(above, safe, between)


_FASTEST_PLOTTED_HZ = 10_000.0
_RATES, _DAMPINGS = 9, 9


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
    """Return the damping that transfer functions need by rate, and the stiffnesses the device can render by its damping."""
    slowest = 1.0 / models[0].sampling_time
    rates = np.geomspace(slowest, max(_FASTEST_PLOTTED_HZ, slowest), _RATES)
    loops = {model.name: [_loop_at(model, rate, settings) for rate in rates] for model in models}
    needed = {
        name: np.array([required_damping(loop, _POINTS) if loop else np.nan for loop in found])
        for name, found in loops.items()
    }
    own = settings.device.damping_N_s_m
    damping = np.geomspace(own / 10.0, own * 10.0, _DAMPINGS)
    samples = export_at(models[0], settings, slowest).moving_average
    ends = dict.fromkeys([slowest, max(slowest, settings.device.rate_Hz)])
    return ZWidth(
        rates, needed, damping, {rate: _stiffnesses(damping, rate, samples, settings.device) for rate in ends}
    )


def _stiffnesses(
    damping: np.ndarray, rate: float, samples: int, device: DeviceSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Of a spring behind the mean of so many samples."""
    average = np.full(samples, 1.0 / samples)
    spring = SampledModel("spring", average, np.ones(1), 1.0 / rate).late(1e-3 * device.delay_ms)
    devices = [device.model_copy(update={"damping_N_s_m": float(value)}) for value in damping]
    # The damping needed is proportional to the stiffness.
    passive = damping / required_damping(spring, _POINTS)
    return passive, np.array([largest_stable_gain(spring, item)[0] for item in devices])
