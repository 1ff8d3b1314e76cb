"""What is wrong with a record's sensors, and with its clock, which runs ahead by ever more; and the record repaired."""

from collections.abc import Sequence
from functools import partial
from itertools import combinations

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.noise.nonrepeating import line_power, smooth_power
from lumbar.tissue.diagnosis.noise.periods import (
    MIN_FULL_PERIODS,
    Folding,
    declared_period,
    find_period,
    fold_periods,
)
from lumbar.tissue.diagnosis.sensors.bad_samples import (
    Repair,
    find_dropped,
    find_gaps,
    find_outliers,
    find_stuck_samples,
    linear_response,
)
from lumbar.tissue.diagnosis.sensors.position_noise import find_rough_acceleration, find_roughness

CLOCK_SKEW = "clock_skew"
_FEWEST_PERIODS = MIN_FULL_PERIODS + 2
"""Smallest number of periods for a line through their delays."""
_SURE = 6.0
"""Standard errors of a skew."""
_BETTER = 20.0
"""Squared error, in noise variances, by which one explanation is clearly better than another."""
_UNEXPLAINED = 0.1
"""Largest share of the growing deviations that may remain, beyond noise, without the skew."""
_STRAIGHT = 0.9
"""Share of the delays' variance that lies on a line."""
_MOST_SLIP = 1.0
"""Samples by which a period may slip against its folding over a record: beyond, the mean of the periods is blurred."""
_SLIPS = 0.3
"""Share of a skew by which the position itself may slip against its folding."""
_TAPS = 16
"""Half length of the interpolating filter, in samples."""
_KAISER = 8.0
_BLOCK = 1 << 15
_ROUNDING = 1e-20
"""Power of the digits that a force is written with, in that of its mean period."""


def find_skew(record: Record) -> Repair | None:
    """Find a skew between the clocks of force and position of a periodic record, where it is sure.

    The force is put on the clock of the position, taken as alike at the record's start.
    """
    found = _skew(record)
    if found is None:
        return None
    rate, error = found
    position, force = (record.channels[role].quantity for role in ("input", "output"))
    sentence = (
        f"{record.name}: the {force} {'falls behind' if rate > 0 else 'runs ahead of'} the {position} by {1e6 * abs(rate):.3g} ± "
        f"{2e6 * error:.2g} ppm, {1e3 * abs(rate) * record.duration:.2g} ms over the record: their clocks differ. The {force} "
        f"was resampled to the clock of the {position} before fitting; sample both channels with one clock."
    )
    finding = Finding(CLOCK_SKEW, sentence, 1e6 * rate, "ppm", record.name)
    return Repair(record.with_values(output=shift_times(record["output"], rate)), (finding,))


