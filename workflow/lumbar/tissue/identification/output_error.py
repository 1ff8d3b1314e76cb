"""Output-error identification: coefficients that minimise the error of the free run.

ARX minimises the one-step-ahead error and is biased towards fast poles if the output is noisy, because the noise is among its
regressors. The output-error fit minimises the error of the free run from the input only; it is consistent for any noise that
is independent of the input (Ljung, System Identification, 2nd ed., section 8.4).
"""

from dataclasses import dataclass

import numpy as np
import scipy

from lumbar.base.errors import NumericalError
from lumbar.tissue.models.transfer_function import ArxStructure, TransferFunction

_UNSTABLE_PENALTY = 1e3  # multiple of the output's rms: makes the optimiser take a shorter step
_MAX_START_POLE = 0.995
_START_POLES = (-0.95, -0.5, 0.0, 0.3, 0.6, 0.8, 0.9, 0.97, 0.99, 0.999)
_MAX_STARTS = 3


@dataclass(frozen=True)
class OutputErrorFit:
    """A minimum of the simulation error."""

    coefficients: np.ndarray
    residuals: np.ndarray
    """Measured minus simulated output, shape (samples − skip,)."""
    sensitivities: np.ndarray
    """Derivatives of the simulated output by the coefficients, shape (samples − skip, parameters)."""
    converged: bool
    """False if the optimiser stopped on a nearly flat slope: the data hardly determine the coefficients."""


def fit_output_error(
    structure: ArxStructure,
    inputs: np.ndarray,
    outputs: np.ndarray,
    starts: list[TransferFunction],
    skip: int,
) -> OutputErrorFit:
    """Minimise the squared simulation error by Levenberg–Marquardt with exact sensitivities.

    Parameters
    ----------
    structure : ArxStructure
        Orders and lags.
    inputs, outputs : numpy.ndarray, shape (samples,)
        Demeaned signals.
    starts : list of TransferFunction
        Starts, e.g. the ARX solution; those with the smallest errors are used, and the lowest minimum is returned.
    skip : int
        Samples at the beginning that do not count (start of the record).

    Raises
    ------
    NumericalError
        If no start leads to a stable model.
    """
    penalty = np.full(len(outputs) - skip, _UNSTABLE_PENALTY * np.sqrt(np.mean(outputs**2)))

    def residuals(coefficients):
        model = structure.transfer_function(coefficients)
        return (model.simulate(inputs) - outputs)[skip:] if model.stable else penalty

    def jacobian(coefficients):
        return simulation_sensitivities(structure, coefficients, inputs)[skip:]

    initials = [structure.coefficients(stabilise(start)) for start in starts]
    initials.sort(key=lambda coefficients: float(np.sum(residuals(coefficients) ** 2)))
    best = None
    for initial in initials[:_MAX_STARTS]:
        result = scipy.optimize.least_squares(
            residuals, initial, jac=jacobian, method="lm", x_scale="jac", xtol=1e-10, ftol=1e-12, max_nfev=300
        )
        if structure.transfer_function(result.x).stable and (best is None or result.cost < best.cost):
            best = result
    if best is None:
        raise NumericalError("no start of the output-error fit leads to a stable model")
    return OutputErrorFit(best.x, -residuals(best.x), jacobian(best.x), best.status > 0)


def simulation_sensitivities(
    structure: ArxStructure, coefficients: np.ndarray, inputs: np.ndarray
) -> np.ndarray:
    """Differentiate the free run with respect to every free coefficient, shape (samples, parameters).

    With ŷ = (B/A) u: ∂ŷ/∂b_j = z⁻ʲ u/A and ∂ŷ/∂(−a_i) = z⁻ⁱ ŷ/A, all started from rest at the first input.
    """
    model = structure.transfer_function(coefficients)
    inverse = TransferFunction((1.0,), model.denominator)
    filtered_input = inverse.simulate(inputs)
    filtered_output = inverse.simulate(model.simulate(inputs))
    lag = structure.largest_lag
    columns = [_delayed(filtered_output, i) for i in range(1, lag + 1)]
    columns += [_delayed(filtered_input, j) for j in range(lag + 1)]
    return np.column_stack(columns) @ structure.combination(lag)


def relaxation_starts(
    structure: ArxStructure, inputs: np.ndarray, outputs: np.ndarray, poles: tuple[float, ...] = _START_POLES
) -> list[TransferFunction]:
    """Return the best numerator for each of some poles in (−1, 1), which span all relaxation times; only for order 1.

    The simulation error of a single-pole model can have several minima over its pole (Eq. 3.3 has), but for a given pole the
    numerator follows from linear least squares.
    """
    if structure.order != 1:
        return []
    lag = structure.largest_lag
    starts = []
    for pole in poles:
        filtered = TransferFunction((1.0,), (1.0, -pole)).simulate(inputs)
        delayed = np.column_stack([_delayed(filtered, j) for j in range(lag + 1)])
        numerator, *_ = np.linalg.lstsq(delayed @ structure.combination(lag)[lag:, 1:], outputs)
        starts.append(structure.transfer_function(np.array([pole, *numerator])))
    return starts


def _delayed(signal: np.ndarray, samples: int) -> np.ndarray:
    """Delay a signal by samples; before the record it has its first value."""
    return np.concatenate([np.full(samples, signal[0]), signal[: len(signal) - samples]])


def stabilise(model: TransferFunction) -> TransferFunction:
    """Reflect poles outside the unit circle into it; for starting values."""
    if model.stable:
        return model
    poles = model.poles
    outside = np.abs(poles) >= 1.0
    poles[outside] = 1.0 / np.conj(poles[outside])
    size = np.abs(poles)
    poles = np.where(size > _MAX_START_POLE, poles * _MAX_START_POLE / np.maximum(size, 1e-300), poles)
    return TransferFunction(model.numerator, tuple(np.real(np.poly(poles))))
