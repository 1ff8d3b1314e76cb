"""The noise floor of a periodic record: the part of the output that no model of its input can explain.

The first period is the transient; the spread of the other periods about their mean is noise. Drift, softening and disturbances
at other frequencies, which would increase the floor many times, are subtracted first (module `nonrepeating`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import scipy

from lumbar.base.formats import percent
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.noise.nonrepeating import (
    AMPLITUDE,
    DRIFT,
    LINE,
    OTHER,
    StructuredPart,
    excess,
    line_power,
    remove_structure,
    smooth_power,
)
from lumbar.tissue.diagnosis.noise.periods import MAX_DIFFERENCE, MIN_PERIODS, find_period, fold_periods

_MIN_BURST_SIGMAS = 6.0
"""Smallest `relation_of_sizes`, in standard errors, that noise of any colour and distribution cannot cause."""
_MIN_CORRELATION_EXCESS = 0.25
"""Smallest excess of the correlation of neighbouring large deviations over that of small deviations, as a share of its distance
from 1: noise of a sensor that grows with the force, and jitter of the clock, do not last."""
_INTERVALS, _WHITE_LEVEL = 10, 0.001
"""Number of intervals of the second halves of two periods; level of a test of their means against white noise."""
_MISSING_END = 0.02
"""Largest share of a period that may be missing at the end of a record."""
_MIN_BURST_PERIODS = 4
"""Smallest number of periods for two differences of two periods that are independent of each other."""
_QUIET_SHARE = 0.25
"""Share of the phases in which the noise is measured: phases with the smallest spread in other periods."""
_AVERAGED_PHASES = 5
"""Number of phases over which a spread is averaged."""
_LOUD_RATIO = 2.5
"""Ratio of the variance to that of the noise above which a phase is not quiet."""
WHITENING_ORDER = 12
"""Highest order of the autoregressive model of the noise."""
_ORDER_GAIN = 0.998
"""Smallest share of the highest order's prediction gain that a lower order must reach."""
_EXACT_INPUT = 1e-4
"""Deviation of an input between periods, relative to its standard deviation, below which the input repeats exactly."""
_DIGITS = 1e-9
"""Resolution of a record's digits, as a share of the response, below which it is rounding."""
_MAX_UNNAMED_SHARE = 0.5
"""Largest ratio of the variance of unnamed changes to that of bursts; at larger ratios the changes explain the bursts."""
_NORMAL_975, _NORMAL_99, _NORMAL_999 = 1.959964, 2.326348, 3.090232
"""Quantiles of the normal distribution."""
_MIN_SAMPLES_TO_PERIODS = 10
"""Least ratio of the samples of a period to the number of periods: with fewer, noise of many periods resembles structure."""
_MIN_LONG_PERIODS = 3
"""Least number of long periods."""


