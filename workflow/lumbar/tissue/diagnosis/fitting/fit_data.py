"""Data of records for fits: motion, force, samples that count, colour of the noise; and lower rates of long records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Self

import numpy as np
import scipy

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.noise.periods import find_period
from lumbar.tissue.models.motion import JoinedMotions, Motion
from lumbar.tissue.models.result_cache import ResultCache
from lumbar.tissue.signals.spectrum import spectral_edge


@dataclass(frozen=True, eq=False)
class FitData:
    """One record prepared for fitting, with a cache of its fits, because a search repeats some of them."""

    name: str
    motion: Motion | JoinedMotions
    force: np.ndarray
    """Measured force, shape (samples,)."""
    whitening: np.ndarray = field(default_factory=lambda: np.ones(1))
    """Coefficients of an FIR filter that makes the noise white; ``[1]`` if it is white."""
    settling: int = 0
    """Number of samples at the start that are excluded from errors, because the initial state is unknown."""
    has_own_zero: bool = False
    """True if the zero of the sensor may differ from that in training: the mean of an error is then ignored."""
    begins: int = 0
    """Index of the record's first sample; samples before it belong to earlier records of the session and only set the state."""
    ignored: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    """Indices of samples with unknown motion, at which every error is 0."""
    cache: ResultCache = field(init=False, repr=False, default_factory=ResultCache)
    """Cache of fits to this record."""

    @property
    def records(self) -> tuple[FitData, ...]:
        """The records that are fitted together: only this record."""
        return (self,)

    @property
    def first(self) -> int:
        """Index of the first sample that counts: the whitening filter must see all its inputs."""
        return self.begins + max(self.settling, len(self.whitening) - 1)

    @property
    def length(self) -> int:
        """Number of samples of the records, without their session history."""
        return sum(len(item.force) - item.begins for item in self.records)

    @property
    def size(self) -> int:
        """Number of samples that count."""
        return len(self.force) - self.first

    def convert(self, kind: type[FitData], **changes) -> FitData:
        """Return the record as an object of another class, with changed or additional fields."""
        values = {item.name: getattr(self, item.name) for item in fields(FitData) if item.init}
        return kind(**{**values, **changes})

    def drop_history(self, signal: np.ndarray) -> np.ndarray:
        """Return a signal (samples first) without the samples of earlier records."""
        return signal[self.begins :]

    def split(self, share: float) -> tuple[FitData, FitData]:
        """Return the first part of the record, and the whole record with only the remaining samples counted."""
        count = round(share * self.length)
        end = self.begins + count
        early = replace(self, motion=self.motion.beginning(end), force=self.force[:end])
        return early, replace(self, settling=count)

    def apply(self, change: Callable[[FitData], FitData]) -> FitData:
        """Return the data with a change of every single record."""
        return change(self)

    def drop_whitening(self) -> FitData:
        """Return the same records without whitening of their errors."""
        return self.apply(lambda one: replace(one, whitening=np.ones(1)))

    def shift_origin(self, position: float) -> FitData:
        """Return the same records with positions counted from `position`."""
        return self.apply(
            lambda one: replace(one, motion=replace(one.motion, position=one.motion.position - position))
        )

    def trim(self, signal: np.ndarray) -> np.ndarray:
        """Return a signal (samples first) from the first sample that counts."""
        return signal[self.first :]

    def whiten(self, signal: np.ndarray) -> np.ndarray:
        """Return the whitened signal (samples first) from the first sample that counts, without the ignored samples."""
        signal = self._drop_ignored(signal)
        if len(self.whitening) > 1:
            from scipy.signal import lfilter

            signal = lfilter(self.whitening, [1.0], signal, axis=0)
        return self.trim(signal)

    def split_records(self, values: np.ndarray) -> list[np.ndarray]:
        """Split values at the samples that count by record."""
        return [values]

    @cached_property
    def zeros(self) -> np.ndarray:
        """Column of a sensor's zero: ones, shape (samples, 1)."""
        return np.ones((len(self.force), 1))

    def error(self, simulated: np.ndarray) -> np.ndarray:
        """Return simulated minus measured force at the samples that count; without its mean if the zero is free."""
        return self._about_zero(self.trim(self._drop_ignored(simulated - self.force)))

    def whitened_error(self, simulated: np.ndarray) -> np.ndarray:
        """Return `error` through the whitening filter."""
        return self._about_zero(self.whiten(simulated - self.force))

    def _drop_ignored(self, signal: np.ndarray) -> np.ndarray:
        """Return a signal (samples first) with zeros at the ignored samples."""
        if not self.ignored.size:
            return signal
        signal = signal.copy()
        signal[self.ignored[self.ignored < len(signal)]] = 0.0
        return signal

    def _about_zero(self, errors: np.ndarray) -> np.ndarray:
        return errors - errors.mean() if self.has_own_zero else errors

    def scale(self, kind: str) -> float:
        """Return the size of a quantity for starting values; ``force`` is the largest force of the record."""
        return float(np.abs(self.force).max()) if kind == "force" else self.motion.scale(kind)


