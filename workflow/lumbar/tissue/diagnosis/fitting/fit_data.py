"""Records as a fit uses them: motion, force, samples that count, colour of the noise; and fewer samples for a search."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.noise.periods import find_period
from lumbar.tissue.models.motion import JoinedMotions, Motion, ResultCache
from lumbar.tissue.signals.spectrum import spectral_edge


@dataclass(frozen=True, eq=False)
class FitData:
    """One record prepared for fitting, with a cache of the fits to it: a search repeats some of them."""

    name: str
    motion: Motion | JoinedMotions
    """Motion."""
    force: np.ndarray
    """Shape (samples,)."""
    whitening: np.ndarray = field(default_factory=lambda: np.ones(1))
    """Coefficients of an FIR filter that makes the noise white; ``[1]`` where it is white."""
    settling: int = 0
    """Samples at the start that are left out of every error: the initial state is not known."""
    has_own_zero: bool = False
    """Whether the sensor had another zero than in training: the mean of an error is then ignored."""
    begins: int = 0
    """Sample at which the record itself begins: before it lies what came earlier in the same session, which is simulated
    and never counted."""
    cache: ResultCache = field(init=False, repr=False, default_factory=ResultCache)
    """Fits to this record."""

    @property
    def records(self) -> tuple[FitData, ...]:
        """The records that are fitted together: this one."""
        return (self,)

    @property
    def first(self) -> int:
        """Index of the first sample that counts: behind those that the whitening filter does not see whole."""
        return self.begins + max(self.settling, len(self.whitening) - 1)

    @property
    def length(self) -> int:
        """Number of samples of the record itself."""
        return len(self.force) - self.begins

    def drop_history(self, signal: np.ndarray) -> np.ndarray:
        """Signal (samples first) over the record itself."""
        return signal[self.begins :]

    def split(self, share: float) -> tuple[FitData, FitData]:
        """Cut the record in two: its first part, and the whole of it of which only what follows counts."""
        count = round(share * self.length)
        end = self.begins + count
        early = replace(self, motion=self.motion.beginning(end), force=self.force[:end])
        return early, replace(self, settling=count)

    def drop_whitening(self) -> FitData:
        """Return the same record without whitening of its errors."""
        return replace(self, whitening=np.ones(1))

    def shift_origin(self, position: float) -> FitData:
        """Return the same record with positions counted from this one."""
        return replace(self, motion=replace(self.motion, position=self.motion.position - position))

    @property
    def size(self) -> int:
        """Number of samples that count."""
        return len(self.force) - self.first

    def trim(self, signal: np.ndarray) -> np.ndarray:
        """Signal (samples first) from the first sample that counts."""
        return signal[self.first :]

    def whiten(self, signal: np.ndarray) -> np.ndarray:
        """Whitened signal (samples first) from the first sample that counts."""
        if len(self.whitening) > 1:
            from scipy.signal import lfilter

            signal = lfilter(self.whitening, [1.0], signal, axis=0)
        return self.trim(signal)

    def split_records(self, values: np.ndarray) -> list[np.ndarray]:
        """Values at the samples that count, apart for every record."""
        return [values]

    @cached_property
    def zeros(self) -> np.ndarray:
        """Column of a sensor's zero: ones, shape (samples, 1)."""
        return np.ones((len(self.force), 1))

    def error(self, simulated: np.ndarray) -> np.ndarray:
        """Simulated less measured force over the samples that count; about its mean where the zero is another one."""
        return self._about_zero(self.trim(simulated - self.force))

    def whitened_error(self, simulated: np.ndarray) -> np.ndarray:
        """Return `error` through the whitening filter."""
        return self._about_zero(self.whiten(simulated - self.force))

    def _about_zero(self, errors: np.ndarray) -> np.ndarray:
        return errors - errors.mean() if self.has_own_zero else errors

    def longest_record(self, signal: np.ndarray) -> tuple[Motion, np.ndarray]:
        """Motion of the longest record, and a signal over all samples there."""
        return self.motion, signal

    def scale(self, kind: str) -> float:
        """Size of a quantity for starting values; ``force`` is the largest force of the record."""
        return float(np.abs(self.force).max()) if kind == "force" else self.motion.scale(kind)


