"""Uncertainty of a fit's parameters, with 95 % intervals, and the part of a signal that a refit could explain."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, linear_with_new
from lumbar.tissue.models.form import Form, Place
from lumbar.tissue.models.model_data import FittedParameter, unit_of
from lumbar.tissue.models.structure import forces_of
from lumbar.tissue.models.tissue_models import MODELS

_MAX_LAGS = 20
"""Largest number of lags in the test of whiteness."""
_WHITENESS_LEVEL = 0.01
"""Probability that the test of whiteness rejects white errors."""
_WINDOW = 5.0
"""Length of the sum of a correlation, in correlation times: a longer sum only adds scatter."""
_BANDWIDTH = 12.0
"""Length of Bartlett's window in correlation times; it misses about 10 % of the variance, for which the critical value allows."""
_MIN_EFFECTIVE_SHARE = 0.5
"""Smallest share of independent samples that is left after subtraction of the parameters' degrees of freedom."""
_MAX_LOG_HALF_WIDTH = 20.0
"""Largest half-width of an interval of a logarithm."""
_MIN_SINGULAR_VALUE = 1e-9
"""Singular value, relative to the largest, below which a direction is rounding."""


def scaled_covariance(fit: Fit, data: FitData) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance of linear parameters and logarithms of nonlinear ones, each scaled by the norm of its sensitivity.

    It is the Gauss–Newton covariance s²(JᵀJ)⁻¹ if the whitened residual passes the test of whiteness; else (JᵀJ)⁻¹ Σ (JᵀJ)⁻¹ with
    the covariance Σ of the scores (`score_covariance`).

    Returns
    -------
    covariance : numpy.ndarray, shape (parameters, parameters)
    size : numpy.ndarray, shape (parameters,)
        2-norms of the sensitivities.
    """

    def compute() -> tuple[np.ndarray, np.ndarray]:
        jacobian = fit.sensitivities(data)
        size = np.maximum(np.sqrt(np.sum(jacobian**2, axis=0)), 1e-300)
        scaled = jacobian / size
        inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12)
        errors = fit.whitened_errors(data)
        if are_white(data.split_records(errors)):
            return inverse * fit.squared_error / max(data.size - jacobian.shape[1], 1), size
        return inverse @ score_covariance(data.split_records(scaled * errors[:, None])) @ inverse, size

    return data.cache.compute_once(("covariance", fit), compute)


def estimates(fit: Fit, data: FitData, input_unit: str, output_unit: str) -> list[FittedParameter]:
    """Return all parameters with 95 % intervals, linear parameters first.

    Intervals of nonlinear parameters are computed for the logarithms: they are positive and asymmetric (`scaled_covariance`). An
    interval that reaches a bound ends there.

    Parameters
    ----------
    fit : Fit
        Model fitted to `data`.
    data : FitData
        Training data.
    input_unit, output_unit : str
        Units of the records.
    """
    scaled, size = scaled_covariance(fit, data)
    deviations = 1.96 * np.sqrt(np.maximum(np.diag(scaled), 0.0)) / size
    structure = fit.structure
    parts = [("", structure.base), *((form.effect, form) for form in structure.forms)]
    owners = [owner for owner, part in parts for _ in part.linear]
    owners += [owner for owner, part in parts for _ in part.nonlinear]
    shown = [item.decode(value) for item, value in zip(structure.nonlinear, fit.nonlinear, strict=True)]
    items, values = (*structure.linear, *structure.nonlinear), (*fit.linear, *shown)
    parameters = []
    for index, (item, value, owner) in enumerate(zip(items, values, owners, strict=True)):
        low, high = value - deviations[index], value + deviations[index]
        if index < len(fit.linear):
            low, high = max(low, 0.0) if item.sign > 0 else low, min(high, 0.0) if item.sign < 0 else high
        elif not item.signed:
            low, high = _log_interval(value, deviations[index])
        numbers = map(float, (value, low, high))
        unit = unit_of(item.unit, input_unit, output_unit)
        parameters.append(FittedParameter(item.name, item.latex_symbol, unit, *numbers, owner))
    return parameters


def derived_estimates(fit: Fit, data: FitData, input_unit: str, output_unit: str) -> list[FittedParameter]:
    """Return the elements of a base of Table 2.1 (k1, k2, b … of Kelvin–Boltzmann) with 95 % intervals of their logarithms.

    Raises
    ------
    NumericalError
        If no spring or dashpot has these parameters.
    """
    model, base = MODELS.get(fit.structure.base.name), fit.structure.base
    if model is None:
        return []
    linear, names = len(base.linear), [item.name for item in (*base.linear, *base.nonlinear)]
    columns = [*range(linear), *range(len(fit.linear), len(fit.linear) + len(base.nonlinear))]
    values = np.concatenate([fit.linear[:linear], fit.nonlinear[: len(base.nonlinear)]])

    def element_values(numbers: np.ndarray) -> np.ndarray:
        by_name = model.element_values(dict(zip(names, numbers, strict=True)))
        return np.array([by_name[item.name] for item in model.elements])

    elements = element_values(values)  # raises before a division by a parameter that is zero
    scaled, size = scaled_covariance(fit, data)
    # Covariance of all logarithms: those of linear parameters by the first derivative.
    scale = size[columns] * np.where(np.arange(len(columns)) < linear, values, 1.0)
    covariances = scaled[np.ix_(columns, columns)] / np.outer(scale, scale)
    step = 1e-5
    gradient = []
    for unit in np.eye(len(columns), dtype=bool):
        high, low = (element_values(np.where(unit, values * np.exp(sign * step), values)) for sign in (1, -1))
        gradient.append(np.log(high / low) / (2 * step))
    variances = np.einsum("ij,ik,kj->j", gradient, covariances, gradient)
    parameters = []
    for item, value, variance in zip(model.elements, elements, variances, strict=True):
        numbers = map(float, (value, *_log_interval(value, 1.96 * np.sqrt(max(variance, 0.0)))))
        unit = unit_of(item.unit, input_unit, output_unit)
        parameters.append(FittedParameter(item.name, item.latex_symbol, unit, *numbers, derived=True))
    return parameters


def _log_interval(value: float, deviation: float) -> tuple[float, float]:
    """Return the interval of a positive number from the half-width of the interval of its logarithm."""
    factor = np.exp(min(deviation, _MAX_LOG_HALF_WIDTH))
    return value / factor, value * factor


def prediction_variance(fit: Fit, data: FitData, records: list[FitData]) -> float:
    """Return the mean variance of a fit's predictions of other records due to the uncertainty of its parameters.

    It is tr(J C Jᵀ)/N in the output's unit squared, with sensitivities J of the records and the covariance C of the parameters.
    """
    covariance, size = scaled_covariance(fit, data)
    total, count = 0.0, 0
    for record in records:
        jacobian = fit.sensitivities(record.drop_whitening())
        # If every training record has a zero, the uncertainty of theirs does not apply to this record.
        known = min(jacobian.shape[1], len(size)) if len(fit.zeros) <= 1 else len(size) - len(fit.zeros)
        scaled = jacobian[:, :known] / size[:known]
        total += float(np.einsum("ij,jk,ik->", scaled, covariance[:known, :known], scaled))
        count += len(scaled)
    return total / count


def unpredicted_errors(fit: Fit, data: FitData, record: FitData) -> np.ndarray:
    """Return the errors on another record without the part that is due to the uncertainty of the fit's parameters.

    This part is the expected force of other parameters, given these errors, with the covariance of the parameters as their prior
    distribution (linear Gaussian model). A record with noise only is returned almost unchanged.
    """
    covariance, size = scaled_covariance(fit, data)
    errors, jacobian = fit.whitened_errors(record), fit.sensitivities(record)
    known = min(jacobian.shape[1], len(size)) if len(fit.zeros) <= 1 else len(size) - len(fit.zeros)
    values, directions = np.linalg.eigh(covariance[:known, :known] * data.size / fit.squared_error)
    columns = (jacobian[:, :known] / size[:known]) @ (directions * np.sqrt(np.maximum(values, 0.0)))
    if not np.all(np.isfinite(columns)):
        return errors
    left, spread, _ = np.linalg.svd(columns, full_matrices=False)
    return errors - left @ ((spread / np.hypot(spread, 1.0)) ** 2 * (left.T @ errors))


def tangent_basis(fit: Fit, records: list[FitData]) -> np.ndarray:
    """Return an orthonormal basis of the model's tangent space at the samples that count, shape (samples, directions).

    To first order a refit moves the simulation within this span of the sensitivities; only the part of a signal outside the span
    distinguishes another model (Bates and Watts, Nonlinear Regression Analysis, 1988, chapter 2). Records are concatenated.
    """
    pieces = [fit.sensitivities(record) for record in records]
    if not any(record.has_own_zero for record in records):
        columns = np.concatenate(pieces)
    else:
        # Zeros are the last columns; every record has its own.
        shared = len(fit.linear) + len(fit.nonlinear)
        zeros = scipy.linalg.block_diag(*(piece[:, shared:] for piece in pieces))
        columns = np.hstack([np.concatenate([piece[:, :shared] for piece in pieces]), zeros])
    size = np.sqrt(np.sum(columns**2, axis=0))
    left, values, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return left[:, values > _MIN_SINGULAR_VALUE * values[0]]


def project_out(basis: np.ndarray, signals: np.ndarray) -> np.ndarray:
    """Return the part of signals (samples first) that is orthogonal to a basis."""
    return signals - basis @ (basis.T @ signals)


def whitened_simulation(fit: Fit, records: list[FitData]) -> np.ndarray:
    """Return the whitened free run at the samples that count, one record after another."""
    return np.concatenate([record.whiten(fit.simulate(record.motion)) for record in records])


def added_forces(fit: Fit, form: Form, data: FitData, start: np.ndarray) -> np.ndarray:
    """Return the whitened forces that a parallel form adds, one per amplitude, or the change that another form causes."""
    if form.place is Place.PARALLEL:
        return data.whiten(forces_of(form, data.motion, start))
    structure, linear = fit.structure.with_form(form), linear_with_new(fit, form)
    nonlinear = np.concatenate([fit.nonlinear, start])
    changed = replace(fit, structure=structure, linear=linear, nonlinear=nonlinear)
    return data.whiten(changed.simulate(data.motion) - fit.simulate(data.motion))[:, None]


def check_excited(without: Fit, form: Form, data: FitData, nonlinear: np.ndarray, name: str) -> None:
    """Reject an effect that the training record does not excite.

    An effect is not excited if even a force as large as the whole response would change the model's error by less than the noise.

    Parameters
    ----------
    without : Fit
        Model without the effect.
    form : Form
        Form of the effect.
    data : FitData
        Training data.
    nonlinear : numpy.ndarray
        Nonlinear parameters of the form.
    name : str
        Name of the model in the message.

    Raises
    ------
    InputError
        If the effect is not excited.
    """
    basis = tangent_basis(without, [data])
    forces = added_forces(without, form, data, nonlinear)
    size, left = np.sum(forces**2, axis=0), np.sum(project_out(basis, forces) ** 2, axis=0)
    error = without.squared_error / data.size
    response = float(np.var(data.trim(data.force)))
    # An effect of RMS r adds N r² left/size to the squared error; noise hides 1.96² of its own variance.
    hidden = (size == 0) | (left * data.size * response <= 1.96**2 * error * size)
    if np.all(hidden):
        raise InputError(
            f"{data.name}: the record does not excite {form.effect}: added to {name} it could be as large as the whole response "
            "unnoticed; leave it out, or train on a record that shows it"
        )


def are_white(errors: Sequence[np.ndarray]) -> bool:
    """Return whether errors of several records pass the test of whiteness of Ljung and Box (Biometrika 65 (1978) 297-303)."""
    size = sum(map(len, errors))
    lags = min(_MAX_LAGS, min(map(len, errors)) - 1)
    correlation = _autocorrelation([item[:, None] for item in errors], lags)[1:, 0]
    statistic = size * (size + 2) * np.sum(correlation**2 / (size - np.arange(1, lags + 1)))
    return bool(statistic < scipy.special.chdtri(lags, _WHITENESS_LEVEL))


def score_covariance(scores: Sequence[np.ndarray]) -> np.ndarray:
    """Return the covariance of the sum of correlated scores, scaled so that 1.96 standard deviations cover 95 %.

    Scores are correlated if noise is coloured or the model too small (Newey and West, Econometrica 55 (1987) 703-708; Hjalmarsson
    and Ljung, IEEE Trans. Automat. Contr. 37 (1992) 1004-1008); intervals for white noise are then several times too narrow.
    Bartlett's window spans `_BANDWIDTH` correlation times of the slowest score, within each record. If this is the share b of the
    samples, the critical value is 1.96 + 2.9694 b + 0.416 b² − 0.5324 b³ (Kiefer and Vogelsang, Econometric Theory 21 (2005)
    1130-1164, table 1), which allows for the scatter of the estimate. The parameters' degrees of freedom, in independent samples,
    correct for errors that are smaller than those of the true parameters.

    Parameters
    ----------
    scores : sequence of numpy.ndarray, shape (samples, parameters)
        Sensitivities times errors, by record.

    Returns
    -------
    numpy.ndarray, shape (parameters, parameters)
    """
    size = sum(map(len, scores))
    # At a bound they do not add up to 0; their mean is not scatter.
    mean = sum(item.sum(axis=0) for item in scores) / size
    centred = [item - mean for item in scores]
    times = correlation_times(centred)
    bandwidth = min(_BANDWIDTH * float(times.max()), float(size))
    middle = sum(bartlett_sum(item, bandwidth) for item in centred)
    share = bandwidth / size
    critical = 1.96 + 2.9694 * share + 0.416 * share**2 - 0.5324 * share**3
    effective = max(1 - 2 * float(times.sum()) / size, _MIN_EFFECTIVE_SHARE)
    return middle * (critical / 1.96) ** 2 / effective


def correlation_times(scores: Sequence[np.ndarray]) -> np.ndarray:
    """Return the integrated correlation time 1/2 + Σ ρ of each column, in samples: 1/2 if the samples are independent.

    The sum over lags ends at the first lag of at least `_WINDOW` correlation times (Madras and Sokal, J. Stat. Phys. 50 (1988)
    109-186).
    """
    lags = max(map(len, scores)) - 1
    times = np.cumsum(_autocorrelation(scores, lags), axis=0) - 0.5
    wide_enough = np.arange(lags + 1)[:, None] >= _WINDOW * times
    wide_enough[-1] = True
    return np.maximum(times[np.argmax(wide_enough, axis=0), np.arange(times.shape[1])], 0.5)


def _autocorrelation(series: Sequence[np.ndarray], lags: int) -> np.ndarray:
    """Return the autocorrelation of each column over all records, without removing means; shape (lags + 1, columns)."""
    total = np.zeros((lags + 1, series[0].shape[1]))
    for item in series:
        length = scipy.fft.next_fast_len(2 * len(item) - 1, real=True)
        power = np.abs(scipy.fft.rfft(item, length, axis=0)) ** 2
        products = scipy.fft.irfft(power, length, axis=0)[: min(lags + 1, len(item))]
        total[: len(products)] += products
    return total / np.where(total[0] > 0, total[0], 1.0)


def bartlett_sum(scores: np.ndarray, bandwidth: float) -> np.ndarray:
    """Return Σ w(k) Γ(k) with Bartlett's weights, computed in the frequency domain: there no weight is negative."""
    size = len(scores)
    length = scipy.fft.next_fast_len(2 * size - 1, real=True)
    lags = np.arange(1, min(int(np.ceil(bandwidth)), size))
    window = np.zeros(length)
    window[0] = 1.0
    window[lags] = window[-lags] = 1 - lags / bandwidth
    # A real signal's spectrum is symmetric: all frequencies count twice but the first, and the last of an even number.
    weights = scipy.fft.rfft(window).real
    weights[1 : None if length % 2 else -1] *= 2
    spectrum = scipy.fft.rfft(scores, length, axis=0)
    return ((spectrum.conj() * weights[:, None]).T @ spectrum).real / length
