"""Intervals of fitted parameters from the curvature of the training error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.diagnosis.fitting.fit_data import FitData
from lumbar.diagnosis.fitting.joint_fit import Fit


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

    Gauss–Newton covariance s²(JᵀJ)⁻¹ of linear parameters and of logarithms of nonlinear ones (positive, with
    asymmetric intervals); s² from the whitened residual. Parameters at a bound have an interval that ends there.
    """
    jacobian = sensitivities(fit, data)
    size = np.maximum(np.sqrt(np.sum(jacobian**2, axis=0)), 1e-300)
    variance = fit.squared_error / max(data.size - jacobian.shape[1], 1)
    inverse = np.linalg.pinv((jacobian / size).T @ (jacobian / size), rcond=1e-12)
    deviation = 1.96 * np.sqrt(np.maximum(variance * np.diag(inverse), 0.0)) / size
    owners = [""] * len(fit.structure.base.linear)
    owners += [form.effect for form in fit.structure.forms for _ in form.linear]
    found = []
    for index, (linear_parameter, value) in enumerate(zip(fit.structure.linear, fit.linear, strict=True)):
        low, high = value - deviation[index], value + deviation[index]
        low = max(low, 0.0) if linear_parameter.sign > 0 else low
        high = min(high, 0.0) if linear_parameter.sign < 0 else high
        unit = _unit(linear_parameter.unit, input_unit, output_unit)
        found.append(
            Estimate(linear_parameter.name, unit, float(value), float(low), float(high), owners[index])
        )
    owners = [""] * len(fit.structure.base.nonlinear)
    owners += [form.effect for form in fit.structure.forms for _ in form.nonlinear]
    for index, (shape, value) in enumerate(zip(fit.structure.nonlinear, fit.nonlinear, strict=True)):
        factor = float(np.exp(min(deviation[len(fit.linear) + index], 20.0)))
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
    """Derivatives of the whitened simulation by linear parameters and logarithms of nonlinear parameters, by central differences.

    Returns
    -------
    numpy.ndarray, shape (samples that count, linear and nonlinear parameters)
    """
    structure, motion = fit.structure, data.motion

    def simulated(linear, logarithms):
        return data.counted(structure.simulate(motion, linear, np.exp(logarithms)))

    logarithms = np.log(fit.nonlinear)
    columns = []
    scale = np.abs(fit.linear)
    steps = 1e-4 * np.where(scale > 0, scale, max(scale.max(), 1e-6))
    for index, step in enumerate(steps):
        change = np.zeros(len(fit.linear))
        change[index] = step
        difference = simulated(fit.linear + change, logarithms) - simulated(fit.linear - change, logarithms)
        columns.append(difference / (2 * step))
    for index in range(len(logarithms)):
        change = np.zeros(len(logarithms))
        change[index] = 1e-4
        difference = simulated(fit.linear, logarithms + change) - simulated(fit.linear, logarithms - change)
        columns.append(difference / 2e-4)
    return np.stack(columns, axis=1)