def _skew(record: Record) -> tuple[float, float] | None:
    """Return the seconds that the force falls behind the position per second, and the standard error; None without a sure skew.

    What grows from period to period is, for a skew, the mean period's rate of change; for a tissue that changes, the mean
    force, position or speed (gain, stiffness, damping). A skew is reported if the first leaves little, the others leave
    clearly more, two of them together not clearly less, and the delays of the single periods lie on a line.
    """
    folding = _periods(record)
    if folding is None:
        return None
    force, position = folding.fold(record["output"]), folding.fold(record["input"])
    middle = folding.rows.mean(axis=1) * record.sampling_time
    middle -= middle.mean()
    # A level that drifts from period to period slopes within the mean period too, and jumps at its ends.
    drift = float(middle @ force.mean(axis=1) / (middle @ middle)) * record.sampling_time
    force = force - drift * (np.arange(folding.samples) - folding.samples / 2)
    mean, position = force.mean(axis=0), position - position.mean()
    rate, speed = (_rate(values, record.sampling_time) for values in (mean, position.mean(axis=0)))
    # A period that is not quite a whole number of samples makes both channels slip against their folding.
    slip = float(middle @ (position @ speed) / (middle @ middle) / (speed @ speed))
    if abs(slip) * record.duration > _MOST_SLIP * record.sampling_time:
        return None
    deviations = force - mean - slip * np.outer(middle, rate)
    growth = middle @ deviations / (middle @ middle)
    noise = line_power(deviations - np.outer(middle, growth), len(force) - 2)
    # A force that repeats exactly has no noise but its digits.
    level = np.maximum(smooth_power(noise, len(force) - 2), _ROUNDING * np.mean(mean**2))
    weight = 1 / np.sqrt(level * len(mean) / (middle @ middle))
    weight[0] = 0.0  # a level that drifts says nothing
    ramp = np.linspace(-1, 1, len(mean))  # nor does its drift within a period
    spectra = {"rate": rate, "force": mean, "position": position.mean(axis=0), "speed": speed}
    spectra = {name: _lines(values, weight, ramp) for name, values in spectra.items()}
    wanted = _lines(growth, weight, ramp)
    if not _is_skew(wanted, spectra):
        return None
    column = spectra["rate"]
    amounts = np.array([column @ _lines(row, weight, ramp) for row in deviations]) / (column @ column)
    slope = float(middle @ amounts / (middle @ middle))
    if abs(slip) > _SLIPS * abs(slope):
        return None
    left = amounts - slope * middle
    if np.sum(left**2) > (1 - _STRAIGHT) * np.sum(amounts**2):
        return None
    return -slope, float(np.sqrt(np.sum(left**2) / (len(left) - 2) / (middle @ middle)))


def same_clocks(record: Record, rate: float) -> Record:
    """Return a record repaired by the skew of another one, where a linear tissue then explains its force better.

    Records that are too short to tell a skew, or do not repeat, were made with the same two clocks.
    """
    even = record.with_values(output=shift_times(record["output"], rate))
    before, after = (np.sum((item["output"] - linear_response(item)) ** 2) for item in (record, even))
    return even if after < before else record


def _lines(values: np.ndarray, weight: np.ndarray, ramp: np.ndarray) -> np.ndarray:
    """Whitened real and imaginary parts of a period's lines, without what is along a ramp."""
    lines = [
        np.concatenate([found.real, found.imag])
        for found in (np.fft.rfft(values) * weight, np.fft.rfft(ramp) * weight)
    ]
    return lines[0] - lines[1] * (lines[0] @ lines[1]) / (lines[1] @ lines[1])


def _is_skew(growth: np.ndarray, spectra: dict[str, np.ndarray]) -> bool:
    """Whether the rate of change alone explains what grows, and nothing else does as well."""
    others = ("force", "position", "speed")
    explanations = [("rate",), *combinations(others, 1), *combinations(others, 2)]
    left = {}
    for names in explanations:
        columns = np.column_stack([spectra[name] for name in names])
        rest = growth - columns @ np.linalg.lstsq(columns, growth, rcond=None)[0]
        left[names] = float(np.sum(rest**2))
    rate = left.pop(("rate",))
    explained = float(growth @ growth) - rate
    single = min(value for names, value in left.items() if len(names) == 1)
    paired = min(value for names, value in left.items() if len(names) == 2)
    usual = len(growth) / 2  # every line's noise is 1/2 in its real and in its imaginary part
    return bool(
        explained > _SURE**2
        and single - rate > _BETTER
        and rate - paired < _BETTER
        and rate - usual < _UNEXPLAINED * explained
    )


def _periods(record: Record) -> Folding | None:
    """Periods of a record, the first left out; None where they are few or no whole number of samples long."""
    period = declared_period(record, MIN_FULL_PERIODS) or find_period(record)
    if period is None:
        return None
    length = period / record.sampling_time
    count = int(len(record) / length)
    if count < _FEWEST_PERIODS or abs(length - round(length)) * count > 0.02:
        return None
    return fold_periods(record, period)


def _rate(values: np.ndarray, sampling_time: float) -> np.ndarray:
    """Rate of change (per second) of a period."""
    frequency = np.fft.rfftfreq(len(values), sampling_time)
    spectrum = np.fft.rfft(values) * 2j * np.pi * frequency
    spectrum[-1] = 0  # half the sampling rate has no rate of change
    return np.fft.irfft(spectrum, len(values))


