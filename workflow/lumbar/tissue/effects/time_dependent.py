"""Effects of time alone: drift and disturbances at a frequency of their own."""

from __future__ import annotations

import numpy as np

from lumbar.tissue.models.form import Effect, Form, Place
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.parameter import Constant, LinearParameter, NonlinearParameter

_FORCE = LinearParameter("drift_force", "{y}", sign=0, symbol="Fd")

DRIFT = Effect(
    name="drift",
    mechanism="Force added that depends on time alone: sensor warming up, tissue settling.",
    source="ISO 376:2011, creep of force transducers",
    experiment="record the force at rest for the length of a test",
    accumulates=True,
    forms=(
        Form(
            name="linear",
            equation="r*t",
            place=Place.PARALLEL,
            linear=(LinearParameter("drift_rate", "{y}/s", sign=0, symbol="r"),),
        ),
        Form(
            name="settling",
            equation="-Fd*expm1(-t/Td)",
            place=Place.PARALLEL,
            linear=(_FORCE,),
            nonlinear=(
                NonlinearParameter(
                    "settling_time",
                    "s",
                    "duration",
                    0.01,
                    1.0,
                    7,
                    reach=(0.3, 5.0),
                    symbol="Td",
                    decisive=True,
                ),
            ),
        ),
        Form(
            name="power",
            equation="Fd*(t/t_1)**p",
            place=Place.PARALLEL,
            linear=(_FORCE,),
            nonlinear=(
                NonlinearParameter("exponent", "1", "one", 0.3, 2.0, 3, reach=(0.5, 1.5), symbol="p"),
            ),
            constants=(Constant("t_1", 1.0, "s"),),
        ),
    ),
)

_LINES = 3
"""How many of the strongest lines between the input's own are tried."""


def strongest_lines(motion: Motion, residual: np.ndarray) -> list[np.ndarray]:
    """Frequencies (Hz) at which the residual has its strongest lines, strongest first.

    Zero-padded periodogram with a Hann window. Trends (below 1.5 cycles per record) are left out; lines of a model
    error that repeats with a periodic input are left out by keeping away from the input's own strong lines.
    """
    padded = 8 * len(residual)
    window = np.hanning(len(residual))
    frequency = np.fft.rfftfreq(padded, motion.sampling_time)
    power = np.abs(np.fft.rfft((residual - residual.mean()) * window, padded)) ** 2
    excitation = np.abs(np.fft.rfft((motion.position - motion.position.mean()) * window, padded)) ** 2
    resolution = 1.0 / (len(residual) * motion.sampling_time)
    power[frequency < 1.5 * resolution] = 0.0
    peaks = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
    if not len(peaks):
        return [np.array([2 * resolution])]
    # How far a line stands out where the input is weak counts, not its height alone.
    weight = power[peaks] / (1e-3 * excitation.max() + excitation[peaks])
    by_weight = peaks[np.argsort(-weight)[:_LINES]]
    by_power = peaks[np.argsort(-power[peaks])[:1]]
    return [np.array([frequency[peak]]) for peak in dict.fromkeys([*by_weight, *by_power])]


_OVERTONES = 7
"""Highest multiple of a disturbance's frequency."""
_FREQUENCY = NonlinearParameter("frequency", "Hz", "time", 0.01, 50.0, 1, lines=0.7, symbol="f")

_FEWEST_CYCLES = 2.0
_APART = 0.5
"""Lines (1/duration) by which a disturbance must keep away from the excitation's own."""


def _no_disturbance(values, motion, force, noise, period) -> str:
    """Fewer than two cycles are a drift; a line of the excitation's own grid is the model's error."""
    frequency, duration = values["frequency"], float(motion.time[-1])
    if frequency * duration < _FEWEST_CYCLES:
        return f"its record holds {frequency * duration:.1f} cycles of it"
    if period and abs(frequency * period - round(frequency * period)) < _APART * period / duration:
        return "it repeats with the excitation"
    return ""


PERIODIC_DISTURBANCE = Effect(
    name="periodic_disturbance",
    mechanism="A force at a frequency of its own, unrelated to the input (breathing, pulse, a motor).",
    source="Pintelon and Schoukens, System Identification: A Frequency Domain Approach (2012), section 2.3",
    experiment="record the force at rest: the line stays",
    unrepeated=True,
    forms=(
        Form(
            name="sine",
            equation="A*sin(2*pi*f*t) + B*cos(2*pi*f*t)",
            place=Place.PARALLEL,
            contradiction=_no_disturbance,
            linear=(
                LinearParameter("sine_amplitude", "{y}", sign=0, symbol="A"),
                LinearParameter("cosine_amplitude", "{y}", sign=0, symbol="B"),
            ),
            nonlinear=(_FREQUENCY,),
            starts=strongest_lines,
        ),
        Form(
            name="overtones",
            equation=f"sum(n, 1, {_OVERTONES}, A_n*sin(n*(2*pi*f*t)) + B_n*cos(n*(2*pi*f*t)))",
            place=Place.PARALLEL,
            contradiction=_no_disturbance,
            linear=tuple(
                LinearParameter(f"{name}_amplitude_{order}", "{y}", sign=0, symbol=f"{symbol}_{order}")
                for order in range(1, _OVERTONES + 1)
                for name, symbol in (("sine", "A"), ("cosine", "B"))
            ),
            nonlinear=(_FREQUENCY,),
            starts=strongest_lines,
        ),
    ),
)

EFFECTS = (DRIFT, PERIODIC_DISTURBANCE)
