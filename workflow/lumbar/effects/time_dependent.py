"""Effects of time alone: drift and disturbances at a frequency of their own."""

from __future__ import annotations

import numpy as np

from lumbar.models.c_step import CStep
from lumbar.models.form import Effect, Form, LinearParameter, NonlinearParameter, Place
from lumbar.models.motion import Motion

DRIFT = Effect(
    name="drift",
    mechanism="Force added that depends on time alone: sensor warming up, tissue settling.",
    source="ISO 376:2011, creep of force transducers",
    experiment="record the force at rest for the length of a test",
    accumulates=True,
    forms=(
        Form(
            name="linear",
            equation=r"r\,t",
            place=Place.PARALLEL,
            linear=(LinearParameter("drift_rate", "{y}/s", sign=0),),
            columns=lambda motion, _: [motion.time],
            c_step=CStep("drift_rate * time"),
        ),
        Form(
            name="settling",
            equation=r"F_d (1 - e^{-t/T_d})",
            place=Place.PARALLEL,
            linear=(LinearParameter("drift_force", "{y}", sign=0),),
            nonlinear=(NonlinearParameter("settling_time", "s", "duration", 0.01, 1.0, 7, reach=(0.3, 5.0)),),
            columns=lambda motion, nonlinear: [-np.expm1(-motion.time / nonlinear[0])],
            c_step=CStep("drift_force * -portable_expm1(-time / settling_time)"),
        ),
        Form(
            name="power",
            equation=r"F_d\,(t/t_1)^p,\quad t_1 = \text{1 s}",
            place=Place.PARALLEL,
            linear=(LinearParameter("drift_force", "{y}", sign=0),),
            nonlinear=(NonlinearParameter("exponent", "1", "one", 0.3, 2.0, 3, reach=(0.5, 1.5)),),
            columns=lambda motion, nonlinear: [motion.time ** nonlinear[0]],
            c_step=CStep("drift_force * portable_power(time, exponent)"),
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


_OVERTONES_IN_C = " + ".join(
    f"sine_amplitude_{order} * portable_sine({order} * turns)"
    f" + cosine_amplitude_{order} * portable_cosine({order} * turns)"
    for order in range(1, _OVERTONES + 1)
)


def _overtones(motion, nonlinear):
    phase = 2 * np.pi * nonlinear[0] * motion.time
    return [wave(order * phase) for order in range(1, _OVERTONES + 1) for wave in (np.sin, np.cos)]


PERIODIC_DISTURBANCE = Effect(
    name="periodic_disturbance",
    mechanism="A force at a frequency of its own, unrelated to the input (breathing, pulse, a motor).",
    source="Pintelon and Schoukens, System Identification: A Frequency Domain Approach (2012), section 2.3",
    experiment="record the force at rest: the line stays",
    forms=(
        Form(
            name="sine",
            equation=r"A \sin(2\pi f t) + B \cos(2\pi f t)",
            place=Place.PARALLEL,
            linear=(
                LinearParameter("sine_amplitude", "{y}", sign=0),
                LinearParameter("cosine_amplitude", "{y}", sign=0),
            ),
            nonlinear=(NonlinearParameter("frequency", "Hz", "time", 0.01, 50.0, 1, lines=0.7),),
            columns=lambda motion, nonlinear: [
                np.sin(2 * np.pi * nonlinear[0] * motion.time),
                np.cos(2 * np.pi * nonlinear[0] * motion.time),
            ],
            starts=strongest_lines,
            c_step=CStep(
                "sine_amplitude * portable_sine(turns) + cosine_amplitude * portable_cosine(turns)",
                "double turns = frequency * time;",
            ),
        ),
        Form(
            name="overtones",
            equation=r"\sum_{n=1}^{7} A_n \sin(2\pi n f t) + B_n \cos(2\pi n f t)",
            place=Place.PARALLEL,
            linear=tuple(
                LinearParameter(f"{name}_amplitude_{order}", "{y}", sign=0)
                for order in range(1, _OVERTONES + 1)
                for name in ("sine", "cosine")
            ),
            nonlinear=(NonlinearParameter("frequency", "Hz", "time", 0.01, 50.0, 1, lines=0.7),),
            columns=_overtones,
            c_step=CStep(_OVERTONES_IN_C, "double turns = frequency * time;"),
            starts=strongest_lines,
        ),
    ),
)

EFFECTS = (DRIFT, PERIODIC_DISTURBANCE)
