"""Records at a rate, and of a length, that a search of many fits can afford."""

from dataclasses import replace

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.tissue.diagnosis.noise.periods import find_period
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.signals.spectrum import spectral_edge

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
    """The same records at a lower rate, smoothed over two of its samples; as they are where they are short.

    Position and force go through the same filter, so that a linear model from one to the other stays what it is. The filter
    sees whole windows only: nothing rings at the ends. Errors are then taken as they are: the noise left is another one.
    """
    # `PER_CYCLE` samples are left in the fastest cycle of any of the records.
    edges = [spectral_edge(np.diff(part.motion.position), _STEP_POWER) for part in data.records]
    largest = min(int(1 / (PER_CYCLE * edge)) for edge in edges)
    factor = min(round(data.size / _ENOUGH_LINEAR), largest)
    if factor < 2:
        return data
    if isinstance(data, JointData):
        return JointData.of([_smooth(part, factor) for part in data.parts])
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
