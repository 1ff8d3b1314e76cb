"""Faults of a record's sensors and clocks, e.g. a skew between two clocks, and the repaired record."""

from collections.abc import Sequence
from functools import partial
from itertools import combinations

import numpy as np

from lumbar.records.record import Record
from lumbar.records.rests import find_levels
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.noise.nonrepeating import line_power, smooth_power
from lumbar.tissue.diagnosis.noise.periods import MIN_FULL_PERIODS, declared_period, find_period, fold_periods
from lumbar.tissue.diagnosis.sensors.bad_samples import (
    Repair,
    find_dropped,
    find_gaps,
    find_outliers,
    find_stuck_samples,
    linear_response,
)
from lumbar.tissue.diagnosis.sensors.position_noise import (
    find_level_noise,
    find_rough_acceleration,
    find_roughness,
)

CLOCK_SKEW = "clock_skew"
_MIN_SKEW_PERIODS = MIN_FULL_PERIODS + 2
"""Smallest number of periods for the fit of a line to their delays."""
_MIN_SKEW_SIGMAS = 6.0
"""Smallest reported skew in standard errors."""
_MIN_CLEAR_DIFFERENCE = 20.0
"""Smallest difference of squared errors, in noise variances, of a clearly better explanation."""
_MAX_UNEXPLAINED = 0.1
"""Largest share of the growing deviations, in addition to noise, that the skew may leave."""
_MIN_LINE_SHARE_OF_VARIANCE = 0.9
"""Smallest share of the delays' variance that a line explains."""
_MAX_SLIP_SAMPLES = 1.0
"""Largest shift of a period relative to its folding over a record, in samples; more would blur the mean of the periods."""
_MAX_SLIP_SHARE = 0.3
"""Largest shift of the position relative to its folding, as a share of the skew."""
_TAPS = 16
"""Half length of the interpolating filter, in samples."""
_KAISER = 8.0
_BLOCK = 1 << 15
_ROUNDING = 1e-20
"""Power of the rounding of a force to its digits, relative to the power of its mean period."""


def find_skew(record: Record) -> Repair | None:
    """Find a skew between the clocks of force and position, which agree at the start of a record, and resample the force."""
    skew = _estimate_skew(record)
    if skew is None:
        return None
    rate, error = skew
    position, force = (record.channels[role].quantity for role in ("input", "output"))
    sentence = (
        f"{record.name}: the {force} {'falls behind' if rate > 0 else 'runs ahead of'} the {position} by {1e6 * abs(rate):.3g} ± "
        f"{2e6 * error:.2g} ppm, {1e3 * abs(rate) * record.duration:.2g} ms over the record: their clocks differ. The {force} "
        f"was resampled to the clock of the {position} before fitting; sample both channels with one clock."
    )
    finding = Finding(CLOCK_SKEW, sentence, 1e6 * rate, "ppm", record.name)
    return Repair(record.with_values(output=resample_at_clock_rate(record["output"], rate)), (finding,))