@dataclass(frozen=True, eq=False)
class JointData(FitData):
    """Several records that a model is fitted to together."""

    parts: tuple[FitData, ...] = ()
    """Records with the same sampling time."""

    @classmethod
    def join(cls, parts: list[FitData]) -> Self:
        """Put records together; the name lists theirs."""
        return cls(
            "+".join(part.name for part in parts),
            JoinedMotions(tuple(part.motion for part in parts)),
            np.concatenate([part.force for part in parts]),
            parts[0].whitening,
            parts[0].settling,
            parts=tuple(parts),
        )

    def split(self, share: float) -> tuple[FitData, FitData]:
        """Cut every record in two."""
        early, later = zip(*(part.split(share) for part in self.parts), strict=True)
        return self._rebuild(list(early)), self._rebuild(list(later))

    def drop_whitening(self) -> FitData:
        """Return the same records without whitening of their errors."""
        return self._rebuild([part.drop_whitening() for part in self.parts])

    def shift_origin(self, position: float) -> FitData:
        """Return the same records with positions counted from this one."""
        return self._rebuild([part.shift_origin(position) for part in self.parts])

    def _rebuild(self, parts: list[FitData]) -> JointData:
        return replace(type(self).join(parts), has_own_zero=self.has_own_zero)

    @cached_property
    def zeros(self) -> np.ndarray:
        """Columns of the sensor's zero, shape (samples, zeros): ones, or ones for each record if every record has a zero."""
        parts = [part.zeros for part in self.parts]
        if not self.has_own_zero:
            return np.concatenate(parts)
        ends = np.cumsum([part.shape[1] for part in parts])
        rows = [
            np.pad(part, ((0, 0), (end - part.shape[1], ends[-1] - end)))
            for part, end in zip(parts, ends, strict=True)
        ]
        return np.concatenate(rows)

    @property
    def records(self) -> tuple[FitData, ...]:
        """The records that are fitted together."""
        return self.parts

    @property
    def length(self) -> int:
        """Number of samples of the records themselves."""
        return sum(part.length for part in self.parts)

    @property
    def size(self) -> int:
        """Number of samples that count."""
        return sum(part.size for part in self.parts)

    def split_records(self, values: np.ndarray) -> list[np.ndarray]:
        """Values at the samples that count, apart for every record."""
        return np.split(values, np.cumsum([part.size for part in self.parts])[:-1])

    def trim(self, signal: np.ndarray) -> np.ndarray:
        """Signal (samples first) without what does not count of each record."""
        pieces = zip(self.parts, self.motion.split(signal), strict=True)
        return np.concatenate([part.trim(piece) for part, piece in pieces])

    def whiten(self, signal: np.ndarray) -> np.ndarray:
        """Whitened signal (samples first) without what does not count of each record."""
        pieces = zip(self.parts, self.motion.split(signal), strict=True)
        return np.concatenate([part.whiten(piece) for part, piece in pieces])

    def longest_record(self, signal: np.ndarray) -> tuple[Motion, np.ndarray]:
        """Motion of the longest record, and a signal over all samples there."""
        return max(
            zip(self.motion.parts, self.motion.split(signal), strict=True), key=lambda pair: len(pair[0])
        )


class FreeRun:
    """A model that simulates records from their input alone, and how far it is from them."""

    def simulate(self, motion: Motion | JoinedMotions) -> np.ndarray:
        """Free-run simulation of what the sensor reads, shape (samples,)."""
        raise NotImplementedError

    def rms(self, *records: FitData) -> float:
        """Root mean square of the simulation error over all samples that count of these records together."""
        return float(np.sqrt(np.mean(np.concatenate([self.errors(item) for item in records]) ** 2)))

    def errors(self, record: FitData) -> np.ndarray:
        """Free-run simulation error of the samples that count."""
        return record.error(self.simulate(record.motion))

    def whitened_errors(self, record: FitData) -> np.ndarray:
        """Free-run simulation error of the samples that count, through the record's whitening filter."""
        return record.whitened_error(self.simulate(record.motion))


MOST = 150_000
"""Samples of all records together that a diagnosis takes as they are."""
ENOUGH = 15_000
"""Samples of all records together that are left where the rate is lowered, if their excitation allows it."""
PER_CYCLE = 12.0
"""Samples per cycle at the upper end of the excitation's band that a lower rate must leave."""
_SEARCHED = 1_000_000
"""Samples at the beginning of a record in which its period is looked for."""
_BAND_POWER = 0.999
"""Share of the position's power below the upper end of its band. Not of its steps: those of a coarse encoder would keep
long records at their rate."""
_ENOUGH_LINEAR = 6000
"""Samples of all records together that a fit of linear models is left with, where the position's band allows it."""
_STEP_POWER = 0.9999
"""Share of the power of the position's steps below the upper end of its band. Of steps, for a damper answers the speed."""


def limit_samples(records: list[Record], session: bool = False) -> tuple[list[Record], tuple[Finding, ...]]:
    """Return records that a diagnosis can afford, and a finding for every one that was changed.

    Where all records together hold more than `MOST` samples, of those of one rate every n-th sample is taken, so that
    `PER_CYCLE` are left in the fastest cycle of their excitation; what is then still too long is cut to its beginning.

    Nothing is filtered: a force that jumps where the motion turns would be smeared, and no model of it would reach the noise
    any more. Every sample that is left is one that was measured, so noise floor and errors mean what they did; only what
    disturbs the force above half the lower rate is seen at another frequency.

    The records have a channel ``input``, or one for every axis. None is cut short where they were cut from one `session`.

    Raises
    ------
    InputError
        If records of a session are still too long at the lowest rate.
    """
    if sum(len(record) * max(len(record.axes), 1) for record in records) <= MOST:
        return records, ()
    lower, findings = _pick(records)
    cut, told = _cut(lower)
    if session and told:
        raise InputError(
            f"the records of the session hold {sum(map(len, lower))} samples together, at the lowest rate that their excitation "
            f"allows; at most {MOST} can be taken, and none can be cut short where the next one goes on from its end: leave "
            "some out, or leave session out"
        )
    return cut, (*findings, *told)


