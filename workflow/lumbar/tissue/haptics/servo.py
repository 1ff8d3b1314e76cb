"""A servo of any rate around an FMU with samples of its own: what ``tissue_force.h`` does at each tick.

It takes the samples whose instants have come since the tick before, at positions on the straight line from that tick to this
one, and displays the force of the newest until the next tick.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from lumbar.base.errors import InputError
from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.closed_loop import SampledModel
from lumbar.tissue.haptics.simulation import Step
from lumbar.tissue.haptics.ticks.one_tick import REACHED, shares
from lumbar.tissue.haptics.ticks.sequence import PeriodicModel
from lumbar.tissue.haptics.ticks.uneven import spans

LONGEST_GAP_S = 0.25
"""``longest_gap`` of ``tissue_force.h``."""
MOST_TICKS, PLACES = 256, 8
"""Rates whose ticks do not come back to the same place among the samples within so many ticks are judged at the nearest that
do, at so many places of the first tick, as a clock that drifts comes to all of them."""
_ROUNDING = 1e-9


class TissueForce:
    """The loader: time and position of a tick in, force out; numbers of ``tissue_force.h``, operation by operation."""

    def __init__(self, step: Step, sampling_time: float):
        self._step, self._sampling_time = step, sampling_time
        self._start = self._time = self._position = self._force = 0.0
        self._samples = 0

    def __call__(self, time: float, position: float) -> float:
        """Force at a tick; times in seconds, not falling."""
        if not self._samples:
            self._start = self._time = time
        newest = self._start + (self._samples - 1) * self._sampling_time
        moved = position - self._position
        for share in shares(self._time - newest, time - self._time, self._sampling_time):
            self._force = self._step(position if share == 1.0 else self._position + share * moved)
            self._samples += 1
        self._time, self._position = time, position
        return self._force


def on_servo(
    model: SampledModel, device: DeviceSettings, *, held: bool = False
) -> tuple[SampledModel | PeriodicModel, ...]:
    """Return a model that samples by its own clock as the servo of a device meets it, forces late as they are there.

    Parameters
    ----------
    held : bool
        Whether the position waits at that of the tick before, as that of a client of FMI 2.0 does.

    Returns
    -------
    tuple of SampledModel or PeriodicModel
        One from tick to tick, or from sample to sample where the servo is faster by a whole factor; with ticks that repeat
        after several where neither rate is a multiple of the other; several where they do not within `MOST_TICKS`.

    Raises
    ------
    InputError
        If the loader takes no gap as long as that between two ticks.
    """
    longest = spans(device)[-1][1]
    if longest > LONGEST_GAP_S:
        raise InputError(
            f"runtime.device: at {device.rate_Hz:g} Hz, with its jitter_percent and missed_ticks, ticks are up to "
            f"{longest:.3g} s apart; the loaders take more than {LONGEST_GAP_S:g} s for a fault: take a faster or more even servo"
        )
    seconds, wanted = 1e-3 * device.delay_ms, 1.0 / (device.rate_Hz * model.sampling_time)
    ratio = Fraction(wanted).limit_denominator(MOST_TICKS)
    found = PeriodicModel(model, (float(ratio) * model.sampling_time,) * ratio.denominator, held=held)
    if abs(ratio - wanted) > _ROUNDING * wanted:
        # Up to just before the next instant.
        places = np.linspace(0.0, 1.0 - 2.0 * REACHED, PLACES) * model.sampling_time / ratio.denominator
        return tuple(replace(found, age=float(place)).late(seconds) for place in places)
    if ratio.numerator == 1:
        return (model.late(seconds),)
    return (
        (from_tick_to_tick(model, ratio.numerator, held) if ratio.denominator == 1 else found).late(seconds),
    )


def from_tick_to_tick(model: SampledModel, samples: int, held: bool) -> SampledModel:
    """Return the model as the loop meets it where each tick comes a whole number of samples after the one before.

    The positions are those of the ticks, interpolated by a filter, and of the forces those of the ticks are left
    (P. P. Vaidyanathan, Multirate Systems and Filter Banks (1993), section 4.2).
    """
    from scipy.signal import lfilter

    late, first = (np.ones(samples), 0) if held else (np.bartlett(2 * samples + 1)[1:-1], samples - 1)
    poles = np.roots(model.denominator) ** samples
    denominator = np.real(np.atleast_1d(np.poly(poles)))
    # Behind the filter each pole adds samples - 1 powers of 1/z to the numerator, before all but every so many are left.
    order = (len(model.numerator) - 1 + (samples - 1) * (len(poles) + 1)) // samples
    impulse = np.zeros(order * samples + 1 + first)
    impulse[: len(late)] = late[: len(impulse)]
    forces = lfilter(model.numerator, model.denominator, impulse)[first::samples]
    return replace(
        model,
        numerator=np.convolve(denominator, forces)[: order + 1],
        denominator=denominator,
        sampling_time=samples * model.sampling_time,
    )
