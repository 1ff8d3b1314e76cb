"""Records as a fit sees them: motion, force, which samples count, the noise's colour, and a model's errors there."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from lumbar.tissue.models.motion import JoinedMotions, Motion, ResultCache


@dataclass(frozen=True, eq=False)
class FitData:
    """One record prepared for fitting; it keeps the fits to it, for a search comes to the same one on several ways."""

    name: str
    motion: Motion | JoinedMotions
    """Motion."""
    force: np.ndarray
    """Shape (samples,)."""
    whitening: np.ndarray = field(default_factory=lambda: np.ones(1))
    """Coefficients of an FIR filter that makes the noise white; ``[1]`` where it is white."""
    settling: int = 0
    """Samples at the start that are left out of every error: the initial state is not known."""
    own_zero: bool = False
    """Whether the sensor had another zero than in training: the mean of an error then says nothing."""
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

    def own(self, signal: np.ndarray) -> np.ndarray:
        """Signal (samples first) over the record itself."""
        return signal[self.begins :]

    def split(self, share: float) -> tuple[FitData, FitData]:
        """Cut the record in two: its first part, and the whole of it of which only what follows counts."""
        count = round(share * self.length)
        end = self.begins + count
        early = replace(self, motion=self.motion.beginning(end), force=self.force[:end])
        return early, replace(self, settling=count)

    def without_whitening(self) -> FitData:
        """The same record, its errors taken as they are."""
        return replace(self, whitening=np.ones(1))

    def with_origin(self, position: float) -> FitData:
        """The same record, its positions counted from here."""
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

    def by_record(self, values: np.ndarray) -> list[np.ndarray]:
        """Values at the samples that count, apart for every record."""
        return [values]

    @cached_property
    def zeros(self) -> np.ndarray:
        """What a sensor's zero adds: one column of ones, shape (samples, 1)."""
        return np.ones((len(self.force), 1))

    def error(self, simulated: np.ndarray) -> np.ndarray:
        """Simulated less measured force over the samples that count; about its mean where the zero is another one."""
        return self._about_zero(self.trim(simulated - self.force))

    def whitened_error(self, simulated: np.ndarray) -> np.ndarray:
        """The same through the whitening filter."""
        return self._about_zero(self.whiten(simulated - self.force))

    def _about_zero(self, errors: np.ndarray) -> np.ndarray:
        return errors - errors.mean() if self.own_zero else errors

    def longest(self, signal: np.ndarray) -> tuple[Motion, np.ndarray]:
        """Motion of the longest record, and a signal over all samples there."""
        return self.motion, signal

    def scale(self, kind: str) -> float:
        """Size of a quantity for starting values; ``force`` is the largest force of the record."""
        return float(np.abs(self.force).max()) if kind == "force" else self.motion.scale(kind)


@dataclass(frozen=True, eq=False)
class JointData(FitData):
    """Several records that a model is fitted to together."""

    parts: tuple[FitData, ...] = ()
    """Sampled alike."""

    @classmethod
    def of(cls, parts: list[FitData]) -> Self:
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
        return self._with_parts(list(early)), self._with_parts(list(later))

    def without_whitening(self) -> FitData:
        """The same records, their errors taken as they are."""
        return self._with_parts([part.without_whitening() for part in self.parts])

    def with_origin(self, position: float) -> FitData:
        """The same records, their positions counted from here."""
        return self._with_parts([part.with_origin(position) for part in self.parts])

    def _with_parts(self, parts: list[FitData]) -> JointData:
        return replace(type(self).of(parts), own_zero=self.own_zero)

    @cached_property
    def zeros(self) -> np.ndarray:
        """What the sensor's zero adds: ones, or ones for each record that has a zero of its own; (samples, zeros)."""
        parts = [part.zeros for part in self.parts]
        if not self.own_zero:
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

    def by_record(self, values: np.ndarray) -> list[np.ndarray]:
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

    def longest(self, signal: np.ndarray) -> tuple[Motion, np.ndarray]:
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