def shift_times(values: np.ndarray, rate: float) -> np.ndarray:
    """Values at times n (1 + rate), by a windowed sinc: noise keeps its colour up to nearly half the sampling rate."""
    size = len(values)
    taps = np.arange(-_TAPS + 1, _TAPS + 1)
    result = np.empty(size)
    padded = np.concatenate(
        [2 * values[0] - values[_TAPS:0:-1], values, 2 * values[-1] - values[-2 : -_TAPS - 2 : -1]]
    )
    for start in range(0, size, _BLOCK):
        place = np.clip(np.arange(start, min(start + _BLOCK, size)) * (1 + rate), 0, size - 1)
        whole = np.floor(place).astype(int)
        away = taps - (place - whole)[:, None]
        weight = np.sinc(away) * np.i0(_KAISER * np.sqrt(np.maximum(1 - (away / _TAPS) ** 2, 0)))
        weight /= weight.sum(axis=1, keepdims=True)
        result[start : start + _BLOCK] = np.sum(weight * padded[whole[:, None] + taps + _TAPS], axis=1)
    return result


_FINDERS = (
    find_gaps,
    find_outliers,
    partial(find_stuck_samples, role="input"),
    partial(find_stuck_samples, role="output"),
    find_dropped,
    find_roughness,
    find_rough_acceleration,
    find_skew,
)
"""Order in which no repair hides a later fault: missing samples before noise."""


def sensor_faults(record: Record) -> list[Finding]:
    """Return what is wrong with the sensors of a record and with its clock.

    The record has channels ``input`` and ``output``. Findings are of the kinds ``gap``, ``wild_samples``,
    ``held_samples``, ``dropped_samples``, ``position_noise``, ``quantisation``, ``jitter``, ``rough_acceleration`` and
    ``clock_skew``. A position sensor that lags is not among them: its lag and a tissue's own delay look alike.
    """
    return _repair(record)[1]


def repair(records: Sequence[Record]) -> tuple[list[Record], list[Finding]]:
    """Return the records of a set without their sensors' faults, and what was found; sound ones are the same objects.

    A skew of the clocks that one record shows holds for the others too.
    """
    repaired = [_repair(record) for record in records]
    skews = [item.value for _, findings in repaired for item in findings if item.kind == CLOCK_SKEW]
    sound = [
        record
        if not skews or any(item.kind == CLOCK_SKEW for item in findings)
        else same_clocks(record, 1e-6 * float(np.median(skews)))
        for record, findings in repaired
    ]
    return sound, [item for _, findings in repaired for item in findings]


def _repair(record: Record) -> tuple[Record, list[Finding]]:
    """Search and repair every fault in the record as the repairs before have left it."""
    findings = []
    for find in _FINDERS:
        found = find(record)
        if found is not None:
            record = found.record
            findings += found.findings
    return record, findings


_OF_STEP = {"position_noise": 1.0, "quantisation": 12**-0.5}
"""RMS of the noise relative to the value of a finding."""


def force_of_position_noise(
    records: Sequence[Record], sound: Sequence[Record], faults: Sequence[Finding]
) -> float:
    """Largest RMS, over the records, of the force that position noise makes within the band, at the records' own stiffness.

    The white noise of the findings, less what was filtered out beyond the band.
    """
    largest = 0.0
    for before, after in zip(records, sound, strict=True):
        sizes = [
            _OF_STEP[item.kind] * item.value
            for item in faults
            if item.record == before.name and item.kind in _OF_STEP
        ]
        if sizes and len(before) == len(after):
            within = max(sizes) ** 2 - float(np.mean((before["input"] - after["input"]) ** 2))
            stiffness = float(np.std(after["output"]) / np.std(after["input"]))
            largest = max(largest, stiffness * float(np.sqrt(max(within, 0.0))))
    return largest
