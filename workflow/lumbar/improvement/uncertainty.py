"""Intervals of fitted parameters from the curvature of the training error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.improvement.fit_data import FitData
from lumbar.improvement.fitting import Fit


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 95 % interval.

    Attributes
    ----------
    name, unit : str
    value, low, high : float
    effect : str
        Empty for the base's own.
    """

    name: str
    unit: str
    value: float
    low: float
    high: float
    effect: str = ""


def estimates(fit: Fit, data: FitData, input_unit: str, output_unit: str) -> list[Estimate]:
    """Return all parameters with 95 % intervals.

    Gauss–Newton covariance s²(JᵀJ)⁻¹ of amplitudes and of logarithms of shapes (shapes are positive, their intervals
    asymmetric); s² from the whitened residual. Parameters at a bound have an interval that ends there.
    """
    jacobian = sensitivities(fit, data)
    size = np.maximum(np.sqrt(np.sum(jacobian**2, axis=0)), 1e-300)
    variance = fit.squared_error / max(data.size - jacobian.shape[1], 1)
    inverse = np.linalg.pinv((jacobian / size).T @ (jacobian / size), rcond=1e-12)
    deviation = 1.96 * np.sqrt(np.maximum(variance * np.diag(inverse), 0.0)) / size
    owners = [""] * len(fit.structure.base.amplitudes)
    owners += [form.effect for form in fit.structure.forms for _ in form.amplitudes]
    found = []
    for index, (amplitude, value) in enumerate(zip(fit.structure.amplitudes, fit.amplitudes, strict=True)):
        low, high = value - deviation[index], value + deviation[index]
        low = max(low, 0.0) if amplitude.sign > 0 else low
        high = min(high, 0.0) if amplitude.sign < 0 else high
        unit = _unit(amplitude.unit, input_unit, output_unit)
        found.append(Estimate(amplitude.name, unit, float(value), float(low), float(high), owners[index]))
    owners = [""] * len(fit.structure.base.shapes)
    owners += [form.effect for form in fit.structure.forms for _ in form.shapes]
    for index, (shape, value) in enumerate(zip(fit.structure.shapes, fit.shapes, strict=True)):
        factor = float(np.exp(min(deviation[len(fit.amplitudes) + index], 20.0)))
        unit = _unit(shape.unit, input_unit, output_unit)
        found.append(
            Estimate(
                shape.name, unit, float(value), float(value / factor), float(value * factor), owners[index]
            )
        )
    return found


def _unit(template: str, input_unit: str, output_unit: str) -> str:
    return template.replace("{x}", input_unit).replace("{y}", output_unit)


def sensitivities(fit: Fit, data: FitData) -> np.ndarray:
    """Derivatives of the whitened simulation by amplitudes and logarithms of shapes, by central differences.

    Returns
    -------
    numpy.ndarray, shape (samples that count, amplitudes and shapes)
    """
    structure, motion = fit.structure, data.motion

    def simulated(amplitudes, logarithms):
        return data.counted(structure.simulate(motion, amplitudes, np.exp(logarithms)))

    logarithms = np.log(fit.shapes)
    columns = []
    scale = np.abs(fit.amplitudes)
    steps = 1e-4 * np.where(scale > 0, scale, max(scale.max(), 1e-6))
    for index, step in enumerate(steps):
        change = np.zeros(len(fit.amplitudes))
        change[index] = step
        difference = simulated(fit.amplitudes + change, logarithms) - simulated(
            fit.amplitudes - change, logarithms
        )
        columns.append(difference / (2 * step))
    for index in range(len(logarithms)):
        change = np.zeros(len(logarithms))
        change[index] = 1e-4
        difference = simulated(fit.amplitudes, logarithms + change) - simulated(
            fit.amplitudes, logarithms - change
        )
        columns.append(difference / 2e-4)
    return np.stack(columns, axis=1)