def decimate(data: FitData) -> FitData:
    """Return the same records at a lower rate, smoothed over two of its samples; short ones unchanged.

    Position and force go through the same filter, so that a linear model from one to the other is not changed. The filter
    uses whole windows only, so that nothing rings at the ends. Errors are not whitened: the remaining noise has another colour.
    """
    # `PER_CYCLE` samples are left in the fastest cycle of any of the records.
    edges = [spectral_edge(np.diff(part.motion.position), _STEP_POWER) for part in data.records]
    largest = min(int(1 / (PER_CYCLE * edge)) for edge in edges)
    factor = min(round(data.size / _ENOUGH_LINEAR), largest)
    if factor < 2:
        return data
    if isinstance(data, JointData):
        return JointData.join([_smooth(part, factor) for part in data.parts])
    return _smooth(data, factor)


def band_edge(position: np.ndarray) -> float:
    """Upper end of the excitation's band, in cycles per sample."""
    return spectral_edge(position - position.mean(), _BAND_POWER)


def _pick(records: list[Record]) -> tuple[list[Record], list[Finding]]:
    wanted = int(sum(map(len, records)) / ENOUGH)
    rates = [round(1 / record.sampling_time, 6) for record in records]
    factors = {
        rate: _factor([record for record, own in zip(records, rates, strict=True) if own == rate], wanted)
        for rate in set(rates)
    }
    lower, findings = [], []
    for record, rate in zip(records, rates, strict=True):
        factor = factors[rate]
        if factor < 2:
            lower.append(record)
            continue
        lower.append(_part(record, slice(None, None, factor)))
        sentence = (
            f"{record.name}: one sample in {factor} was used, {rate / factor:g} Hz of {rate:g} Hz, which its excitation allows. "
            "Noise floor and errors are those of these samples."
        )
        findings.append(Finding("decimated", sentence, rate / factor, "Hz", record.name))
    return lower, findings


def _factor(records: list[Record], wanted: int) -> int:
    """Factor for records of one rate: one that divides their periods where there is one."""
    edges = [band_edge(moved) for record in records for moved in record.stacked("input") if np.ptp(moved) > 0]
    largest = min(wanted, *(int(1 / (PER_CYCLE * edge)) for edge in edges))
    largest = min(largest, *(len(record) // 200 for record in records))
    periods = [record.period or find_period(_part(record, slice(_SEARCHED))) for record in records]
    lengths = [
        round(period / record.sampling_time)
        for period, record in zip(periods, records, strict=True)
        if period is not None
    ]
    whole = (
        factor for factor in range(largest, largest // 2, -1) if all(size % factor == 0 for size in lengths)
    )
    return next(whole, largest)


def _cut(records: list[Record]) -> tuple[list[Record], list[Finding]]:
    """Cut the longest records to their beginnings until all together are few enough."""
    sizes = np.sort([len(record) for record in records])[::-1]
    if sizes.sum() <= MOST:
        return records, []
    # The common length to which the longest ones are cut: the others keep theirs.
    longest = next(
        length
        for count in range(1, len(sizes) + 1)
        if (length := (MOST - int(sizes[count:].sum())) // count)
        >= (sizes[count] if count < len(sizes) else 0)
    )
    cut, findings = [], []
    for record in records:
        if len(record) <= longest:
            cut.append(record)
            continue
        short = _part(record, slice(longest))
        cut.append(short)
        sentence = (
            f"{record.name}: only the first {short.duration:g} s of {record.duration:g} s were used, because all records "
            f"together have more than {MOST} samples."
        )
        findings.append(Finding("shortened", sentence, short.duration, "s", record.name))
    return cut, findings


def _part(record: Record, samples: slice) -> Record:
    """Some of a record's samples, from the first one on."""
    kept = range(len(record))[samples]
    channels = {
        role: replace(channel, values=channel.values[samples]) for role, channel in record.channels.items()
    }
    filled = tuple(kept.index(sample) for sample in record.filled if sample in kept)
    return replace(record, time=record.time[samples], channels=channels, filled=filled)


def _smooth(data: FitData, factor: int) -> FitData:
    motion, window = data.motion, np.hanning(2 * factor + 1)[1:-1]
    window /= window.sum()
    position, force = (
        np.convolve(signal, window, "valid")[::factor] for signal in (motion.position, data.force)
    )
    step = factor * motion.sampling_time
    lower = Motion(np.arange(len(position)) * step, position, step, motion.smooth)
    settling = round((data.first - (len(window) - 1) / 2) / factor)
    return FitData(data.name, lower, force, settling=max(settling, 0))
