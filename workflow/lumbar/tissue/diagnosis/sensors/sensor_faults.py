"""What is wrong with a record's sensors and clock, and the record repaired."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.sensors.bad_samples import find_dropped, find_gaps, find_held, find_wild
from lumbar.tissue.diagnosis.sensors.clock_skew import CLOCK_SKEW, find_skew, same_clocks
from lumbar.tissue.diagnosis.sensors.position_noise import find_rough_acceleration, find_roughness

_FINDERS = (
    find_gaps,
    find_wild,
    partial(find_held, role="input"),
    partial(find_held, role="output"),
    find_dropped,
    find_roughness,
    find_rough_acceleration,
    find_skew,
)
"""In an order in which each finds its fault unspoilt: whole records before smooth ones."""


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
    """Look for every fault in what is left of the record by the repairs before."""
    findings = []
    for find in _FINDERS:
        found = find(record)
        if found is not None:
            record = found.record
            findings += found.findings
    return record, findings
