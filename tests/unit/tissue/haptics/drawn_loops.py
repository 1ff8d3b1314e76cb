"""Models and devices drawn at random, soft to stiff and slow to fast, and how their loops move in time."""

from dataclasses import replace

import numpy as np

from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.closed_loop import SampledModel
from lumbar.tissue.haptics.simulation import TissueForce, difference_equation, simulate
from lumbar.tissue.haptics.ticks import in_ticks


def drawn_device(rng: np.random.Generator) -> DeviceSettings:
    """A stylus and a hand; the servo is as fast as the model."""
    return DeviceSettings(
        mass_kg=float(rng.uniform(0.05, 1.0)),
        damping_N_s_m=float(np.exp(rng.uniform(np.log(0.5), np.log(20.0)))),
        hand_stiffness_N_m=float(np.exp(rng.uniform(np.log(50.0), np.log(2000.0)))),
        hand_damping_N_s_m=float(rng.uniform(0.0, 5.0)),
        hand_mass_kg=float(rng.choice([0.0, rng.uniform(0.0, 0.5)])),
        encoder_um=float(rng.choice([1.0, 10.0, 50.0])),
    )


def drawn_model(rng: np.random.Generator) -> SampledModel:
    """A stable model of order 0 to 4 with average and delay, soft to stiff."""
    order = int(rng.integers(0, 5))
    poles = rng.uniform(-0.5, 0.97, order).astype(complex)
    if order >= 2 and rng.random() < 0.3:
        poles[:2] = rng.uniform(0.2, 0.9) * np.exp(np.array([1j, -1j]) * rng.uniform(0.1, 3.0))
    denominator = np.atleast_1d(np.real(np.poly(poles)))
    zeros = rng.uniform(-0.8, 1.0, int(rng.integers(0, order + 1)))
    numerator = np.convolve(np.poly(zeros), np.ones(average := int(rng.integers(1, 5))) / average)
    numerator = np.concatenate([np.zeros(int(rng.integers(0, 2))), np.atleast_1d(numerator)])
    period = float(1.0 / np.exp(rng.uniform(np.log(50.0), np.log(2000.0))))
    stiffness = (
        np.exp(rng.uniform(np.log(0.02), np.log(3.0))) / period
    )  # about what damping of 1 N·s/m asks for
    size = np.abs(
        SampledModel("", numerator, denominator, period).response(np.linspace(0.01, np.pi, 200))
    ).max()
    model = SampledModel("drawn", stiffness / size * numerator, denominator, period)
    return model.late(float(rng.choice([0.0, rng.uniform(0.0, 1.5) * period])))


def growth(model: SampledModel, intervals, device, delay: float = 0.0, seconds: float = 4.0) -> float:
    """By how much the force moves more in the second half of a time than in the first, behind the push."""
    tick = TissueForce(difference_equation(model), model.sampling_time)
    exact = replace(device, encoder_um=0.0)
    run = simulate(tick, intervals, exact, np.inf, delay=delay, duration=0.3 + seconds)
    moving = run.samples[-int(seconds / np.mean(intervals)) :]
    first, second = np.array_split(np.diff(moving), 2)
    return float(np.ptp(second) / np.ptp(first))


def largest_pole(model, device: DeviceSettings, gain: float = 1.0) -> complex:
    """Pole of the closed loop with the largest magnitude over a period, in the upper half of the plane."""
    poles = np.linalg.eigvals(in_ticks(model).monodromy(device, gain))
    largest = poles[np.abs(poles).argmax()]
    return complex(largest.real, abs(largest.imag))