def _estimate_skew(record: Record) -> tuple[float, float] | None:
    """Return the delay of the force behind the position per second, and its standard error; None without a significant skew.

    A skew causes a deviation proportional to the mean period's rate of change that grows from period to period; a change of the
    tissue (gain, stiffness, damping) causes one proportional to mean force, position or speed. A skew is reported if it leaves
    little, each of the others clearly more, two of them together not clearly less, and the delays of periods follow a line.
    """
    period, step = declared_period(record, MIN_FULL_PERIODS) or find_period(record), record.sampling_time
    if period is None:
        return None
    count = int(len(record) / (period / step))
    if count < _MIN_SKEW_PERIODS or abs(period / step - round(period / step)) * count > 0.02:
        return None
    folding = fold_periods(record, period)
    force, position = folding.fold(record["output"]), folding.fold(record["input"])
    middle = folding.rows.mean(axis=1) * step
    middle -= middle.mean()
    # A level that drifts from period to period slopes within the mean period too, and jumps at its ends.
    drift = float(middle @ force.mean(axis=1) / (middle @ middle)) * step
    force = force - drift * (np.arange(folding.samples) - folding.samples / 2)
    mean, position = force.mean(axis=0), position - position.mean()
    mean_position = position.mean(axis=0)
    # Rates of change per second; half the sampling rate has none.
    frequency = np.fft.rfftfreq(len(mean), step)
    frequency[-1] = 0.0
    spectra = (np.fft.rfft(values) * 2j * np.pi * frequency for values in (mean, mean_position))
    rate, speed = (np.fft.irfft(spectrum, len(mean)) for spectrum in spectra)
    # If a period is not quite a whole number of samples, both channels slip against their folding.
    slip = float(middle @ (position @ speed) / (middle @ middle) / (speed @ speed))
    if abs(slip) * record.duration > _MAX_SLIP_SAMPLES * step:
        return None
    deviations = force - mean - slip * np.outer(middle, rate)
    growth = middle @ deviations / (middle @ middle)
    noise = line_power(deviations - np.outer(middle, growth), len(force) - 2)
    # The only noise of a force that repeats exactly is its digits.
    level = np.maximum(smooth_power(noise, len(force) - 2), _ROUNDING * np.mean(mean**2))
    weight = 1 / np.sqrt(level * len(mean) / (middle @ middle))
    weight[0] = 0.0  # a drift of the level is not evidence
    ramp = np.fft.rfft(np.linspace(-1, 1, len(mean))) * weight  # nor is its drift within a period
    ramp = np.concatenate([ramp.real, ramp.imag])

    def whiten(values: np.ndarray) -> np.ndarray:
        """Return the whitened real and imaginary parts of a period's spectral lines, orthogonal to those of a ramp."""
        lines = np.fft.rfft(values) * weight
        lines = np.concatenate([lines.real, lines.imag])
        return lines - ramp * (lines @ ramp) / (ramp @ ramp)

    column = whiten(rate)
    if not _is_skew(whiten(growth), column, [whiten(item) for item in (mean, mean_position, speed)]):
        return None
    amounts = np.array([column @ whiten(row) for row in deviations]) / (column @ column)
    slope = float(middle @ amounts / (middle @ middle))
    left = amounts - slope * middle
    is_straight = np.sum(left**2) <= (1 - _MIN_LINE_SHARE_OF_VARIANCE) * np.sum(amounts**2)
    if abs(slip) > _MAX_SLIP_SHARE * abs(slope) or not is_straight:
        return None
    return -slope, float(np.sqrt(np.sum(left**2) / (len(left) - 2) / (middle @ middle)))


def _is_skew(growth: np.ndarray, rate: np.ndarray, others: list[np.ndarray]) -> bool:
    """Return whether only the rate of change explains the growing deviation."""

    def rest(*columns: np.ndarray) -> float:
        design = np.column_stack(columns)
        return float(np.sum((growth - design @ np.linalg.lstsq(design, growth, rcond=None)[0]) ** 2))

    by_rate = rest(rate)
    explained = float(growth @ growth) - by_rate
    single = min(rest(column) for column in others)
    paired = min(rest(*columns) for columns in combinations(others, 2))
    noise = len(growth) / 2  # 1/2 in the real and in the imaginary part of every line
    return bool(
        explained > _MIN_SKEW_SIGMAS**2
        and single - by_rate > _MIN_CLEAR_DIFFERENCE
        and by_rate - paired < _MIN_CLEAR_DIFFERENCE
        and by_rate - noise < _MAX_UNEXPLAINED * explained
    )


