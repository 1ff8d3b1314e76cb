"""The noise floor of a periodic record: what no model of its input can explain.

Of P periods the first is the transient; the spread of the others about their mean is noise, provided that
nothing else keeps them from repeating. Drift, softening or a disturbance at a frequency of its own raise that
spread many times; they are found and taken out first (`lumbar.tissue.diagnosis.noise.nonrepeating`) and reported.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import scipy

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.noise.nonrepeating import (
    AMPLITUDE,
    DRIFT,
    LINE,
    OTHER,
    Part,
    excess,
    line_power,
    remove_structure,
    smooth_power,
)
from lumbar.tissue.diagnosis.noise.periods import MIN_PERIODS, Folding, find_period, fold_periods, repeats

_CERTAIN = 6.0
"""Standard errors by which sizes must be related beyond what noise of any colour and distribution gives."""
_LASTING = 0.25
"""Share of what neighbouring samples lack of a correlation of 1 where deviations are smallest that they lack less where they are
large. A sensor's noise that grows with the force, and a clock that trembles, make samples that differ but do not last."""
_STRETCHES = 10
"""Number of intervals of the second halves of two periods, between whose means white noise differs only by chance."""
_BY_CHANCE = 0.001
_SHORT = 0.02
"""Share of a period that may lack at the end of a record."""
_FEWEST = 4
"""Periods whose differences, two by two, are independent of each other at the same phase."""
_QUIET = 0.25
"""Share of the phases that the noise is measured in: those where other periods spread least."""
_NEIGHBOURS = 5
"""Phases over which a spread is averaged."""
_LOUD = 2.5
"""Ratio of the variance to that of the noise above which a phase is not quiet."""
__all__ = ["NoiseFloor", "find_period", "noise_floor"]
WHITENING_ORDER = 12
"""Highest order of the autoregressive model of the noise."""
_NEARLY = 0.998
"""Share of the highest order's prediction gain that a lower order must reach."""
_INPUT_REPEATS_EXACTLY = 1e-4
_DIGITS = 1e-9
"""Share of the response below which a record's digits are rounding."""
_MOST = 0.5
"""Share of the variance of bursts above which a few unnamed changes explain it, so that there are no bursts."""
_NORMAL_975 = 1.959964
_NORMAL_99 = 2.326348
_NORMAL_999 = 3.090232


