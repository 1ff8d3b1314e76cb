"""The residual of a free-run simulation, and the significance of its averages.

Every view tests whether a weighted sum Σ wₙeₙ of the residual e (a bin's mean, a correlation) is larger than noise explains. For
noise of spectrum S the variance of the sum is ∫ S |W|² df, whatever the colour of the noise; this variance decides significance.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy

from lumbar.base.formats import percent
from lumbar.tissue.diagnosis.noise.noise_floor import NoiseFloor, autocovariance, prediction_error_filter
from lumbar.tissue.diagnosis.noise.periods import Folding

SIGNIFICANT = 0.01
"""Level of significance of a view."""
_SHIFTS = 41
_ORDER = 20
"""Order of the autoregressive model that replaces unknown noise."""


@dataclass(frozen=True)
class Average:
    """Means of the residual over groups of samples."""

    mean: np.ndarray
    """Mean of each group, shape (groups,)."""
    deviation: np.ndarray
    """Standard deviation of each mean under noise only, shape (groups,)."""
    count: np.ndarray
    """Number of samples of each group, shape (groups,)."""
    share: float
    """Share of the explainable variance that the means account for; see `share_beyond_chance`."""
    p_value: float
    """Probability of such large means under noise only."""

    @property
    def significant_share(self) -> float:
        """`share` if the means are significant, else 0."""
        return self.share if self.p_value < SIGNIFICANT else 0.0


@dataclass(frozen=True, eq=False)
class Residual:
    """Measured minus simulated output, from the first sample that counts."""

    values: np.ndarray
    """Residual in the output's unit, shape (samples,)."""
    time: np.ndarray
    """Time in seconds, shape (samples,)."""
    position: np.ndarray
    """Position in the input's unit, shape (samples,)."""
    velocity: np.ndarray
    """Velocity in the input's unit per second, shape (samples,)."""
    sampling_time: float
    unit: str
    position_unit: str
    moved: str
    """Quantity of the input, e.g. ``"position"`` or ``"angle"``."""
    floor: NoiseFloor | None
    folding: Folding | None
    """Whole periods, as indices into `values`; None if the record does not repeat."""

    @cached_property
    def variance(self) -> float:
        """Mean squared residual."""
        return float(np.mean(self.values**2))

    @cached_property
    def explainable(self) -> float:
        """Mean squared residual minus the variance of the noise; the mean squared residual if the noise is unknown."""
        noise = self.floor.rms**2 if self.floor is not None else 0.0
        return max(self.variance - noise, 0.0)

    @property
    def error_name(self) -> str:
        """Name of the error that shares refer to."""
        return "explainable error" if self.floor is not None else "error"

    def share(self, variance: float) -> float:
        """Return a variance as a share of the explainable variance, between 0 and 1."""
        if self.explainable <= 0:
            return 0.0
        return float(np.clip(variance / self.explainable, 0.0, 1.0))

    @cached_property
    def whitening(self) -> np.ndarray:
        """FIR filter that makes the noise white; ``[1]`` if it is white or unknown, or known at another rate only."""
        if self.floor is None or abs(self.floor.sampling_time / self.sampling_time - 1) > 1e-3:
            return np.ones(1)
        return self.floor.whitening

    @cached_property
    def _noise_model(self) -> tuple[np.ndarray, float]:
        """Whitening filter and variance of the noise.

        Without a noise floor they are computed from the residual: tests are then cautious, because the error that a model
        could explain also counts as noise.
        """
        if self.floor is not None:
            return self.whitening, self.floor.rms**2
        order = min(_ORDER, len(self.values) // 10)
        prediction, gain = prediction_error_filter(autocovariance(self.values, order))
        return prediction * np.sqrt(gain), self.variance

    def noise_power(self, frequency: np.ndarray) -> np.ndarray:
        """Return the noise spectrum at frequencies in Hz as variance per sample, which is constant for white noise."""
        whitening, variance = self._noise_model
        gain = np.polyval(whitening[::-1], np.exp(-2j * np.pi * frequency * self.sampling_time))
        return variance / np.abs(gain) ** 2

    def covariance(self, weights: np.ndarray) -> np.ndarray:
        """Return the covariance of the sums Σₙ weights[i, n] eₙ under noise only; shape (sums, sums)."""
        if self.floor is not None and len(self.whitening) == 1:
            return self.floor.rms**2 * (weights @ weights.T)
        parts = self.noise_parts(weights)
        return parts @ parts.T

    def noise_parts(self, weights: np.ndarray) -> np.ndarray:
        """Return the contribution of each independent part of the noise to the sums of `covariance`; shape (sums, parts)."""
        length = 1 << int(np.ceil(np.log2(weights.shape[1])))
        transform = np.fft.rfft(weights, length, axis=1)
        power = self.noise_power(np.fft.rfftfreq(length, self.sampling_time)) * 2 / length
        power[[0, -1]] /= 2
        return (transform * np.sqrt(power)).view(float)  # real and imaginary parts side by side

    def averages(self, groups: np.ndarray, count: int) -> Average:
        """Average over groups of samples; `groups` has the group of each sample, counted from 0, or −1 for no group."""
        inside = groups >= 0
        number = np.bincount(groups[inside], minlength=count)
        filled = np.flatnonzero(number)

        def sums(values: np.ndarray) -> np.ndarray:
            return np.bincount(groups[inside], values[inside], count)[filled]

        means = sums(self.values) / number[filled]
        if self.floor is not None and len(self.whitening) == 1:
            covariance = np.diag(self.floor.rms**2 / number[filled])  # white: disjoint groups are unrelated
        else:
            covariance = self.covariance((groups == filled[:, None]) / number[filled, None])
        variance = np.diag(covariance)
        mean, deviation = np.full(count, np.nan), np.full(count, np.nan)
        mean[filled], deviation[filled] = means, np.sqrt(variance)

        def explained(values: np.ndarray) -> float:
            return float(np.sum(sums(values) ** 2 / number[filled])) / values.size

        noise = float(number[filled] @ variance) / len(self.values)
        share = self.share_beyond_chance(explained, noise)
        return Average(mean, deviation, number, share, chi_square_p(means, covariance))

    @property
    def span(self) -> int:
        """Number of samples of a period, or of the record if it does not repeat."""
        return len(self.values) if self.folding is None else self.folding.samples

    def share_beyond_chance(self, explained: Callable[[np.ndarray], float], noise: float) -> float:
        """Return `share_beyond_chance` of the residual."""
        return share_beyond_chance(self.values, self.explainable, self.span, explained, noise)


def share_beyond_chance(
    values: np.ndarray, explainable: float, span: int, explained: Callable[[np.ndarray], float], noise: float
) -> float:
    """Return the share of the explainable variance that a relation accounts for beyond chance.

    An error that is smooth in time has some correlation with any smooth signal. The share by chance, S₀, is the mean share that
    the relation explains if the error is shifted in time (periodically). The result is (S − S₀)/(1 − S₀), as in Cohen's κ.

    `values` has the samples along its last axis; a period or the record has `span` samples. `explained` returns the mean square
    that the relation explains of a signal of the shape of `values`; `noise` is the mean square that it explains of noise.
    """
    if explainable <= 0:
        return 0.0
    shifts = np.unique(np.linspace(0.1, 0.9, _SHIFTS) * span).astype(int)
    share = (explained(values) - noise) / explainable
    chance = (np.mean([explained(np.roll(values, shift, axis=-1)) for shift in shifts]) - noise) / explainable
    chance = min(max(float(chance), 0.0), 1.0)
    return float(np.clip((share - chance) / (1 - chance), 0.0, 1.0)) if chance < 0.999 else 0.0


def chi_square_p(
    sums: np.ndarray, covariance: np.ndarray, smallest: float = 1e-6, noise_freedom: float = np.inf
) -> float:
    """Return the probability that noise of this covariance gives such large sums; directions without variance do not count.

    `noise_freedom` is the number of degrees of freedom of the noise level (F test).
    """
    if not sums.size:
        return 1.0
    values, vectors = np.linalg.eigh(covariance)
    if values[-1] <= 0:
        return 1.0
    used = values > smallest * values[-1]
    statistic = np.sum((sums @ vectors[:, used]) ** 2 / values[used])
    if np.isfinite(noise_freedom):
        return float(scipy.special.fdtrc(used.sum(), noise_freedom, statistic / used.sum()))
    return float(scipy.special.chdtrc(used.sum(), statistic))


def steady_velocity(position: np.ndarray, sampling_time: float) -> np.ndarray:
    """Return the velocity by central differences, over more samples if the position is noisy.

    The span grows until the noise (from third differences, which smooth motion hardly has) gives less than 1 % of
    the velocity's variance.
    """
    noise = np.mean(np.diff(position, 3) ** 2) / 20
    span, longest = 1, max(len(position) // 50, 1)
    while True:
        slope = (position[2 * span :] - position[: -2 * span]) / (2 * span * sampling_time)
        if span >= longest or noise / (2 * (span * sampling_time) ** 2) < 0.01 * np.var(slope):
            break
        span += 1
    before, after = np.full(span, slope[0]), np.full(span, slope[-1])
    return np.concatenate([before, slope, after])


@dataclass(frozen=True)
class View:
    """View of the error along one quantity."""

    name: str
    """Name of the view, e.g. ``"reversals"``."""
    share: float | None
    """Share of the explainable error's variance that this view accounts for, without noise; None for a view without share. Views
    overlap, so their shares do not add up."""
    p_value: float
    """Probability of such a large share under noise only."""
    sentence: str
    """Description of the view with numbers."""
    table: dict[str, np.ndarray] = field(default_factory=dict)
    """Columns of equal length, for views that are drawn."""
    numbers: dict = field(default_factory=dict)
    """Numbers in the sentence, by name."""


def format_share(share: float) -> str:
    """Format a share in percent, marked if it is small."""
    return f"only {percent(share)}" if share < 0.1 else percent(share)


def probability(p_value: float) -> str:
    """Format a probability, e.g. ``"p = 0.03"``."""
    return "p < 0.0001" if p_value < 1e-4 else f"p = {p_value:.2g}"