@dataclass(frozen=True, eq=False)
class JointData(FitData):
    """Several records that a model is fitted to together."""

    parts: tuple[FitData, ...] = ()
    """Records with the same sampling time."""

    @classmethod
    def join(cls, parts: list[FitData], has_own_zero: bool = False) -> Self:
        """Return the joint data of records, with a name that lists theirs."""
        begins = np.cumsum([0, *(len(part.force) for part in parts)])
        ignored = [
            item.ignored[item.ignored < len(item.force)] + at for item, at in zip(parts, begins, strict=False)
        ]
        return cls(
            "+".join(part.name for part in parts),
            JoinedMotions(tuple(part.motion for part in parts)),
            np.concatenate([part.force for part in parts]),
            parts[0].whitening,
            parts[0].settling,
            has_own_zero,
            ignored=np.concatenate(ignored),
            parts=tuple(parts),
        )

    def split(self, share: float) -> tuple[FitData, FitData]:
        """Split every record in two."""
        early, later = zip(*(part.split(share) for part in self.parts), strict=True)
        return self._rebuild(list(early)), self._rebuild(list(later))

    def apply(self, change: Callable[[FitData], FitData]) -> FitData:
        """Return the data with a change of every single record."""
        return self._rebuild([part.apply(change) for part in self.parts])

    def _rebuild(self, parts: list[FitData]) -> JointData:
        return type(self).join(parts, self.has_own_zero)

    @cached_property
    def zeros(self) -> np.ndarray:
        """Columns of the sensor's zero, shape (samples, zeros): ones, or ones for each record if every record has a zero."""
        parts = [part.zeros for part in self.parts]
        return scipy.linalg.block_diag(*parts) if self.has_own_zero else np.concatenate(parts)

    @property
    def records(self) -> tuple[FitData, ...]:
        """The records that are fitted together."""
        return self.parts

    @property
    def size(self) -> int:
        """Number of samples that count."""
        return sum(part.size for part in self.parts)

    def split_records(self, values: np.ndarray) -> list[np.ndarray]:
        """Split values at the samples that count by record."""
        return np.split(values, np.cumsum([part.size for part in self.parts])[:-1])

    def trim(self, signal: np.ndarray) -> np.ndarray:
        """Return a signal (samples first) without the samples of each record that do not count."""
        pieces = zip(self.parts, self.motion.split(signal), strict=True)
        return np.concatenate([part.trim(piece) for part, piece in pieces])

    def whiten(self, signal: np.ndarray) -> np.ndarray:
        """Return the whitened signal (samples first) without the samples of each record that do not count."""
        pieces = zip(self.parts, self.motion.split(signal), strict=True)
        return np.concatenate([part.whiten(piece) for part, piece in pieces])


class FreeRun:
    """A model that simulates records from their input only, and its error on them."""

    def simulate(self, motion: Motion | JoinedMotions) -> np.ndarray:
        """Return the free-run simulation of the sensor's reading, shape (samples,)."""
        raise NotImplementedError

    def rms(self, *records: FitData) -> float:
        """Return the root mean square of the simulation error over all samples that count of these records together."""
        return float(np.sqrt(np.mean(np.concatenate([self.errors(item) for item in records]) ** 2)))

    def errors(self, record: FitData) -> np.ndarray:
        """Return the free-run simulation error at the samples that count."""
        return record.error(self.simulate(record.motion))

    def whitened_errors(self, record: FitData) -> np.ndarray:
        """Return `errors` through the record's whitening filter."""
        return record.whitened_error(self.simulate(record.motion))


MAX_SAMPLES = 150_000
"""Largest number of samples, of all records together, that a diagnosis uses without reduction."""
ENOUGH_SAMPLES = 15_000
"""Number of samples, of all records together, that a lower rate must leave if the excitation allows that rate."""
MIN_SAMPLES_PER_CYCLE = 12.0
"""Smallest number of samples per cycle, at the upper end of the excitation's band, that a lower rate must leave."""
_PERIOD_SEARCH = 1_000_000
"""Number of samples at the beginning of a record in which its period is searched."""
_BAND_POWER = 0.999
"""Share of the position's power below the upper end of its band. Speeds are not used, because the steps of a coarse encoder
would then prevent a lower rate."""
_ENOUGH_LINEAR = 6000
"""Number of samples, of all records together, for a fit of linear models, if the band of the position allows that rate."""
_STEP_POWER = 0.9999
"""Share of the power of the position's steps below the upper end of their band. Steps matter to dampers."""


