"""Tests of a simulation's residual: whether it is noise, and what it is related to.

A residual that is related to the input holds dynamics or nonlinearity that a better model would explain (Ljung,
System Identification, 2nd ed., section 16.6). Even functions of the input, z² and |v|, show what a correlation with the
input itself cannot: a force that is not mirrored when the motion is (Billings and Voon, Int. J. Control 44, 1986).
Limits follow from the noise's spectrum and the function's own, so they hold for coloured noise too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lumbar.tissue.diagnosis.noise.noise_floor import autocovariance
from lumbar.tissue.diagnosis.residuals.residual import (
    SIGNIFICANT,
    Residual,
    View,
    chi_square_p,
    only,
    probability,
)

_NORMAL_975 = 1.959964
_WHITENESS_LAGS = 20
_LAGS = 25
_RELAXATIONS = 8
"""Time constants, spread evenly in logarithm, that span linear dynamics."""
_MOSTLY = 0.8
_WEAK = 0.3
"""Correlations below this share of the largest are weak beside it, however significant."""
LINEAR_FUNCTIONS = ("z", "v")
EVEN_FUNCTIONS = ("z²", "|v|")
ODD_FUNCTIONS = ("z³", "sign v", "v|v|")


def ljung_box(values: np.ndarray, lags: int) -> tuple[float, float]:
    """Ljung–Box statistic N(N+2) Σ ρ²/(N−k) and its p-value with `lags` degrees of freedom (Biometrika 65, 1978)."""
    from scipy.special import chdtrc

    size = len(values)
    covariance = autocovariance(values - values.mean(), lags)
    if covariance[0] <= 0:
        return 0.0, 1.0
    correlation = covariance[1:] / covariance[0]
    statistic = float(size * (size + 2) * np.sum(correlation**2 / (size - np.arange(1, lags + 1))))
    return statistic, float(chdtrc(lags, statistic))


def whiteness_view(residual: Residual) -> View:
    """Ljung–Box test of the residual, whitened by the noise's spectrum where the noise is coloured.

    Columns ``lag`` (s), ``correlation`` and ``limit`` (95 %).
    """
    whitened = np.convolve(residual.values, residual.whitening, mode="valid")
    lags = min(_WHITENESS_LAGS, len(whitened) // 5)
    _, p_value = ljung_box(whitened, lags)
    centred = whitened - whitened.mean()
    energy = np.sum(centred**2)
    correlation = np.array([centred[lag:] @ centred[: len(centred) - lag] for lag in range(1, lags + 1)])
    correlation /= energy if energy > 0 else 1.0
    table = {
        "lag": np.arange(1, lags + 1) * residual.sampling_time,
        "correlation": correlation,
        "limit": np.full(lags, _NORMAL_975 / np.sqrt(len(whitened))),
    }
    noise = "noise of the floor's colour" if len(residual.whitening) > 1 else "white noise"
    tested = f"Ljung–Box over {lags} lags, {probability(p_value)}"
    if p_value < SIGNIFICANT:
        told = f"is not {noise} ({tested}); neighbouring samples correlate by {correlation[0]:.2f}"
    else:
        told = f"cannot be told from {noise} ({tested})"
    sentence = f"Whiteness: the error {told}."
    return View("whiteness", 0.0, p_value, sentence, table)


def linear_view(residual: Residual) -> View:
    """How much of the residual better linear dynamics could explain.

    The residual is projected on position, velocity and relaxations of the position with eight time constants.
    """
    columns = _linear_columns(residual)
    covariance = residual.covariance(columns.T)
    p_value = chi_square_p(columns.T @ residual.values, covariance)

    def explained(values: np.ndarray) -> float:
        return float(np.sum((columns.T @ values) ** 2)) / values.size

    share = residual.share_beyond_chance(explained, float(np.trace(covariance)) / len(residual.values))
    if p_value < SIGNIFICANT:
        told = (
            "a richer linear model is worth trying"
            if share > _MOSTLY
            else "the rest is not linear in the input"
        )
        sentence = (
            f"Linear dynamics: stiffness, damping and relaxations fitted to the error itself would explain {only(share)} "
            f"of the {residual.base_words} of this record ({probability(p_value)}); {told}."
        )
    else:
        sentence = (
            f"Linear dynamics: the error is not related to the input linearly ({probability(p_value)})."
        )
    return View("linear dynamics", share if p_value < SIGNIFICANT else 0.0, p_value, sentence, {})


def _linear_columns(residual: Residual) -> np.ndarray:
    """Orthonormal columns of position, velocity and relaxed positions, their means taken off; (samples, columns)."""
    stacked = linear_columns(residual, relaxation_times([residual]))
    return _orthonormal(stacked / np.maximum(np.sqrt(np.mean(stacked**2, axis=0)), 1e-300))


def relaxation_times(residuals: Sequence[Residual]) -> np.ndarray:
    """Time constants (s) that span linear dynamics on all records."""
    step = max(item.sampling_time for item in residuals)
    shortest = min(item.time[-1] - item.time[0] for item in residuals)
    return np.geomspace(2 * step, max(shortest, 20 * step) / 5, _RELAXATIONS)


def linear_columns(residual: Residual, times: np.ndarray) -> np.ndarray:
    """Position, velocity and relaxed positions (time constants in s), their means taken off; shape (samples, columns)."""
    from scipy.signal import lfilter

    step, position = residual.sampling_time, residual.position
    columns = [position, residual.velocity]
    for time_constant in times:
        decay = np.exp(-step / time_constant)
        columns.append(lfilter([1 - decay], [1, -decay], position - position[0]) + position[0])
    stacked = np.column_stack(columns)
    return stacked - stacked.mean(axis=0)


def _orthonormal(columns: np.ndarray) -> np.ndarray:
    left, values, _ = np.linalg.svd(columns, full_matrices=False)
    return left[:, values > 1e-5 * values[0]]


def correlation_view(residual: Residual) -> View:
    """Cross-correlation of the residual with the input and with even and odd functions of it.

    Of the others is taken what is neither linear in the input nor shared with functions of the other kind: z² is
    related to z³ wherever the motion is not mirrored about zero.

    Columns ``function``, ``lag`` (s, of the input's past), ``correlation`` and ``limit`` (95 % under noise alone).
    """
    functions = {name: values - values.mean() for name, values in _functions(residual).items()}
    linear = _linear_columns(residual)
    table: dict[str, list] = {"function": [], "lag": [], "correlation": [], "limit": []}
    numbers = {}
    for name, signal in functions.items():
        if name not in LINEAR_FUNCTIONS:
            others = ODD_FUNCTIONS if name in EVEN_FUNCTIONS else EVEN_FUNCTIONS
            known = np.column_stack([linear, *(functions[other] for other in others)])
            basis = _orthonormal(known / np.maximum(np.sqrt(np.mean(known**2, axis=0)), 1e-300))
            signal = signal - basis @ (basis.T @ signal)
        lags, correlation, limit, p_value = cross_correlation(residual, signal)
        table["function"] += [name] * len(lags)
        table["lag"] += list(lags * residual.sampling_time)
        table["correlation"] += list(correlation)
        table["limit"] += [limit] * len(lags)
        numbers[f"p {name}"] = p_value
    even = min(1.0, len(EVEN_FUNCTIONS) * min(numbers[f"p {name}"] for name in EVEN_FUNCTIONS))
    odd = min(1.0, len(ODD_FUNCTIONS) * min(numbers[f"p {name}"] for name in ODD_FUNCTIONS))
    p_value = min(1.0, len(numbers) * min(numbers.values()))
    numbers |= {"p even": even, "p odd": odd}
    arrays = {key: np.array(column) for key, column in table.items()}
    return View(
        "correlations", 0.0, p_value, _correlation_sentence(arrays, numbers, p_value), arrays, numbers
    )


def _functions(residual: Residual) -> dict[str, np.ndarray]:
    position, velocity = residual.position - residual.position.mean(), residual.velocity
    speed = np.std(velocity)
    return {
        "z": position,
        "v": velocity,
        "z²": position**2,
        "|v|": np.abs(velocity),
        "z³": position**3,
        "sign v": np.tanh(velocity / (0.1 * speed)) if speed > 0 else velocity,
        "v|v|": velocity * np.abs(velocity),
    }


def cross_correlation(residual: Residual, signal: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Correlation of the residual with the past of a signal.

    Lags run circularly: under the null hypothesis the wrapped signal is as unrelated as the signal.

    Returned are lags in samples, coefficients from −1 to 1, the 95 % limit of each under noise alone, and the p-value
    of all lags together.
    """
    size = len(signal)
    longest = int(min(np.sqrt(size), size // 10))
    lags = np.unique(np.linspace(0, longest, min(_LAGS, longest + 1)).astype(int))
    transform = np.fft.rfft(signal)
    covariance = np.fft.irfft(np.fft.rfft(residual.values) * transform.conj(), size)[lags]
    power = residual.noise_power(np.fft.rfftfreq(size, residual.sampling_time))
    of_noise = np.fft.irfft(power * np.abs(transform) ** 2, size)
    together = of_noise[np.abs(lags[:, None] - lags[None, :])]
    scale = np.sqrt(np.sum(residual.values**2) * np.sum(signal**2))
    if scale == 0:
        return lags, np.zeros(len(lags)), 0.0, 1.0
    limit = float(_NORMAL_975 * np.sqrt(of_noise[0]) / scale)
    return lags, covariance / scale, limit, chi_square_p(covariance, together, 1e-3)


def _correlation_sentence(table: dict[str, np.ndarray], numbers: dict, p_value: float) -> str:
    if p_value >= SIGNIFICANT:
        return f"Correlations: the error is related to no function of the input that was tried ({probability(p_value)})."
    found = []
    for kind, names, meaning in (
        ("position and velocity", LINEAR_FUNCTIONS, "linear dynamics"),
        (
            "even functions",
            EVEN_FUNCTIONS,
            "an even nonlinearity: a force that is not mirrored with the motion",
        ),
        ("odd functions", ODD_FUNCTIONS, "an odd nonlinearity: a force that is mirrored with the motion"),
    ):
        if min(1.0, len(names) * min(numbers[f"p {name}"] for name in names)) < SIGNIFICANT:
            mine = np.isin(table["function"], names)
            top = int(np.argmax(np.abs(table["correlation"][mine])))
            found.append((table["correlation"][mine][top], table["function"][mine][top], kind, meaning))
    found.sort(key=lambda item: -abs(item[0]))
    weak = _WEAK * abs(found[0][0])
    strong = [
        f"{kind} (up to {value:+.2f} with {name}; {words})"
        for value, name, kind, words in found
        if abs(value) > weak
    ]
    faint = [f"{kind} ({value:+.2f} with {name})" for value, name, kind, _ in found if abs(value) <= weak]
    listed = f"to {', '.join(strong)}" + (f"; weakly also to {', '.join(faint)}" if faint else "")
    return f"Correlations: the error is related {listed}; noise alone stays below {np.median(table['limit']):.2g}."
