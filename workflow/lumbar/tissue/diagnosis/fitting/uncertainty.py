"""Intervals of fitted parameters from the curvature of the training error, and from how its errors depend on one another."""

from __future__ import annotations

import numpy as np

from lumbar.tissue.diagnosis.fitting.dependent_errors import are_white, score_covariance
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.forward.forward_fit import ForwardFit
from lumbar.tissue.models.model_data import FittedParameter, unit_of
from lumbar.tissue.models.tissue_models import MODELS

_WIDEST = 20.0
"""Largest half-width of an interval of a logarithm."""


def estimates(fit: Fit, data: FitData, input_unit: str, output_unit: str) -> list[FittedParameter]:
    """Return all parameters with 95 % intervals, linear ones first.

    From the covariance of linear parameters and of logarithms of nonlinear ones (`scaled_covariance`; positive, with
    asymmetric intervals). Parameters at a bound have an interval that ends there.
    """
    scaled, size = scaled_covariance(fit, data)
    deviations = 1.96 * np.sqrt(np.maximum(np.diag(scaled), 0.0)) / size
    structure = fit.structure
    owners = [""] * len(structure.base.linear) + [
        form.effect for form in structure.forms for _ in form.linear
    ]
    owners += [""] * len(structure.base.nonlinear)
    owners += [form.effect for form in structure.forms for _ in form.nonlinear]
    ends = []
    for item, value, deviation in zip(structure.linear, fit.linear, deviations, strict=False):
        low, high = value - deviation, value + deviation
        ends.append((max(low, 0.0) if item.sign > 0 else low, min(high, 0.0) if item.sign < 0 else high))
    shapes = deviations[len(fit.linear) : len(fit.linear) + len(fit.nonlinear)]
    for value, deviation in zip(fit.nonlinear, shapes, strict=True):
        ends.append(_around(value, deviation))
    items, values = (*structure.linear, *structure.nonlinear), (*fit.linear, *fit.nonlinear)
    return [
        FittedParameter(
            item.name,
            item.in_latex,
            unit_of(item.unit, input_unit, output_unit),
            float(value),
            float(low),
            float(high),
            owner,
        )
        for item, value, (low, high), owner in zip(items, values, ends, owners, strict=True)
    ]


def derived_estimates(fit: Fit, data: FitData, input_unit: str, output_unit: str) -> list[FittedParameter]:
    """Return the elements of the base (k1, k2, b … of Kelvin–Boltzmann) with 95 % intervals of their logarithms.

    A base that is not of Table 2.1 has none.

    Raises
    ------
    NumericalError
        If no spring or dashpot has these parameters.
    """
    model, base = MODELS.get(fit.structure.base.name), fit.structure.base
    if model is None:
        return []
    linear, names = len(base.linear), [item.name for item in (*base.linear, *base.nonlinear)]
    own = [*range(linear), *range(len(fit.linear), len(fit.linear) + len(base.nonlinear))]
    values = np.concatenate([fit.linear[:linear], fit.nonlinear[: len(base.nonlinear)]])
    found = model.derived(dict(zip(names, values, strict=True)))
    scaled, size = scaled_covariance(fit, data)
    # Covariance of all logarithms: those of linear parameters by the first derivative.
    scale = size[own] * np.where(np.arange(len(own)) < linear, values, 1.0)
    covariances = scaled[np.ix_(own, own)] / np.outer(scale, scale)
    step = 1e-5
    gradient = []
    for index in range(len(own)):
        ends = [
            np.where(np.arange(len(own)) == index, values * np.exp(way * step), values) for way in (1, -1)
        ]
        high, low = (model.derived(dict(zip(names, end, strict=True))) for end in ends)
        gradient.append([np.log(high[name] / low[name]) / (2 * step) for name in found])
    variances = np.einsum("ij,ik,kj->j", gradient, covariances, gradient)
    return [
        FittedParameter(
            item.name,
            item.in_latex,
            unit_of(item.unit, input_unit, output_unit),
            float(found[item.name]),
            *map(float, _around(found[item.name], 1.96 * np.sqrt(max(variance, 0.0)))),
            derived=True,
        )
        for item, variance in zip(model.elements, variances, strict=True)
    ]


def _around(value: float, deviation: float) -> tuple[float, float]:
    """Interval of a positive number from that of its logarithm."""
    factor = np.exp(min(deviation, _WIDEST))
    return value / factor, value * factor


def scaled_covariance(fit: Fit, data: FitData) -> tuple[np.ndarray, np.ndarray]:
    """Covariance of linear parameters and logarithms of nonlinear ones, each times its sensitivity's size.

    Gauss–Newton, s²(JᵀJ)⁻¹, where the whitened residual passes for white; else (JᵀJ)⁻¹ Σ (JᵀJ)⁻¹ with the covariance Σ of the
    scores (`lumbar.tissue.diagnosis.fitting.dependent_errors`).

    Returns
    -------
    numpy.ndarray, shape (parameters, parameters)
    numpy.ndarray, shape (parameters,)
        Sizes: 2-norms of the sensitivities.
    """
    return data.kept(("covariance", fit), lambda: _scaled_covariance(fit, data))


def _scaled_covariance(fit: Fit, data: FitData) -> tuple[np.ndarray, np.ndarray]:
    jacobian = sensitivities(fit, data)
    size = np.maximum(np.sqrt(np.sum(jacobian**2, axis=0)), 1e-300)
    scaled = jacobian / size
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12)
    errors = fit.whitened_errors(data)
    if are_white(data.by_record(errors)):
        return inverse * fit.squared_error / max(data.size - jacobian.shape[1], 1), size
    return inverse @ score_covariance(data.by_record(scaled * errors[:, None])) @ inverse, size


def sensitivities(fit: Fit, data: FitData) -> np.ndarray:
    """Derivatives of the whitened simulation by linear parameters, logarithms of nonlinear ones, and the sensor's zeros.

    By central differences, of a model that a force drives from its equations; the zeros, where there are any, come last.

    Returns
    -------
    numpy.ndarray, shape (samples that count, parameters)
    """
    if isinstance(fit, ForwardFit):
        return fit.sensitivities(data)
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
    if structure.base.sensor_zero:
        columns += list(data.counted(data.zeros).T)
    return np.stack(columns, axis=1)


def zero_interval(fit: Fit, data: FitData) -> tuple[float, float]:
    """95 % interval of the sensor's zero, the last where records have their own; 0 where the base has none."""
    if not fit.structure.base.sensor_zero:
        return 0.0, 0.0
    scaled, size = scaled_covariance(fit, data)
    deviation = 1.96 * float(np.sqrt(max(scaled[-1, -1], 0.0)) / size[-1])
    zero = float(fit.zeros[-1])
    return zero - deviation, zero + deviation


def prediction_variance(fit: Fit, data: FitData, records: list[FitData]) -> float:
    """Mean variance of a fit's predictions of other records that comes from the uncertainty of its parameters.

    In the output's unit squared: tr(J C Jᵀ)/N, J the records' sensitivities and C the parameters' covariance.
    """
    covariance, size = scaled_covariance(fit, data)
    total, count = 0.0, 0
    for record in records:
        jacobian = sensitivities(fit, record.unwhitened())
        # Zeros that every training record has of its own say nothing of this one.
        known = min(jacobian.shape[1], len(size)) if len(fit.zeros) <= 1 else len(size) - len(fit.zeros)
        scaled = jacobian[:, :known] / size[:known]
        total += float(np.einsum("ij,jk,ik->", scaled, covariance[:known, :known], scaled))
        count += len(scaled)
    return total / count
