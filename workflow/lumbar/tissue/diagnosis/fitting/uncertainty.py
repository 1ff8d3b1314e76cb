"""What records say of a fit's parameters: sensitivities, 95 % intervals, and what a refit could take up of a signal."""

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

_LAGS = 20
"""Autocorrelations that the test of whiteness looks at."""
_LEVEL = 0.01
"""Probability that white errors are taken for dependent ones."""
_WINDOW = 5.0
"""Correlation times over which a correlation is summed: beyond, the sum gathers nothing but its own scatter."""
_BANDWIDTH = 12.0
"""Correlation times that Bartlett's window spans; it then misses about a tenth of the variance, for which the critical value
allows."""
_LEAST_EFFECTIVE = 0.5
"""Share of the samples that the estimates' own degrees of freedom leave at least."""
_WIDEST = 20.0
"""Largest half-width of an interval of a logarithm."""
_SMALLEST = 1e-9
"""Directions whose singular value is below this share of the largest are rounding."""


def scaled_covariance(fit: Fit, data: FitData) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance of linear parameters and logarithms of nonlinear ones, each times its sensitivity's size.

    Gauss–Newton, s²(JᵀJ)⁻¹, if the whitened residual passes the test of whiteness; else (JᵀJ)⁻¹ Σ (JᵀJ)⁻¹ with the
    covariance Σ of the scores (`score_covariance`).

    The covariance has shape (parameters, parameters); the sizes, 2-norms of the sensitivities, come second, shape
    (parameters,).
    """
    return data.cache.compute_once(("covariance", fit), lambda: _scaled_covariance(fit, data))


def _scaled_covariance(fit: Fit, data: FitData) -> tuple[np.ndarray, np.ndarray]:
    jacobian = fit.sensitivities(data)
    size = np.maximum(np.sqrt(np.sum(jacobian**2, axis=0)), 1e-300)
    scaled = jacobian / size
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12)
    errors = fit.whitened_errors(data)
    if are_white(data.split_records(errors)):
        return inverse * fit.squared_error / max(data.size - jacobian.shape[1], 1), size
    return inverse @ score_covariance(data.split_records(scaled * errors[:, None])) @ inverse, size


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
    shown = [item.decode(value) for item, value in zip(structure.nonlinear, fit.nonlinear, strict=True)]
    for item, value, deviation in zip(structure.nonlinear, shown, shapes, strict=True):
        ends.append((value - deviation, value + deviation) if item.signed else _around(value, deviation))
    items, values = (*structure.linear, *structure.nonlinear), (*fit.linear, *shown)
    return [
        FittedParameter(
            item.name,
            item.latex_symbol,
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
    found = model.element_values(dict(zip(names, values, strict=True)))
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
        high, low = (model.element_values(dict(zip(names, end, strict=True))) for end in ends)
        gradient.append([np.log(high[name] / low[name]) / (2 * step) for name in found])
    variances = np.einsum("ij,ik,kj->j", gradient, covariances, gradient)
    return [
        FittedParameter(
            item.name,
            item.latex_symbol,
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
        jacobian = fit.sensitivities(record.drop_whitening())
        # Zeros that every training record has of its own say nothing of this one.
        known = min(jacobian.shape[1], len(size)) if len(fit.zeros) <= 1 else len(size) - len(fit.zeros)
        scaled = jacobian[:, :known] / size[:known]
        total += float(np.einsum("ij,jk,ik->", scaled, covariance[:known, :known], scaled))
        count += len(scaled)
    return total / count


def tangent_basis(fit: Fit, records: list[FitData]) -> np.ndarray:
    """Orthonormal basis of the tangent space over all samples that count of these records, one record after another.

    To first order a refit moves the simulation within the tangent space of the model, the span of its sensitivities; only
    what lies outside tells another model from it (Bates and Watts, Nonlinear Regression Analysis, 1988, chapter 2).

    The result has shape (samples, directions).
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
    return left[:, values > _SMALLEST * values[0]]


def project_out(basis: np.ndarray, signals: np.ndarray) -> np.ndarray:
    """Part of signals (samples first) that is orthogonal to a basis."""
    return signals - basis @ (basis.T @ signals)


def whitened_simulation(fit: Fit, records: list[FitData]) -> np.ndarray:
    """Whitened free run over all samples that count of these records, one record after another."""
    return np.concatenate([record.whiten(fit.simulate(record.motion)) for record in records])


