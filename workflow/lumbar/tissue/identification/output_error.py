"""Output-error identification: coefficients that minimise the error of the free run.

ARX minimises the one-step-ahead error and is biased towards fast poles where the output is noisy, because the
noise is among its regressors. The output-error fit minimises what the model is used for, the free run from
the input alone; it is consistent for any noise that is independent of the input (Ljung, System
Identification, 2nd ed., section 8.4).
"""

from dataclasses import dataclass

import numpy as np
import scipy

from lumbar.base.errors import NumericalError
from lumbar.tissue.models.transfer_function import ArxStructure, TransferFunction

_UNSTABLE_PENALTY = 1e3  # multiple of the output's rms: makes the optimiser take a shorter step
_LARGEST_START_POLE = 0.995
_START_POLES = (-0.95, -0.5, 0.0, 0.3, 0.6, 0.8, 0.9, 0.97, 0.99, 0.999)
_STARTS_FOLLOWED = 3


@dataclass(frozen=True)
class OutputErrorFit:
    """A minimum of the simulation error."""

    coefficients: np.ndarray
    """Shape (parameters,)."""
    residuals: np.ndarray
    """Shape (samples − skip,): measured minus simulated output."""
    sensitivities: np.ndarray
    """Shape (samples − skip, parameters): derivative of the simulated output with respect to every coefficient."""
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
    inputs, outputs : numpy.ndarray, shape (samples,)
        Demeaned signals.
    starts : list of TransferFunction
        Where to start, e.g. the ARX solution; those of least error are followed, and the lowest minimum
        found is returned.
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
    for initial in initials[:_STARTS_FOLLOWED]:
        found = scipy.optimize.least_squares(
            residuals, initial, jac=jacobian, method="lm", x_scale="jac", xtol=1e-10, ftol=1e-12, max_nfev=300
        )
        if structure.transfer_function(found.x).stable and (best is None or found.cost < best.cost):
            best = found
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
    """Return starting values that span all relaxation times: the best numerator for each of some poles.

    The simulation error of a single-pole model can have several minima over its pole (Eq. 3.3 has), but for a
    given pole the numerator follows from linear least squares.

    Parameters
    ----------
    structure : ArxStructure
        Of order 1; other orders have no such starts.
    inputs, outputs : numpy.ndarray, shape (samples,)
        Demeaned signals.
    poles : tuple of float
        Inside (−1, 1).
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
    """Signal `samples` ago, its first value held before the record."""
    return np.concatenate([np.full(samples, signal[0]), signal[: len(signal) - samples]])


def stabilise(model: TransferFunction) -> TransferFunction:
    """Reflect poles outside the unit circle into it; for starting values."""
    if model.stable:
        return model
    poles = model.poles
    outside = np.abs(poles) >= 1.0
    poles[outside] = 1.0 / np.conj(poles[outside])
    magnitude = np.abs(poles)
    poles = np.where(
        magnitude > _LARGEST_START_POLE, poles * _LARGEST_START_POLE / np.maximum(magnitude, 1e-300), poles
    )
    return TransferFunction(model.numerator, tuple(np.real(np.poly(poles))))