@dataclass(frozen=True, eq=False)
class NoiseFloor:
    """Noise of an output: the part that does not repeat with a periodic input and has no structure."""

    rms: float
    """RMS of the noise per sample, in the output's unit."""
    low: float
    """Lower end of the 95 % interval of `rms` (χ²)."""
    high: float
    structured: tuple[tuple[str, float], ...]
    """Description and RMS of every part that does not repeat and is not noise, the largest first. The
    descriptions begin with ``drift``, ``amplitude change``, ``off-grid line``, ``other change`` or ``bursts``."""
    structured_rms: float
    """RMS of all parts of `structured` together; 0 if no part is significant."""
    spectrum: tuple[np.ndarray, np.ndarray]
    """Frequency (Hz) and one-sided power spectral density (unit²/Hz) of the noise at the multiples of 1/period."""
    degrees_of_freedom: float
    """Degrees of freedom of `rms`, with the noise's colour taken into account."""
    period: float
    """Period in seconds."""
    sampling_time: float
    """Sampling time in seconds."""
    periods: int
    """Number of periods used, without the transient."""
    halves: bool = False
    """True if the record has only two periods: only their second halves count."""
    exact: bool = False
    """True if the periods are equal to the last digit: `rms` is then the resolution of the digits."""

    @cached_property
    def whitening(self) -> np.ndarray:
        """FIR filter that makes the noise white and keeps its variance; ``[1]`` if it is white already.

        The filter is autoregressive, by the Yule–Walker equations, and of the lowest order that predicts the noise nearly as
        well as order `WHITENING_ORDER`, if this order predicts the noise better than it would predict white noise by chance.
        """
        samples = round(self.period / self.sampling_time)
        density = self.spectrum[1].copy()
        density[0] *= 2  # one-sided: the lines at 0 and, of an even number, at the end count once
        if samples % 2 == 0:
            density[-1] *= 2
        covariance = np.fft.irfft(density, samples)
        order = min(WHITENING_ORDER, len(covariance) // 4)
        full_gain = prediction_error_filter(covariance[: order + 1])[1]
        # Degrees of freedom of white noise; coloured noise has fewer only because of its colour.
        white = (self.periods - 1) * samples
        if full_gain <= 1 + (order + 4 * np.sqrt(2 * order)) / white:
            return np.ones(1)
        filters = (prediction_error_filter(covariance[: lower + 1]) for lower in range(1, order + 1))
        return next(taps * np.sqrt(gain) for taps, gain in filters if gain >= _ORDER_GAIN * full_gain)

    @property
    def changing_response_rms(self) -> float:
        """RMS of the parts of `structured` that change the response; drift and lines have no relation to the input."""
        unrelated = (DRIFT, LINE)
        return float(np.sqrt(sum(rms**2 for text, rms in self.structured if not text.startswith(unrelated))))

    @property
    def certain_structure_rms(self) -> float:
        """`structured_rms`; 0 if its only part is a drift that noise of low frequency may cause (99 %)."""
        wandering = self.rms * np.sqrt(_NORMAL_99 * np.sqrt(2 / self.degrees_of_freedom))
        is_drift = all(text.startswith(DRIFT) and rms <= wandering for text, rms in self.structured)
        return 0.0 if is_drift else self.structured_rms

    def largest_ratio(self, samples: int) -> float:
        """Return the largest ratio (99.9 %) of the RMS of `samples` other samples of this noise to `rms`."""
        share = self.degrees_of_freedom / (self.periods * round(self.period / self.sampling_time))
        return float(np.sqrt(1 + _NORMAL_999 * np.sqrt(2 / (share * samples) + 2 / self.degrees_of_freedom)))

    @classmethod
    def together(cls, floors: Sequence[Self]) -> Self:
        """Return the joint floor of several channels of one record."""
        variances = [floor.rms**2 for floor in floors]
        mean = float(np.mean(variances))
        pairs = zip(variances, floors, strict=True)
        degrees = sum(variances) ** 2 / sum(size**2 / floor.degrees_of_freedom for size, floor in pairs)
        parts = sorted((part for floor in floors for part in floor.structured), key=lambda part: -part[1])
        return replace(
            floors[0],
            **_rms_interval(mean, degrees),
            structured=tuple(parts),
            structured_rms=float(np.sqrt(np.mean([floor.structured_rms**2 for floor in floors]))),
            spectrum=(floors[0].spectrum[0], np.mean([floor.spectrum[1] for floor in floors], axis=0)),
            degrees_of_freedom=float(degrees),
            exact=all(floor.exact for floor in floors),
        )

    def density(self, frequency: np.ndarray) -> np.ndarray:
        """Return the noise level in unit²/Hz at any frequencies (Hz): the spectrum smoothed over bands."""
        lines, density = self.spectrum
        level = smooth_power(density, max(self.periods - 1, 1))
        return np.interp(frequency, lines[1:], level[1:])


@dataclass(frozen=True, eq=False)
class Bursts:
    """Drops, slips and tears: lasting deviations at the same places of every period, which are not noise."""

    variance: float
    """Variance of the noise without the bursts, per sample."""
    quiet: np.ndarray
    """True at phases without bursts, shape (samples,)."""
    rms: float
    """RMS of the bursts over the whole period, without the noise."""


def noise_floor(record: Record, period: float | None = None, fewest: int = MIN_PERIODS) -> NoiseFloor | None:
    """Return the noise floor of a periodic record; None if an input does not repeat, or two periods differ by more than noise.

    `period` is in seconds; default the declared period, else a period that fits at least `fewest` times into the record.

    Raises
    ------
    InputError
        If the record is too short for a given period, or its input does not repeat with it.
    """
    period = period or record.period or find_period(record) or find_period(record, fewest)
    if period is None:
        return None
    folding = fold_periods(record, period)
    others = record.channels.keys() - {"output", "input"}
    if any(folding.difference(record[other]) > MAX_DIFFERENCE for other in others):
        return None
    folded, inputs = folding.fold(record["output"]), folding.fold(record["input"])
    mean_period = folded.mean(axis=0)
    deviations = _subtract_input_deviations(folded - mean_period, inputs)
    if np.abs(deviations).max() <= 1e-12 * np.abs(folded).max():
        deviations = np.zeros_like(deviations)
    halves = len(record) < (MIN_PERIODS + 1 - _MISSING_END) * folding.samples
    if halves:
        # The transient at the start of the first period is over in its second half; all that differs there counts as noise.
        degrees, parts, noise = folding.samples // 2, [], deviations.copy()
        noise[:, :-degrees] = 0.0
        # Two periods cannot separate a drift or a long transient from noise: the means of intervals must vary as in white noise.
        intervals = noise[0, folding.samples - degrees :]
        width = max(degrees // _INTERVALS, 1)
        means = intervals[: degrees // width * width].reshape(-1, width).mean(axis=1)
        spread = np.sum(means**2) * width / max(np.mean(intervals**2), 1e-300)
        if scipy.special.chdtrc(len(means), spread) <= _WHITE_LEVEL:
            return None
    else:
        noise, parts, degrees = _split_deviations(deviations, mean_period, inputs.mean(axis=0))
    exact = not np.any(noise)
    variance = _resolution(mean_period) ** 2 if exact else float(np.sum(noise**2)) / degrees
    noise, parts, degrees, bursts = _separate_bursts(noise, parts, degrees)
    if bursts is not None:
        noise, degrees, variance = noise * bursts.quiet, degrees * bursts.quiet.mean(), bursts.variance
    power = line_power(noise, degrees / folding.samples)
    if exact:
        power = np.full_like(power, variance)
    elif bursts is not None:
        power *= variance / power.mean()
    level, effective = smooth_power(power, degrees / folding.samples)[1:], degrees
    if level.size and power.max() > 0:
        # Degrees of freedom of the variance of coloured noise, relative to white: (ΣS)²/(n ΣS²).
        effective = degrees * float(level.sum() ** 2 / (level.size * np.sum(level**2)))
    density = 2 * power * record.sampling_time
    density[[0, -1] if folding.samples % 2 == 0 else 0] /= 2
    values = sum((part.values for part in parts), np.zeros_like(noise))
    structure = StructuredPart("all parts", values, sum(part.degrees for part in parts))
    return NoiseFloor(
        **_rms_interval(variance, effective),
        structured=_describe_structure(parts, bursts, variance, mean_period, record),
        structured_rms=float(np.hypot(structure.rms(variance), bursts.rms if bursts else 0.0)),
        spectrum=(np.fft.rfftfreq(folding.samples, record.sampling_time), density),
        degrees_of_freedom=float(effective),
        period=float(period),
        sampling_time=record.sampling_time,
        periods=len(folded),
        halves=halves,
        exact=exact,
    )


def _split_deviations(
    deviations: np.ndarray, mean_period: np.ndarray, mean_excitation: np.ndarray
) -> tuple[np.ndarray, list[StructuredPart], float]:
    """Return noise, structured parts and degrees of freedom of the noise; several short periods count as one long period."""
    periods, samples = deviations.shape
    joined = int(np.ceil(np.sqrt(_MIN_SAMPLES_TO_PERIODS * periods / samples)))
    joined = max(min(joined, periods // _MIN_LONG_PERIODS), 1)
    rows = deviations[: periods // joined * joined].reshape(-1, joined * samples)
    signals = (np.tile(signal, joined) for signal in (mean_period, mean_excitation))
    split = remove_structure(rows - rows.mean(axis=0) if joined > 1 else rows, *signals)
    for part in split.parts:
        part.values = part.values.reshape(-1, samples)
    return split.rest.reshape(-1, samples), split.parts, split.degrees


def _rms_interval(variance: float, degrees: float) -> dict[str, float]:
    """Return RMS and 95 % interval of noise (χ² by Wilson and Hilferty, Proc. Natl. Acad. Sci. 17 (1931) 684-688)."""
    spread = 2 / (9 * degrees)
    low, high = (variance / (1 - spread + sign * _NORMAL_975 * np.sqrt(spread)) ** 3 for sign in (1, -1))
    return {"rms": float(np.sqrt(variance)), "low": float(np.sqrt(low)), "high": float(np.sqrt(high))}


def _subtract_input_deviations(deviations: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Subtract the part of the output's deviations that a few filters of the input's deviations explain."""
    cause = inputs - inputs.mean(axis=0)
    if np.std(cause) <= _EXACT_INPUT * np.std(inputs):
        return deviations
    # The deviations, their rate of change, and both through first-order low-passes of these time constants in samples.
    size = inputs.shape[1]
    spectrum, frequency = np.fft.rfft(cause, axis=1), 2 * np.pi * np.fft.rfftfreq(size)
    columns = [np.gradient(cause, axis=1), cause]
    for samples in (1, 4, 16, 64):
        if samples < size / 4:
            columns.append(np.fft.irfft(spectrum / (1 + 1j * frequency * samples), size, axis=1))
    regressors = np.column_stack([column.ravel() for column in columns])
    regressors /= np.maximum(regressors.std(axis=0), 1e-300)
    fitted = regressors @ np.linalg.lstsq(regressors, deviations.ravel(), rcond=1e-8)[0]
    rest = deviations - fitted.reshape(deviations.shape)
    variance = np.sum(rest**2) / max(deviations.size - size - regressors.shape[1], 1)
    is_chance = variance > 0 and excess(np.sum(fitted**2) / variance, regressors.shape[1]) < 3
    return deviations if is_chance else rest


def _resolution(mean_period: np.ndarray) -> float:
    """Return the RMS of rounding to the smallest step between values (B. Widrow, AIEE Trans. 79, 1961: step/√12)."""
    steps = np.diff(np.unique(mean_period))
    step = float(steps.min()) / np.sqrt(12) if steps.size else 0.0
    return max(step, _DIGITS * float(np.abs(mean_period).max()))


def _describe_structure(
    parts: list[StructuredPart],
    bursts: Bursts | None,
    variance: float,
    mean_period: np.ndarray,
    record: Record,
) -> tuple[tuple[str, float], ...]:
    """Return description and RMS of every part, the largest first; the first used period is called period 2."""
    unit = record.channels["output"].unit
    described = []
    for part in parts:
        last = len(part.values) + 1
        if part.kind == DRIFT:
            level = part.values.mean(axis=1)
            text = f"drift: the level changes by {level[-1] - level[0]:+.3g} {unit} from period 2 to period {last}"
        elif part.kind == AMPLITUDE:
            response = mean_period - mean_period.mean()
            gain = part.values @ response / np.sum(response**2)
            text = f"amplitude change: {percent(gain[-1] - gain[0])} from period 2 to period {last}"
        elif part.kind == LINE:
            harmonics = f" with harmonics up to the {part.harmonics}th" if part.harmonics > 1 else ""
            frequency = part.frequency / record.sampling_time
            text = f"off-grid line at {frequency:.4g} Hz{harmonics}, amplitude {part.amplitude:.3g} {unit}"
        else:
            energy = np.sum(part.values**2, axis=1)
            is_single = energy.max() > 0.7 * energy.sum()
            single = f"other change: period {int(energy.argmax()) + 2} differs from the others"
            text = single if is_single else "other change over the periods"
        described.append((text, part.rms(variance)))
    if bursts is not None:
        share = percent(1 - bursts.quiet.mean())
        text = f"bursts: {share} of the period, always the same places, in which the force drops or slips by other amounts"
        described.append((text, bursts.rms))
    return tuple(sorted(described, key=lambda item: -item[1]))


def autocovariance(values: np.ndarray, lags: int) -> np.ndarray:
    """Return Σ x[n] x[n+l] over a signal for l = 0, 1, …, `lags`, shape (lags + 1,)."""
    length = 1 << (2 * len(values)).bit_length()
    return np.fft.irfft(np.abs(np.fft.rfft(values, length)) ** 2, length)[: lags + 1]


def prediction_error_filter(covariance: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the Yule–Walker prediction error filter 1, −a₁, …, −aₙ, and the ratio of the variances of signal and error.

    `covariance` is the autocovariance of the signal at lags 0 to n samples, shape (n + 1,).
    """
    order = len(covariance) - 1
    if order < 1 or covariance[0] <= 0:
        return np.ones(1), 1.0
    lags = np.abs(np.subtract.outer(np.arange(order), np.arange(order)))
    coefficients = np.linalg.lstsq(covariance[lags], covariance[1:], rcond=1e-12)[0]
    error = covariance[0] - coefficients @ covariance[1:]
    return np.concatenate([[1.0], -coefficients]), float(covariance[0] / max(error, 1e-12 * covariance[0]))


def _separate_bursts(
    noise: np.ndarray, parts: list[StructuredPart], degrees: float
) -> tuple[np.ndarray, list[StructuredPart], float, Bursts | None]:
    """Search bursts in noise and unnamed changes; return no bursts if the unnamed changes explain most of them."""
    unnamed = [part for part in parts if part.kind == OTHER]
    changing = sum((part.values for part in unnamed), np.zeros_like(noise))
    rows = len(noise) - 1
    all_degrees = degrees * rows / max(rows - len(unnamed), 1)
    bursts = find_bursts(noise + changing, all_degrees)
    if bursts is None or np.mean(changing**2) > _MAX_UNNAMED_SHARE * bursts.rms**2:
        return noise, parts, degrees, None
    return noise + changing, [part for part in parts if part.kind != OTHER], all_degrees, bursts


def find_bursts(noise: np.ndarray, degrees: float) -> Bursts | None:
    """Find deviations that the motion causes, and separate them from noise; None if noise explains them.

    Noise has the same size at all phases of a period. If a tissue breaks slightly differently in every period, but at the same
    phases, the sizes of deviations of two periods are correlated. Their ranks are compared, because spikes and heavy tails occur
    anywhere. `noise` has the deviations of periods from their mean, shape (periods, samples), with `degrees` of freedom.
    """
    if len(noise) < _MIN_BURST_PERIODS or not np.any(noise) or relation_of_sizes(noise) <= _MIN_BURST_SIGMAS:
        return None
    per_row = degrees / noise.size
    halves = noise[::2], noise[1::2]
    quietest = [_local_variance(rows) <= np.quantile(_local_variance(rows), _QUIET_SHARE) for rows in halves]
    # Phases are chosen in some periods and measured in the others: the smallest of many spreads is biased.
    measured = [other[:, phases] for other, phases in zip(halves[::-1], quietest, strict=True)]
    size = per_row * sum(item.size for item in measured)
    variance = float(sum(np.sum(item**2) for item in measured) / size)
    if variance <= 0:
        return None
    local = _local_variance(noise)
    quiet, quietest = local <= _LOUD_RATIO * variance * per_row, local <= np.quantile(local, _QUIET_SHARE)
    # Large deviations must last longer than the noise is correlated.
    noise_correlation = _neighbour_correlation(noise, quietest[1:] & quietest[:-1])
    loud_correlation = _neighbour_correlation(noise, ~quiet[1:] & ~quiet[:-1])
    if loud_correlation <= noise_correlation + _MIN_CORRELATION_EXCESS * (1 - noise_correlation):
        return None
    excess = float(np.mean(noise**2)) / per_row - variance
    return Bursts(variance, quiet, float(np.sqrt(excess))) if excess > 0 else None


def relation_of_sizes(noise: np.ndarray) -> float:
    """Return the rank correlation of deviations' sizes at the same phase of different periods, in standard errors.

    It is Spearman's correlation over all pairs of differences between two periods; `noise` has the shape (periods, samples). The
    standard error allows for correlation of neighbours (M. S. Bartlett, J. R. Stat. Soc. Suppl. 8 (1946) 27-41).
    """
    count, samples = len(noise) // 2, noise.shape[1]
    ranks = np.empty((count, samples))
    for row, sizes in enumerate(np.abs(noise[: 2 * count : 2] - noise[1 : 2 * count : 2])):
        _, place, counts = np.unique(sizes, return_inverse=True, return_counts=True)
        ranks[row] = (np.cumsum(counts) - (counts - 1) / 2)[place]  # equal values share a rank
    ranks -= (samples + 1) / 2
    deviation = np.sqrt(np.mean(ranks**2, axis=1, keepdims=True))
    if not np.all(deviation > 0):
        return 0.0
    ranks /= deviation
    pairs = count * (count - 1) / 2
    correlation = (np.sum(ranks.sum(axis=0) ** 2) - np.sum(ranks**2)) / 2 / (pairs * samples)
    power = np.sum(np.abs(np.fft.rfft(ranks, axis=1)) ** 2, axis=0) / count
    lagged = np.fft.irfft(power, samples)[: samples // 8] / samples
    return float(correlation * np.sqrt(pairs * samples / (1 + 2 * np.sum(lagged[1:] ** 2))))


def _local_variance(rows: np.ndarray) -> np.ndarray:
    """Return the mean square over the periods, averaged over neighbouring phases; shape (samples,)."""
    around = np.pad(np.mean(rows**2, axis=0), _AVERAGED_PHASES // 2, mode="wrap")
    return np.convolve(around, np.full(_AVERAGED_PHASES, 1 / _AVERAGED_PHASES), mode="valid")


def _neighbour_correlation(noise: np.ndarray, chosen: np.ndarray) -> float:
    """Return the correlation of neighbouring samples at chosen phases."""
    first, second = noise[:, :-1][:, chosen], noise[:, 1:][:, chosen]
    energy = np.sum(first**2) + np.sum(second**2)
    return float(2 * np.sum(first * second) / energy) if energy > 0 else 0.0
