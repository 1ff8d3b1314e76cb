"""How much of what a model leaves is nonlinear: the best linear approximation of a periodic record and its distortion.

In the steady state a linear tissue answers a periodic motion at the lines of that motion only, and there with a frequency
response that is smooth from line to line. What the mean period holds beside that is nonlinear distortion (Pintelon and
Schoukens, System Identification: A Frequency Domain Approach, 2012, chapters 4 and 7: best linear approximation, local
polynomial method). A nonlinear force also shifts the linear approximation, so that its distortion is less than all it does.
"""

from __future__ import annotations

import numpy as np

from lumbar.records.record import Channel, Record
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.linear.higher_order import LinearDynamics
from lumbar.tissue.diagnosis.noise.noise_floor import NoiseFloor
from lumbar.tissue.diagnosis.noise.periods import Folding, fold_periods
from lumbar.tissue.diagnosis.residuals.time_frequency import excited_lines

_WINDOW = 9
"""Neighbouring excited lines over which the response is taken as a parabola."""
_DEGREES = 3
_ABOVE_NOISE = 2.0
"""Power of a residual in that of its noise, below which it holds too little to be divided."""


def nonlinear_share(experiment: Experiment, fit: Fit | LinearDynamics) -> float | None:
    """Share of a model's repeating error, its noise aside, that no linear model can explain.

    Returns
    -------
    float or None
        From 0 to 1, a lower bound; None where no training record repeats, where it excites too few lines to compare
        neighbours, or where the model leaves hardly more than noise.
    """
    floor = experiment.floor
    if floor is None:
        return None
    data = _record(experiment)
    folding = _folding(data, floor)
    error = data.force - fit.simulate(data.motion)
    position, force, error = (
        folding.fold(data.own(signal)).mean(axis=0) for signal in (data.motion.position, data.force, error)
    )
    excited = excited_lines(position)
    if len(excited) < 2 * _WINDOW:
        return None
    noise = _noise_power(floor, folding)
    left = np.abs(np.fft.rfft(error)[1:]) ** 2
    if left.sum() < _ABOVE_NOISE * noise.sum():
        return None
    distortion = distortion_power(np.fft.rfft(position), np.fft.rfft(force), excited)[1:]
    share = (distortion.sum() - noise.sum()) / (left.sum() - noise.sum())
    return float(np.clip(share, 0.0, 1.0))


def distortion_power(inputs: np.ndarray, outputs: np.ndarray, excited: np.ndarray) -> np.ndarray:
    """Power at every line of an output's spectrum that the best linear approximation does not explain, noise included.

    Parameters
    ----------
    inputs, outputs : numpy.ndarray of complex, shape (lines,)
        Spectra of a mean period.
    excited : numpy.ndarray of int
        Lines of the input, at least `_WINDOW`.

    Returns
    -------
    numpy.ndarray, shape (lines,)
        Squared magnitude in the unit of the spectrum; at excited lines the estimate from their neighbourhood.
    """
    power = np.abs(outputs) ** 2
    for index, line in enumerate(excited):
        first = min(max(index - _WINDOW // 2, 0), len(excited) - _WINDOW)
        near = excited[first : first + _WINDOW]
        distance = (near - line) / max(near[-1] - near[0], 1)
        columns = inputs[near, None] * distance[:, None] ** np.arange(_DEGREES)
        fitted = columns @ np.linalg.lstsq(columns, outputs[near], rcond=1e-12)[0]
        power[line] = np.sum(np.abs(outputs[near] - fitted) ** 2) / (_WINDOW - _DEGREES)
    return power


def _record(experiment: Experiment) -> FitData:
    """Training record that the noise floor was taken from."""
    return next(item for item in experiment.training.records if item.name == experiment.floor_from)


def _folding(data: FitData, floor: NoiseFloor) -> Folding:
    channels = {
        "input": Channel(data.own(data.motion.position), "position", ""),
        "output": Channel(data.own(data.force), "force", ""),
    }
    return fold_periods(Record(data.name, data.own(data.motion.time), channels), floor.period)


def _noise_power(floor: NoiseFloor, folding: Folding) -> np.ndarray:
    """Expected squared magnitude of the noise at the lines of the mean period's spectrum, from line 1 on."""
    frequency = np.fft.rfftfreq(folding.samples, floor.sampling_time)[1:]
    density = floor.density(frequency) / 2  # two-sided
    return density * folding.samples / floor.sampling_time / len(folding.rows)
