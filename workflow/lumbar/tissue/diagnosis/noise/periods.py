"""Period of an excitation, from a comparison of the input with the shifted input, and division of records into periods."""

from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.formats import percent
from lumbar.records.record import Record

REPEATS_WITHIN = 0.02
"""Largest difference between periods of an input that repeats, as a share of its RMS about the mean."""
MAX_DIFFERENCE = 5 * REPEATS_WITHIN
"""Largest difference between periods of given length, because they begin up to half a sample early or late."""
MIN_FULL_PERIODS = 3
"""Smallest number of periods without restriction: the first is the transient, two more show parts that do not repeat."""
MIN_PERIODS = 2
"""Smallest number of periods; of two periods only the second halves count, because the first begins with a transient."""

_MISSING_END = 0.02
"""Largest share of a period by which a record may end early (a sample is often lost at an end)."""
_MAX_MINIMUM_RATIO = 3.0
"""Ratio of mismatches, in power, up to which two lags repeat equally well: the shortest of such lags is the period."""


@dataclass(frozen=True)
class Folding:
    """Samples of the whole periods of a record."""

    period: float
    """Period in seconds."""
    samples: int
    """Number of samples per period."""
    rows: np.ndarray
    """Indices of the samples of every used period, shape (periods, samples), counted from the record's end to leave out the
    transient."""

    def fold(self, values: np.ndarray) -> np.ndarray:
        """Return `values` as one row per period, shape (periods, samples)."""
        return values[self.rows]

    def difference(self, values: np.ndarray) -> float:
        """Return the difference of periods from their mean, relative to the RMS of the values; 0 for a channel at rest."""
        folded = self.fold(values)
        square, variance = np.mean((folded - folded.mean(axis=0)) ** 2), float(np.var(folded))
        return float(np.sqrt(square / variance)) if variance > 0 else 0.0


def mismatch(values: np.ndarray, lags: int) -> np.ndarray:
    """Return the mismatch of a signal with itself shifted by 0, 1, …, `lags` samples, shape (lags + 1,).

    The mismatch is Σ(u[n+l] − u[n])² over the overlap, per sample and relative to twice the variance: 0 if the signal repeats,
    about 1 without any relation. For noise of variance σ² on a periodic signal it is σ²/variance at the period.
    """
    size = len(values)
    centred = values - values.mean()
    length = 1 << (size + lags).bit_length()
    spectrum = np.fft.rfft(centred, length)
    products = np.fft.irfft(np.abs(spectrum) ** 2, length)[: lags + 1]
    energy = np.concatenate([[0.0], np.cumsum(centred**2)])
    lag = np.arange(lags + 1)
    overlapping = energy[size - lag] + energy[size] - energy[lag]
    variance = energy[size] / size
    if variance == 0.0:
        return np.full(lags + 1, np.inf)
    return np.maximum(overlapping - 2.0 * products, 0.0) / (2.0 * variance * (size - lag))


def find_period(record: Record, fewest: int = MIN_FULL_PERIODS) -> float | None:
    """Return the period of the input in seconds, of all axes that move; None if it does not repeat `fewest` times.

    The period is the shortest lag at which the input agrees with itself as well as at any other lag, within `REPEATS_WITHIN`.
    Noise of a measured position is allowed, because it limits the agreement equally at every multiple of the period.
    """
    inputs = [record[f"input_{axis}"] for axis in record.moving] or [record.widest["input"]]
    lags = int(len(record) * (1 + _MISSING_END) / fewest)
    if lags < 3:
        return None
    difference = np.max([mismatch(values, lags + 1) for values in inputs], axis=0)
    inner = difference[1:-1]
    is_minimum = (inner <= difference[:-2]) & (inner <= difference[2:])
    # A smooth signal resembles itself at short lags; its period follows the first lag at which it does not.
    unlike = np.flatnonzero(difference > 0.1)
    if not unlike.size:
        return None
    candidates = np.flatnonzero(is_minimum) + 1
    candidates = candidates[(candidates > unlike[0]) & (difference[candidates] < REPEATS_WITHIN**2)]
    if not candidates.size:
        return None
    rounding = 1e-12  # of values written with six digits, and of the transform
    enough = _MAX_MINIMUM_RATIO * difference[candidates].min() + rounding
    return float(candidates[difference[candidates] <= enough][0] * record.sampling_time)


def declared_period(record: Record, fewest: int) -> float | None:
    """Return the declared period of a record if it fits at least `fewest` times into the record, else None."""
    return record.period if record.period and record.duration >= fewest * record.period else None


def fold_periods(record: Record, period: float) -> Folding:
    """Divide a record into whole periods of `period` seconds without the first, or into `MIN_PERIODS` periods if it has no more.

    Raises
    ------
    InputError
        If the record has fewer than `MIN_PERIODS` periods, or its input does not repeat with `period`.
    """
    name, size = record.source or record.name, len(record)
    length = period / record.sampling_time
    if not length >= 2:
        raise InputError(f"{name}: a period of {period:g} s is less than two samples")
    periods = int(size / length + _MISSING_END)
    if periods < MIN_PERIODS:
        raise InputError(
            f"{name}: {record.duration:g} s are {size / length:.3g} times {period:g} s; at least {MIN_PERIODS} periods are "
            f"needed, better {MIN_FULL_PERIODS}, of which the first is the transient: record for longer, or leave the period out"
        )
    samples = round(length)
    starts = size - np.round(length * np.arange(max(periods - 1, MIN_PERIODS), 0, -1)).astype(int)
    starts = np.clip(starts, 0, size - samples)
    folding = Folding(period, samples, starts[:, None] + np.arange(samples))
    difference = folding.difference(record["input"])
    if difference > MAX_DIFFERENCE:
        raise InputError(
            f"{name}: the input does not repeat after {period:g} s, its periods differ by {percent(difference)} of its RMS: "
            "correct the period, leave it out, or keep only the cycles that repeat (lumbar import --trim START:STOP)"
        )
    return folding
