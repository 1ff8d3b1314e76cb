"""Clock skew: a force that falls behind the position, or runs ahead of it, by ever more as the record goes on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.diagnosis.finding import Finding
from lumbar.diagnosis.noise.periods import FEWEST_PERIODS, Folding, find_period, fold_periods
from lumbar.records.record import Record

_FEWEST_PERIODS = FEWEST_PERIODS + 2
"""Periods from which on a line through their delays says something."""
_TELLS = 0.03
"""Share of the force's rate of change that stiffness, damping and size of the force must leave unexplained."""
_SURE = 6.0
"""Standard errors of the slope."""
_STRAIGHT = 0.9
"""Share of the delays' variance that lies on a line."""
_TAPS = 16
"""Half length of the interpolating filter, in samples."""
_KAISER = 8.0
_BLOCK = 1 << 15


@dataclass(frozen=True)
class ClockSkew:
    """Two clocks that go differently.

    Attributes
    ----------
    rate : float
        Seconds that the force falls behind the position in a second.
    error : float
        Its standard error.
    """

    rate: float
    error: float

    kind = "clock_skew"

    def finding(self, record: Record) -> Finding:
        """Say by how much the clocks differ."""
        force, position = (record.channels[role].quantity for role in ("output", "input"))
        moved = 1e3 * abs(self.rate) * record.duration
        return Finding(
            self.kind,
            f"{record.name}: the {force} {'falls behind' if self.rate > 0 else 'runs ahead of'} the {position} by "
            f"{1e6 * abs(self.rate):.3g} ± {2e6 * self.error:.2g} ppm, {moved:.2g} ms over the record: their clocks differ; the "
            f"{force} is put on the clock of the {position} before fitting: sample both channels with one clock",
            1e6 * self.rate,
            "ppm",
            record.name,
        )

    def mended(self, record: Record) -> Record:
        """The record with the force on the clock of the position, taken as alike at the record's start."""
        return record.with_values(output=shifted(record["output"], self.rate))


def find_skew(record: Record) -> ClockSkew | None:
    """Return the skew between the clocks of force and position of a periodic record, or None where none is sure.

    Every period's force differs from the mean of all by a delay, and may differ in level, slope, size, stiffness and damping,
    which change over a record for physical reasons. Delays that lie on a line, clearly off level, are a skew.
    """
    folding = _periods(record)
    if folding is None:
        return None
    delays, errors = _delays(record, folding)
    if not delays.size:
        return None
    middle = folding.rows.mean(axis=1) * record.sampling_time
    middle -= middle.mean()
    rate = float(middle @ delays / (middle @ middle))
    left = delays - delays.mean() - rate * middle
    scatter = max(np.sum(left**2) / (len(delays) - 2), float(np.mean(errors**2)))
    error = float(np.sqrt(scatter / (middle @ middle)))
    straight = np.sum(left**2) <= (1 - _STRAIGHT) * np.sum((delays - delays.mean()) ** 2)
    return ClockSkew(rate, error) if straight and abs(rate) > _SURE * error else None


def _periods(record: Record) -> Folding | None:
    """Periods of a record, the first left out; None where they are few or no whole number of samples long."""
    known = record.period if record.period and record.duration >= FEWEST_PERIODS * record.period else None
    period = known or find_period(record)
    if period is None:
        return None
    length = period / record.sampling_time
    count = int(len(record) / length)
    if count < _FEWEST_PERIODS or abs(length - round(length)) * count > 0.02:
        return None
    return fold_periods(record, period)


def _delays(record: Record, folding: Folding) -> tuple[np.ndarray, np.ndarray]:
    """Delay of every period's force behind the mean of all (seconds) and its standard error; empty where it cannot be told."""
    force, position = folding.fold(record["output"]), folding.fold(record["input"]).mean(axis=0)
    mean = force.mean(axis=0)
    lines = max(2, min(folding.samples // 4, _content(mean)))
    rate, response, speed = _rate(mean, lines), _within(mean, lines), _rate(position, lines)
    other = np.column_stack(
        [np.ones(folding.samples), np.linspace(-1, 1, folding.samples), response, position, speed]
    )
    other = np.linalg.qr(other)[0]
    alone = rate - other @ (other.T @ rate)
    size = float(alone @ alone)
    if size <= _TELLS**2 * float(rate @ rate):
        return np.empty(0), np.empty(0)
    deviations = force - mean
    amounts = deviations @ alone / size
    left = deviations - np.outer(amounts, alone) - (deviations @ other) @ other.T
    errors = np.sqrt(np.mean(left**2, axis=1) / size)
    return -amounts * record.sampling_time, errors * record.sampling_time


def _content(force: np.ndarray) -> int:
    """Highest line of a mean period with a part of the force that is worth differentiating."""
    power = np.abs(np.fft.rfft(force - force.mean())) ** 2
    level = np.median(power)
    return int(np.flatnonzero(power > 30 * level)[-1]) if np.any(power > 30 * level) else 2


def _within(values: np.ndarray, lines: int) -> np.ndarray:
    spectrum = np.fft.rfft(values)
    spectrum[lines + 1 :] = 0
    return np.fft.irfft(spectrum, len(values))


def _rate(values: np.ndarray, lines: int) -> np.ndarray:
    """Change per sample of a period, of its lines up to this one."""
    spectrum = np.fft.rfft(values)
    spectrum[lines + 1 :] = 0
    return np.fft.irfft(spectrum * 2j * np.pi * np.fft.rfftfreq(len(values)), len(values))


def shifted(values: np.ndarray, rate: float) -> np.ndarray:
    """Values at times n (1 + rate), by a windowed sinc: noise keeps its colour up to nearly half the sampling rate.

    Parameters
    ----------
    values : numpy.ndarray, shape (samples,)
    rate : float
    """
    size = len(values)
    taps = np.arange(-_TAPS + 1, _TAPS + 1)
    result = np.empty(size)
    padded = np.concatenate([2 * values[0] - values[_TAPS:0:-1], values, 2 * values[-1] - values[-2 : -_TAPS - 2 : -1]])
    for start in range(0, size, _BLOCK):
        place = np.clip(np.arange(start, min(start + _BLOCK, size)) * (1 + rate), 0, size - 1)
        whole = np.floor(place).astype(int)
        away = taps - (place - whole)[:, None]
        weight = np.sinc(away) * np.i0(_KAISER * np.sqrt(np.maximum(1 - (away / _TAPS) ** 2, 0)))
        weight /= weight.sum(axis=1, keepdims=True)
        result[start : start + _BLOCK] = np.sum(weight * padded[whole[:, None] + taps + _TAPS], axis=1)
    return result