@dataclass(frozen=True, eq=False)
class NoiseFloor:
    """Noise of an output: what does not repeat with a periodic input and has no structure."""

    rms: float
    low: float
    high: float
    """`rms`, `low`, `high`: noise per sample and its 95 % interval (χ²), in the output's unit."""
    structured: tuple[tuple[str, float], ...]
    """Description and RMS of every part that does not repeat and is not noise, the largest first. The
    descriptions begin with ``drift``, ``amplitude change``, ``off-grid line``, ``other change`` or ``bursts``."""
    structured_rms: float
    """RMS of all of them together; 0 if none is significant."""
    spectrum: tuple[np.ndarray, np.ndarray]
    """Frequency (Hz) and one-sided power spectral density (unit²/Hz) of the noise at the multiples of 1/period."""
    degrees_of_freedom: float
    """Degrees of freedom of `rms`, with the noise's colour taken into account."""
    period: float
    sampling_time: float
    """`period`, `sampling_time`: seconds."""
    periods: int
    """Periods used, the transient left out."""
    halves: bool = False
    """Whether a record has only two periods, of which the second halves count."""
    exact: bool = False
    """Whether the periods are equal to the last digit: `rms` is then the resolution of the digits."""

    @cached_property
    def whitening(self) -> np.ndarray:
        """FIR filter that makes the noise white and keeps its variance; ``[1]`` if it is white already.

        Autoregressive, by the Yule–Walker equations, of the lowest order that predicts the noise nearly as well as
        order `WHITENING_ORDER`. It is used where it predicts the noise better than it would white noise by chance.
        """
        density = self.spectrum[1].copy()
        density[0] *= 2  # one-sided: the lines at 0 and, of an even number, at the end count once
        if round(self.period / self.sampling_time) % 2 == 0:
            density[-1] *= 2
        covariance = np.fft.irfft(density, round(self.period / self.sampling_time))
        order = min(WHITENING_ORDER, len(covariance) // 4)
        full_gain = prediction_error_filter(covariance[: order + 1])[1]
        # Degrees of freedom that white noise would have: those of coloured noise are fewer just because it is coloured.
        white = (self.periods - 1) * round(self.period / self.sampling_time)
        if full_gain <= 1 + (order + 4 * np.sqrt(2 * order)) / white:
            return np.ones(1)
        filters = (prediction_error_filter(covariance[: lower + 1]) for lower in range(1, order + 1))
        return next(taps * np.sqrt(gain) for taps, gain in filters if gain >= _NEARLY * full_gain)

    @property
    def certain_structure_rms(self) -> float:
        """`structured_rms` without a drift that wandering noise may be taken for (99 %)."""
        wandering = self.rms * np.sqrt(_NORMAL_99 * np.sqrt(2 / self.degrees_of_freedom))
        if all(words.startswith(DRIFT) and rms <= wandering for words, rms in self.structured):
            return 0.0
        return self.structured_rms

    def largest_ratio(self, samples: int) -> float:
        """Largest ratio to `rms` (99.9 %) of the RMS of so many samples of the same noise: coloured noise scatters."""
        share = self.degrees_of_freedom / (self.periods * round(self.period / self.sampling_time))
        return float(np.sqrt(1 + _NORMAL_999 * np.sqrt(2 / (share * samples) + 2 / self.degrees_of_freedom)))

    @classmethod
    def together(cls, floors: Sequence[Self]) -> Self:
        """The floor of several channels of one record taken together."""
        variances = [floor.rms**2 for floor in floors]
        mean = float(np.mean(variances))
        degrees = sum(variances) ** 2 / sum(
            square**2 / floor.degrees_of_freedom for square, floor in zip(variances, floors, strict=True)
        )
        parts = sorted((part for floor in floors for part in floor.structured), key=lambda part: -part[1])
        return replace(
            floors[0],
            **_with_ends(mean, degrees),
            structured=tuple(parts),
            structured_rms=float(np.sqrt(np.mean([floor.structured_rms**2 for floor in floors]))),
            spectrum=(floors[0].spectrum[0], np.mean([floor.spectrum[1] for floor in floors], axis=0)),
            degrees_of_freedom=float(degrees),
            exact=all(floor.exact for floor in floors),
        )

    def density(self, frequency: np.ndarray) -> np.ndarray:
        """Noise level at any frequencies (Hz): the spectrum smoothed over bands, for whitening; unit²/Hz."""
        lines, density = self.spectrum
        level = smooth_power(density, max(self.periods - 1, 1))
        return np.interp(frequency, lines[1:], level[1:])


def noise_floor(record: Record, period: float | None = None, fewest: int = MIN_PERIODS) -> NoiseFloor | None:
    """Return the noise floor of a periodic record, or None where its input, or another input beside it, does not repeat.

    The period, in seconds, is by default the record's own, else one of which the record holds at least `fewest`.

    Raises
    ------
    InputError
        If a period is given that the record is too short for, or with which its input does not repeat.
    """
    period = period or record.period or find_period(record) or find_period(record, fewest)
    if period is None:
        return None
    folding = fold_periods(record, period)
    beside = record.channels.keys() - {"output", "input"}
    if not all(repeats(record, folding, other) for other in beside):
        return None  # what was measured beside the input moves the output too, and does not repeat
    folded = folding.fold(record["output"])
    mean_period = folded.mean(axis=0)
    deviations = _without_input_deviations(folded - mean_period, record["input"], folding)
    scale = np.abs(folded).max()
    if np.abs(deviations).max() <= 1e-12 * scale:
        deviations = np.zeros_like(deviations)
    halves = len(record) < (MIN_PERIODS + 1 - _SHORT) * folding.samples
    if halves:
        # The transient at the start of the first period is over; all that differs then counts as noise.
        degrees, parts, noise = folding.samples // 2, [], deviations.copy()
        noise[:, :-degrees] = 0.0
        if not _is_white(noise[0, folding.samples - degrees :]):
            return None  # a transient that lasts, a drift: two periods do not tell it from noise
    else:
        split = remove_structure(deviations, mean_period, folding.fold(record["input"]).mean(axis=0))
        noise, parts, degrees = split.rest, split.parts, split.degrees
    exact = not np.any(noise)
    variance = _resolution(mean_period) ** 2 if exact else float(np.sum(noise**2)) / degrees
    noise, parts, degrees, bursts = _bursts_beside(noise, parts, degrees)
    if bursts is not None:
        noise, degrees, variance = noise * bursts.quiet, degrees * bursts.quiet.mean(), bursts.variance
    power = line_power(noise, degrees / folding.samples)
    if bursts is not None:
        power *= variance / power.mean()
    if exact:
        power = np.full_like(power, variance)
    level, effective = smooth_power(power, degrees / folding.samples)[1:], degrees
    if level.size and power.max() > 0:
        # Degrees of freedom of the variance of coloured noise, relative to white: (ΣS)²/(n ΣS²).
        effective = degrees * float(level.sum() ** 2 / (level.size * np.sum(level**2)))
    density = 2 * power * record.sampling_time
    density[0] /= 2
    if folding.samples % 2 == 0:
        density[-1] /= 2
    values = sum((part.values for part in parts), np.zeros_like(noise))
    together = Part("all parts", values, sum(part.degrees for part in parts))
    return NoiseFloor(
        **_with_ends(variance, effective),
        structured=_descriptions(parts, bursts, variance, mean_period, record),
        structured_rms=float(np.hypot(together.rms(variance), bursts.rms if bursts else 0.0)),
        spectrum=(np.fft.rfftfreq(folding.samples, record.sampling_time), density),
        degrees_of_freedom=float(effective),
        period=float(period),
        sampling_time=record.sampling_time,
        periods=len(folded),
        halves=halves,
        exact=exact,
    )


def _with_ends(variance: float, degrees: float) -> dict[str, float]:
    """RMS of noise and its 95 % interval (χ² by Wilson and Hilferty, Proc. Natl. Acad. Sci. 17 (1931) 684-688)."""
    spread = 2 / (9 * degrees)
    low, high = (variance / (1 - spread + sign * _NORMAL_975 * np.sqrt(spread)) ** 3 for sign in (1, -1))
    return {"rms": float(np.sqrt(variance)), "low": float(np.sqrt(low)), "high": float(np.sqrt(high))}


def _is_white(values: np.ndarray) -> bool:
    """Return whether the means of intervals differ by no more than those of white noise."""
    width = max(len(values) // _STRETCHES, 1)
    means = values[: len(values) // width * width].reshape(-1, width).mean(axis=1)
    return (
        scipy.special.chdtrc(len(means), np.sum(means**2) * width / max(np.mean(values**2), 1e-300))
        > _BY_CHANCE
    )


def _without_input_deviations(deviations: np.ndarray, excitation: np.ndarray, folding: Folding) -> np.ndarray:
    """Subtract from the output what deviations of its input cause, by a few filters fitted to them."""
    folded = folding.fold(excitation)
    cause = folded - folded.mean(axis=0)
    if np.std(cause) <= _INPUT_REPEATS_EXACTLY * np.std(folded):
        return deviations
    columns = [_low_pass(cause, samples) for samples in (0, 1, 4, 16, 64) if samples < folding.samples / 4]
    regressors = np.column_stack([column.ravel() for column in (np.gradient(cause, axis=1), *columns)])
    regressors /= np.maximum(regressors.std(axis=0), 1e-300)
    fitted = regressors @ np.linalg.lstsq(regressors, deviations.ravel(), rcond=1e-8)[0]
    fitted = fitted.reshape(deviations.shape)
    rest = deviations - fitted
    variance = np.sum(rest**2) / max(deviations.size - folding.samples - regressors.shape[1], 1)
    if variance > 0 and excess(np.sum(fitted**2) / variance, regressors.shape[1]) < 3:
        return deviations
    return rest


def _low_pass(rows: np.ndarray, samples: int) -> np.ndarray:
    """Rows through a first-order low-pass of this time constant, circularly; unchanged for 0."""
    if samples == 0:
        return rows
    frequency = 2 * np.pi * np.fft.rfftfreq(rows.shape[1])
    return np.fft.irfft(np.fft.rfft(rows, axis=1) / (1 + 1j * frequency * samples), rows.shape[1], axis=1)


def _bursts_beside(
    noise: np.ndarray, parts: list[Part], degrees: float
) -> "tuple[np.ndarray, list[Part], float, Bursts | None]":
    """Look for bursts in the noise and the changes without a name: what these explain of bursts is theirs by chance."""
    changes = [part for part in parts if part.kind == OTHER]
    changing = sum((part.values for part in changes), np.zeros_like(noise))
    rows = len(noise) - 1
    together = degrees * rows / max(rows - len(changes), 1)
    bursts = find_bursts(noise + changing, together)
    if bursts is None or np.mean(changing**2) > _MOST * bursts.rms**2:
        return noise, parts, degrees, None
    return noise + changing, [part for part in parts if part.kind != OTHER], together, bursts


def _resolution(mean_period: np.ndarray) -> float:
    """RMS of rounding to the smallest step between values (B. Widrow, AIEE Trans. 79, 1961: step/√12)."""
    steps = np.diff(np.unique(mean_period))
    step = float(steps.min()) / np.sqrt(12) if steps.size else 0.0
    return max(step, _DIGITS * float(np.abs(mean_period).max()))


def _descriptions(
    parts: list[Part], bursts: "Bursts | None", variance: float, mean_period: np.ndarray, record: Record
) -> tuple[tuple[str, float], ...]:
    unit, step = record.channels["output"].unit, record.sampling_time
    described = [(_words(part, mean_period, unit, step), part.rms(variance)) for part in parts]
    if bursts is not None:
        share = 100 * (1 - bursts.quiet.mean())
        words = f"bursts: {share:.2g} % of the period, always the same places, in which the force drops or slips by other amounts"
        described.append((words, bursts.rms))
    return tuple(sorted(described, key=lambda item: -item[1]))


def _words(part: Part, mean_period: np.ndarray, unit: str, sampling_time: float) -> str:
    """Say what a part is, with its size; periods are counted from the record's last, as from 2."""
    last = len(part.values) + 1
    if part.kind == DRIFT:
        level = part.values.mean(axis=1)
        return (
            f"drift: the level changes by {level[-1] - level[0]:+.3g} {unit} from period 2 to period {last}"
        )
    if part.kind == AMPLITUDE:
        response = mean_period - mean_period.mean()
        gain = 100 * (part.values @ response) / np.sum(response**2)
        return f"amplitude change: {gain[-1] - gain[0]:+.3g} % from period 2 to period {last}"
    if part.kind == LINE:
        harmonics = f" with harmonics up to the {part.harmonics}th" if part.harmonics > 1 else ""
        frequency = part.frequency / sampling_time
        return f"off-grid line at {frequency:.4g} Hz{harmonics}, amplitude {part.amplitude:.3g} {unit}"
    energy = np.sum(part.values**2, axis=1)
    odd_one = int(energy.argmax())
    if energy[odd_one] > 0.7 * energy.sum():
        return f"other change: period {odd_one + 2} differs from the others"
    return "other change over the periods"


def autocovariance(values: np.ndarray, lags: int) -> np.ndarray:
    """Σ x[n] x[n+l] over a signal for l = 0, 1, …, `lags`, shape (lags + 1,)."""
    length = 1 << (2 * len(values)).bit_length()
    return np.fft.irfft(np.abs(np.fft.rfft(values, length)) ** 2, length)[: lags + 1]


def prediction_error_filter(covariance: np.ndarray) -> tuple[np.ndarray, float]:
    """Yule–Walker: coefficients 1, −a₁, …, −aₙ of the prediction error, and variance over that of the error.

    `covariance` is that of a signal at lags 0 to n samples, shape (n + 1,).
    """
    order = len(covariance) - 1
    if order < 1 or covariance[0] <= 0:
        return np.ones(1), 1.0
    lags = np.abs(np.subtract.outer(np.arange(order), np.arange(order)))
    coefficients = np.linalg.lstsq(covariance[lags], covariance[1:], rcond=1e-12)[0]
    error = covariance[0] - coefficients @ covariance[1:]
    return np.concatenate([[1.0], -coefficients]), float(covariance[0] / max(error, 1e-12 * covariance[0]))


@dataclass(frozen=True, eq=False)
class Bursts:
    """Drops, slips and tears: deviations at the same places of every period that last, and are not noise."""

    variance: float
    """Variance of the noise without them, per sample."""
    quiet: np.ndarray
    """Shape (samples,): phases without them."""
    rms: float
    """RMS of the bursts over the whole period, less the noise."""


def find_bursts(noise: np.ndarray, degrees: float) -> Bursts | None:
    """Find deviations that the motion causes, and separate them from noise; None if there are none.

    Noise is as large at one phase of a period as at another. A tissue that breaks a little differently every time adds
    deviations that repeat in no form, but come where the motion brings them about. They are recognised by the places: the
    sizes of the deviations of two periods, phase by phase, are then correlated. Ranks are compared, so
    that spikes and heavy tails, which occur anywhere, do not matter.

    `noise` holds the deviations of the periods from their mean, shape (periods, samples); `degrees` of freedom are left
    in them.
    """
    if len(noise) < _FEWEST or not np.any(noise) or relation_of_sizes(noise) <= _CERTAIN:
        return None
    per_row = degrees / noise.size
    halves = noise[::2], noise[1::2]
    quietest = [_local_variance(rows) <= np.quantile(_local_variance(rows), _QUIET) for rows in halves]
    # Phases are chosen in some periods and measured in the others: the least of many spreads is no noise level.
    measured = [other[:, phases] for other, phases in zip(halves[::-1], quietest, strict=True)]
    variance = float(
        sum(np.sum(item**2) for item in measured) / (per_row * sum(item.size for item in measured))
    )
    if variance <= 0:
        return None
    local = _local_variance(noise)
    quiet, quietest = local <= _LOUD * variance * per_row, local <= np.quantile(local, _QUIET)
    # Large deviations must last longer than the noise remembers.
    of_noise = _neighbours(noise, quietest[1:] & quietest[:-1])
    if _neighbours(noise, ~quiet[1:] & ~quiet[:-1]) <= of_noise + _LASTING * (1 - of_noise):
        return None
    excess = float(np.mean(noise**2)) / per_row - variance
    return Bursts(variance, quiet, float(np.sqrt(excess))) if excess > 0 else None


def relation_of_sizes(noise: np.ndarray) -> float:
    """Standard errors by which the sizes of deviations at the same phase of different periods are related.

    Spearman's rank correlation of the sizes of differences between two periods each, over all pairs of such differences.
    Its standard error allows for sizes that resemble their neighbours (M. S. Bartlett, J. R. Stat. Soc. Suppl. 8 (1946) 27-41).

    `noise` has shape (periods, samples), four periods at least.
    """
    count, samples = len(noise) // 2, noise.shape[1]
    sizes = np.abs(noise[: 2 * count : 2] - noise[1 : 2 * count : 2])
    ranks = np.stack([_ranks(row) for row in sizes]) - (samples + 1) / 2
    deviation = np.sqrt(np.mean(ranks**2, axis=1, keepdims=True))
    if not np.all(deviation > 0):
        return 0.0
    ranks /= deviation
    pairs = count * (count - 1) / 2
    together = (np.sum(ranks.sum(axis=0) ** 2) - np.sum(ranks**2)) / 2 / (pairs * samples)
    power = np.sum(np.abs(np.fft.rfft(ranks, axis=1)) ** 2, axis=0) / count
    own = np.fft.irfft(power, samples)[: samples // 8] / samples
    return float(together * np.sqrt(pairs * samples / (1 + 2 * np.sum(own[1:] ** 2))))


def _ranks(values: np.ndarray) -> np.ndarray:
    """Return ranks, from 1; equal values share theirs."""
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - (counts - 1) / 2)[place]


def _local_variance(rows: np.ndarray) -> np.ndarray:
    """Mean square over the periods, averaged over neighbouring phases; shape (samples,)."""
    reach = _NEIGHBOURS // 2
    around = np.pad(np.mean(rows**2, axis=0), reach, mode="wrap")
    return np.convolve(around, np.full(_NEIGHBOURS, 1 / _NEIGHBOURS), mode="valid")


def _neighbours(noise: np.ndarray, where: np.ndarray) -> float:
    """Correlation of neighbouring samples."""
    first, second = noise[:, :-1][:, where], noise[:, 1:][:, where]
    energy = np.sum(first**2) + np.sum(second**2)
    return float(2 * np.sum(first * second) / energy) if energy > 0 else 0.0