def added_forces(fit: Fit, form: Form, data: FitData, start: np.ndarray) -> np.ndarray:
    """Whitened forces that a form adds, one per amplitude; of forms without linear parameters the change it makes."""
    if form.place is Place.PARALLEL:
        return data.whiten(forces_of(form, data.motion, start))
    structure, linear = fit.structure.with_form(form), linear_with_new(fit, form)
    changed = replace(
        fit, structure=structure, linear=linear, nonlinear=np.concatenate([fit.nonlinear, start])
    )
    return data.whiten(changed.simulate(data.motion) - fit.simulate(data.motion))[:, None]


def check_excited(without: Fit, form: Form, data: FitData, nonlinear: np.ndarray, name: str) -> None:
    """Refuse an effect that the training record does not excite.

    That is so where a force as large as the whole response would change the model's error by less than the noise: the 95 %
    interval of the effect's size then holds everything.

    `without` is the model without the effect, `data` the training record; `nonlinear` are the form's parameters, `name`
    is the model's, for the message.
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
            "without being seen; leave it out, or train on a record that shows it"
        )


def are_white(errors: Sequence[np.ndarray]) -> bool:
    """Return whether errors of several records pass the test of whiteness of Ljung and Box (Biometrika 65 (1978) 297-303)."""
    size = sum(map(len, errors))
    lags = min(_LAGS, min(map(len, errors)) - 1)
    correlation = _autocorrelation([item[:, None] for item in errors], lags)[1:, 0]
    statistic = size * (size + 2) * np.sum(correlation**2 / (size - np.arange(1, lags + 1)))
    return bool(statistic < scipy.special.chdtri(lags, _LEVEL))


def score_covariance(scores: Sequence[np.ndarray]) -> np.ndarray:
    """Covariance of the sum of scores that depend on one another, so that 1.96 standard deviations of it hold 95 %.

    They do where noise is coloured, or a wrong model leaves more than noise: the sandwich of Huber and White with the scores' own
    correlation in its middle (Newey and West, Econometrica 55 (1987) 703-708; for models that are too small Hjalmarsson and
    Ljung, IEEE Trans. Automat. Contr. 37 (1992) 1004-1008). White-noise intervals of such fits are several times too narrow.

    Bartlett's window over `_BANDWIDTH` correlation times of the slowest score, within each record. Normal quantiles take the
    estimate for the truth; those of Kiefer and Vogelsang (Econometric Theory 21 (2005) 1130-1164, table 1) at this share b of
    the samples, 1.96 + 2.9694 b + 0.416 b² − 0.5324 b³, know how it scatters. The errors of a fit are smaller than those of
    the truth by the degrees of freedom, which are counted in independent samples.

    `scores` are sensitivities times errors by record, each of shape (samples, parameters); the covariance has shape
    (parameters, parameters).
    """
    size = sum(map(len, scores))
    # At a bound they do not add up to 0; their mean is not scatter.
    mean = sum(item.sum(axis=0) for item in scores) / size
    centred = [item - mean for item in scores]
    times = correlation_times(centred)
    bandwidth = min(_BANDWIDTH * float(times.max()), float(size))
    middle = sum(_bartlett_sum(item, bandwidth) for item in centred)
    share = bandwidth / size
    critical = 1.96 + 2.9694 * share + 0.416 * share**2 - 0.5324 * share**3
    effective = max(1 - 2 * float(times.sum()) / size, _LEAST_EFFECTIVE)
    return middle * (critical / 1.96) ** 2 / effective


def variance_of_sum(series: Sequence[np.ndarray]) -> float:
    """Variance of the sum of numbers of mean 0 that depend on their neighbours, by record.

    Bartlett's window over the square root of all samples, which follows no clock.
    """
    bandwidth = float(np.sqrt(sum(map(len, series))))
    return float(sum(_bartlett_sum(item[:, None], bandwidth)[0, 0] for item in series))


def correlation_times(scores: Sequence[np.ndarray]) -> np.ndarray:
    """Integrated correlation time 1/2 + Σ ρ of each column in samples, 1/2 where they are independent.

    Summed over the smallest window of `_WINDOW` such times (Sokal's rule: Madras and Sokal, J. Stat. Phys. 50 (1988)
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
        found = scipy.fft.irfft(power, length, axis=0)[: min(lags + 1, len(item))]
        total[: len(found)] += found
    return total / np.where(total[0] > 0, total[0], 1.0)


def _bartlett_sum(scores: np.ndarray, bandwidth: float) -> np.ndarray:
    """Σ w(k) Γ(k) with Bartlett's weights, in the frequency domain, where they are never negative."""
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