def resample_at_clock_rate(values: np.ndarray, rate: float) -> np.ndarray:
    """Return values at times n (1 + rate), by a windowed sinc that keeps the noise's colour up to nearly half the rate."""
    size = len(values)
    taps = np.arange(-_TAPS + 1, _TAPS + 1)
    result = np.empty(size)
    before, after = 2 * values[0] - values[_TAPS:0:-1], 2 * values[-1] - values[-2 : -_TAPS - 2 : -1]
    padded = np.concatenate([before, values, after])
    for start in range(0, size, _BLOCK):
        place = np.clip(np.arange(start, min(start + _BLOCK, size)) * (1 + rate), 0, size - 1)
        whole = np.floor(place).astype(int)
        distance = taps - (place - whole)[:, None]
        weight = np.sinc(distance) * np.i0(_KAISER * np.sqrt(np.maximum(1 - (distance / _TAPS) ** 2, 0)))
        weight /= weight.sum(axis=1, keepdims=True)
        result[start : start + _BLOCK] = np.sum(weight * padded[whole[:, None] + taps + _TAPS], axis=1)
    return result


_find_stuck_positions = partial(find_stuck_samples, role="input")
_FINDERS = (
    find_gaps,
    find_outliers,
    _find_stuck_positions,
    partial(find_stuck_samples, role="output"),
    find_dropped,
    find_level_noise,
    find_roughness,
    find_rough_acceleration,
    find_skew,
)
"""Searches for faults, ordered so that no repair hides a later fault: missing samples before noise."""
_NEED_MOTION = {_find_stuck_positions, find_dropped, find_roughness, find_rough_acceleration}
"""Searches that take a rest, jump or step of a smooth motion for a fault: not those of commanded levels."""


def repair(records: Sequence[Record]) -> tuple[list[Record], list[Finding]]:
    """Repair faults of sensors and clocks in records with channels ``input`` and ``output``; return records and findings.

    Valid records are returned as the same objects. Findings are of the kinds ``gap``, ``wild_samples``, ``held_samples``,
    ``dropped_samples``, ``position_noise``, ``quantisation``, ``jitter``, ``rough_acceleration`` and ``clock_skew``. A lag of the
    position sensor is not detected, because it resembles a delay of the tissue. All records were made with the same clocks: a
    skew of one record is removed from records too short to show it, or without period, if a linear tissue then explains their
    force better.
    """
    repaired = [_repair_record(record) for record in records]
    skews = [item.value for _, findings in repaired for item in findings if item.kind == CLOCK_SKEW]
    valid = []
    for record, findings in repaired:
        if skews and not any(item.kind == CLOCK_SKEW for item in findings):
            shifted = resample_at_clock_rate(record["output"], 1e-6 * float(np.median(skews)))
            even = record.with_values(output=shifted)
            before, after = (np.sum((item["output"] - linear_response(item)) ** 2) for item in (record, even))
            record = even if after < before else record
        valid.append(record)
    return valid, [item for _, findings in repaired for item in findings]


def _repair_record(record: Record) -> tuple[Record, list[Finding]]:
    """Search and repair one kind of fault after another, each in the record after the previous repairs."""
    findings: list[Finding] = []
    excluded = _NEED_MOTION if find_levels(record["input"]) else ()
    for find in _FINDERS if np.ptp(record["input"]) > 0 else ():  # a rest shows no fault of the position
        repaired = None if find in excluded else find(record)
        if repaired is not None:
            record = repaired.record
            findings += repaired.findings
    return record, findings


_NOISE_RATIOS = {"position_noise": 1.0, "quantisation": 12**-0.5}
"""RMS of the noise relative to the value of a finding, by kind of finding."""


def force_of_position_noise(
    records: Sequence[Record], repaired: Sequence[Record], faults: Sequence[Finding]
) -> float:
    """Return the largest RMS, over the records, of the force due to position noise within the band.

    It is the white noise of the findings, without the part beyond the band (filtered out), times the stiffness of the record.
    """
    largest = 0.0
    for before, after in zip(records, repaired, strict=True):
        sizes = [
            _NOISE_RATIOS[item.kind] * item.value
            for item in faults
            if item.record == before.name and item.kind in _NOISE_RATIOS
        ]
        if sizes and len(before) == len(after):
            within = max(sizes) ** 2 - float(np.mean((before["input"] - after["input"]) ** 2))
            stiffness = float(np.std(after["output"]) / np.std(after["input"]))
            largest = max(largest, stiffness * float(np.sqrt(max(within, 0.0))))
    return largest
