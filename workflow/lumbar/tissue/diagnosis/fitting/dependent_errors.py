"""Covariance of least-squares scores whose errors depend on one another: coloured noise, or what a wrong model leaves.

The sandwich of Huber and White with the scores' own correlation in its middle (Newey and West, Econometrica 55 (1987)
703-708; for models that are too small Hjalmarsson and Ljung, IEEE Trans. Automat. Contr. 37 (1992) 1004-1008): white-noise
intervals of such fits are several times too narrow.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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


def are_white(errors: Sequence[np.ndarray]) -> bool:
    """Whether errors of several records pass for white noise: the test of Ljung and Box (Biometrika 65 (1978) 297-303)."""
    from scipy.stats import chi2

    size = sum(map(len, errors))
    lags = min(_LAGS, min(map(len, errors)) - 1)
    correlation = _autocorrelation([item[:, None] for item in errors], lags)[1:, 0]
    statistic = size * (size + 2) * np.sum(correlation**2 / (size - np.arange(1, lags + 1)))
    return bool(statistic < chi2.ppf(1 - _LEVEL, lags))


def score_covariance(scores: Sequence[np.ndarray]) -> np.ndarray:
    """Covariance of the sum of scores, so that 1.96 standard deviations of it hold 95 %.

    Bartlett's window over `_BANDWIDTH` correlation times of the slowest score, within each record. Normal quantiles take the
    estimate for the truth; those of Kiefer and Vogelsang (Econometric Theory 21 (2005) 1130-1164, table 1) at this share b of
    the samples, 1.96 + 2.9694 b + 0.416 b² − 0.5324 b³, know how it scatters. The errors of a fit are smaller than those of
    the truth by the degrees of freedom, which are counted in independent samples.

    Parameters
    ----------
    scores : sequence of numpy.ndarray, each of shape (samples, parameters)
        Sensitivities times errors, by record.

    Returns
    -------
    numpy.ndarray, shape (parameters, parameters)
    """
    size = sum(map(len, scores))
    # At a bound they do not add up to 0; their mean is no scatter.
    mean = sum(item.sum(axis=0) for item in scores) / size
    centred = [item - mean for item in scores]
    times = correlation_times(centred)
    bandwidth = min(_BANDWIDTH * float(times.max()), float(size))
    middle = sum(_windowed(item, bandwidth) for item in centred)
    share = bandwidth / size
    critical = 1.96 + 2.9694 * share + 0.416 * share**2 - 0.5324 * share**3
    effective = max(1 - 2 * float(times.sum()) / size, _LEAST_EFFECTIVE)
    return middle * (critical / 1.96) ** 2 / effective


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
    """Of each column over all records, without removing means; shape (lags + 1, columns)."""
    from scipy.fft import irfft, next_fast_len, rfft

    total = np.zeros((lags + 1, series[0].shape[1]))
    for item in series:
        length = next_fast_len(2 * len(item) - 1, real=True)
        power = np.abs(rfft(item, length, axis=0)) ** 2
        found = irfft(power, length, axis=0)[: min(lags + 1, len(item))]
        total[: len(found)] += found
    return total / np.where(total[0] > 0, total[0], 1.0)


def _windowed(scores: np.ndarray, bandwidth: float) -> np.ndarray:
    """Σ w(k) Γ(k) with Bartlett's weights, in the frequency domain, where they are never negative."""
    from scipy.fft import next_fast_len, rfft

    size = len(scores)
    length = next_fast_len(2 * size - 1, real=True)
    lags = np.arange(1, min(int(np.ceil(bandwidth)), size))
    window = np.zeros(length)
    window[0] = 1.0
    window[lags] = window[-lags] = 1 - lags / bandwidth
    # A real signal's spectrum is symmetric: all frequencies count twice but the first, and the last of an even number.
    weights = rfft(window).real
    weights[1 : None if length % 2 else -1] *= 2
    spectrum = rfft(scores, length, axis=0)
    return ((spectrum.conj() * weights[:, None]).T @ spectrum).real / length
