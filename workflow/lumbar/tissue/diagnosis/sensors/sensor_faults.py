"""What is wrong with a record's sensors and clock, and the record mended."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Protocol

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.sensors.clock_skew import ClockSkew, find_skew, same_clocks
from lumbar.tissue.diagnosis.sensors.dropped_samples import DroppedSamples, find_dropped
from lumbar.tissue.diagnosis.sensors.gaps import Gaps, find_gaps
from lumbar.tissue.diagnosis.sensors.held_samples import HeldSamples, find_held
from lumbar.tissue.diagnosis.sensors.position_noise import PositionNoise
from lumbar.tissue.diagnosis.sensors.position_step import PositionStep, find_step
from lumbar.tissue.diagnosis.sensors.rough_acceleration import RoughAcceleration, find_rough_acceleration
from lumbar.tissue.diagnosis.sensors.roughness import is_motion, roughness_of
from lumbar.tissue.diagnosis.sensors.sampling_jitter import SamplingJitter
from lumbar.tissue.diagnosis.sensors.wild_samples import WildSamples, find_wild


class Fault(Protocol):
    """One thing that is wrong with a sensor."""

    kind: str

    def finding(self, record: Record) -> Finding:
        """Say what is wrong, how much, and what to do."""

    def mended(self, record: Record) -> Record:
        """The record as it would be without the fault, as far as that can be had."""


def sensor_faults(record: Record) -> list[Finding]:
    """Return what is wrong with the sensors of a record and with its clock.

    Parameters
    ----------
    record : Record
        With channels ``input`` and ``output``.

    Returns
    -------
    list of Finding
        Of the kinds ``gap``, ``wild_samples``, ``held_samples``, ``dropped_samples``, ``position_noise``, ``quantisation``,
        ``jitter``, ``rough_acceleration`` and ``clock_skew``; empty where nothing is wrong. A position sensor that lags is
        not among them: its lag and a tissue's own delay look alike.
    """
    return [fault.finding(at) for fault, at, _ in _faults(record)]


def mended(record: Record, findings: Sequence[Finding]) -> Record:
    """Return a record without the faults that were found in it; the same object where none was.

    Parameters
    ----------
    findings : sequence of Finding
        What `sensor_faults` found in this record, or in all records of a set: a skew of the clocks that one of them tells
        holds for the others too.
    """
    kinds = {item.kind for item in findings if item.record == record.name}
    skews = [item.value for item in findings if item.kind == ClockSkew.kind]
    for _, _, after in _faults(record, kinds):
        record = after
    if skews and ClockSkew.kind not in kinds:
        return same_clocks(record, 1e-6 * float(np.median(skews)))
    return record


def _faults(record: Record, kinds: Collection[str] | None = None) -> Iterator[tuple[Fault, Record, Record]]:
    """Every fault, the record that it was found in, and that record mended; each looks at what the one before left."""
    for find, of in _FINDERS.items():
        if kinds is not None and not of & set(kinds):
            continue
        for fault in find(record):
            if kinds is None or fault.kind in kinds:
                after = fault.mended(record)
                yield fault, record, after
                record = after


def _gaps(record: Record) -> list[Fault]:
    return [fault for fault in (find_gaps(record),) if fault]


def _wild(record: Record) -> list[Fault]:
    return [fault for fault in (find_wild(record),) if fault]


def _held(record: Record) -> list[Fault]:
    return [fault for role in ("input", "output") if (fault := find_held(record, role))]


def _dropped(record: Record) -> list[Fault]:
    return [fault for fault in (find_dropped(record),) if fault]


def _rough(record: Record) -> list[Fault]:
    found = roughness_of(record)
    if found is None:
        return []
    step = find_step(record["input"], found.moves)
    if step:  # what is left of a staircase grows with speed as what jitter does
        return [PositionStep(step, found)]
    if found.noise > 0 and is_motion(found, record):
        return []
    faults: list[Fault] = [PositionNoise(found)] if found.noise > 0 else []
    return [*faults, SamplingJitter(found)] if found.jitter > 0 else faults


def _rough_acceleration(record: Record) -> list[Fault]:
    return [fault for fault in (find_rough_acceleration(record),) if fault]


def _skew(record: Record) -> list[Fault]:
    return [fault for fault in (find_skew(record),) if fault]


_FINDERS: dict[Callable[[Record], list[Fault]], set[str]] = {
    _gaps: {Gaps.kind},
    _wild: {WildSamples.kind},
    _held: {HeldSamples.kind},
    _dropped: {DroppedSamples.kind},
    _rough: {PositionNoise.kind, PositionStep.kind, SamplingJitter.kind},
    _rough_acceleration: {RoughAcceleration.kind},
    _skew: {ClockSkew.kind},
}
"""What finds which kinds, in an order in which each finds them unspoilt: whole records before smooth ones."""