def limit_samples(records: list[Record], session: bool = False) -> tuple[list[Record], tuple[Finding, ...]]:
    """Return records with at most `MAX_SAMPLES` samples together, and a finding for each changed record.

    Every n-th sample is taken from records of one rate, with at least `MIN_SAMPLES_PER_CYCLE` in the fastest cycle of the
    excitation. If that is not enough, the longest records are cut to their beginnings. Nothing is filtered, because a filter
    would smear a force that jumps at reversals and change noise floor and errors. Disturbances of the force above half the
    lower rate therefore appear at another frequency.

    Parameters
    ----------
    records : list of Record
        Records with a channel ``input``, or an input channel for every axis.
    session : bool
        True if the records were cut from one session and must not be shortened.

    Raises
    ------
    InputError
        If records of a session are still too long at the lowest rate.
    """
    if sum(len(record) * max(len(record.axes), 1) for record in records) <= MAX_SAMPLES:
        return records, ()
    wanted = int(sum(map(len, records)) / ENOUGH_SAMPLES)
    rates = [round(1 / record.sampling_time, 6) for record in records]
    by_rate = {
        rate: [item for item, own in zip(records, rates, strict=True) if own == rate] for rate in rates
    }
    factors = {rate: _decimation_factor(own, wanted) for rate, own in by_rate.items()}
    lower, findings = [], []
    for record, rate in zip(records, rates, strict=True):
        factor = factors[rate]
        if factor < 2:
            lower.append(record)
            continue
        lower.append(_slice_record(record, slice(None, None, factor)))
        sentence = (
            f"{record.name}: one sample in {factor} was used, {rate / factor:g} Hz of {rate:g} Hz, which its excitation allows. "
            "Noise floor and errors are those of these samples."
        )
        findings.append(Finding("decimated", sentence, rate / factor, "Hz", record.name))
    total = sum(map(len, lower))
    if total <= MAX_SAMPLES:
        return lower, tuple(findings)
    if session:
        raise InputError(
            f"the records of the session have {total} samples together at the lowest rate that their excitation allows; at "
            f"most {MAX_SAMPLES} can be used, and none can be cut because the next continues from its end: leave some out, or "
            "leave session out"
        )
    short, shortened = _shorten_longest(lower)
    return short, (*findings, *shortened)


def _decimation_factor(records: list[Record], wanted: int) -> int:
    """Return the decimation factor of records of one rate, at most `wanted`; a divisor of all their periods is preferred."""
    edges = [band_edge(moved) for record in records for moved in record.stacked("input") if np.ptp(moved) > 0]
    largest = min(wanted, *(int(1 / (MIN_SAMPLES_PER_CYCLE * edge)) for edge in edges))
    largest = min(largest, *(len(record) // 200 for record in records))
    lengths = []
    for record in records:
        period = record.period or find_period(_slice_record(record, slice(_PERIOD_SEARCH)))
        if period is not None:
            lengths.append(round(period / record.sampling_time))
    factors = range(largest, largest // 2, -1)
    return next((factor for factor in factors if all(size % factor == 0 for size in lengths)), largest)


def _shorten_longest(records: list[Record]) -> tuple[list[Record], list[Finding]]:
    """Cut the longest records to one common length, so that all together have at most `MAX_SAMPLES` samples."""
    sizes = np.sort([len(record) for record in records])[::-1]
    longest = next(
        length
        for count in range(1, len(sizes) + 1)
        if (length := (MAX_SAMPLES - int(sizes[count:].sum())) // count)
        >= (sizes[count] if count < len(sizes) else 0)
    )
    cut = [item if len(item) <= longest else _slice_record(item, slice(longest)) for item in records]
    findings = []
    for record, short in zip(records, cut, strict=True):
        if short is not record:
            sentence = (
                f"{record.name}: only the first {short.duration:g} s of {record.duration:g} s were used, because all records "
                f"together have more than {MAX_SAMPLES} samples."
            )
            findings.append(Finding("shortened", sentence, short.duration, "s", record.name))
    return cut, findings


def _slice_record(record: Record, samples: slice) -> Record:
    remaining = range(len(record))[samples]
    values = {role: channel.values[samples] for role, channel in record.channels.items()}
    filled = tuple(remaining.index(sample) for sample in record.filled if sample in remaining)
    return record.with_samples(record.time[samples], values, filled)


def band_edge(position: np.ndarray) -> float:
    """Return the upper end of the excitation's band, in cycles per sample."""
    return spectral_edge(position - position.mean(), _BAND_POWER)


def decimate(data: FitData) -> FitData:
    """Return the same records at a lower rate, smoothed over two samples of that rate; short records are not changed.

    Position and force pass the same filter, which leaves a linear model between them unchanged. Only whole windows are used, so
    that nothing rings at the ends. Errors are not whitened, because the colour of the remaining noise is different.
    """
    # Leave `MIN_SAMPLES_PER_CYCLE` samples in the fastest cycle of every record.
    edges = [spectral_edge(np.diff(part.motion.position), _STEP_POWER) for part in data.records]
    factor = min(
        round(data.size / _ENOUGH_LINEAR), *(int(1 / (MIN_SAMPLES_PER_CYCLE * edge)) for edge in edges)
    )
    if factor < 2:
        return data
    window = np.hanning(2 * factor + 1)[1:-1]
    window /= window.sum()
    lower = []
    for part in data.records:
        motion, step = part.motion, factor * part.motion.sampling_time
        signals = (motion.position, part.force)
        position, force = (np.convolve(signal, window, "valid")[::factor] for signal in signals)
        settling = max(round((part.first - (len(window) - 1) / 2) / factor), 0)
        slow = Motion(np.arange(len(position)) * step, position, step, motion.smooth)
        lower.append(FitData(part.name, slow, force, settling=settling))
    return JointData.join(lower) if isinstance(data, JointData) else lower[0]
