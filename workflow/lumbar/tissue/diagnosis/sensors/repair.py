"""A record without a fault of its sensors, and what a plain linear tissue explains of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding

_RELAXATION_TIMES = (0.03, 0.1, 0.3, 1.0, 3.0)
"""In the record's time scale."""


@dataclass(frozen=True, eq=False)
class Repair:
    """What is wrong with a sensor or a clock, and the record as it would be without, as far as that can be had."""

    record: Record
    findings: tuple[Finding, ...]
    """What is wrong, how much, and what to do."""


def linear_response(record: Record, left_out: np.ndarray | None = None) -> np.ndarray:
    """Force of the linear tissue that fits a record: a constant, stiffness, damping and relaxing branches.

    Roughly: to fill samples in, and to see whether a repair helps.

    The result has shape (samples,); not fitted to the samples `left_out`.
    """
    from scipy.signal import lfilter

    position, step = record["input"] - record["input"][0], record.sampling_time
    columns = [np.ones(len(position)), position, np.gradient(position, step)]
    for time in _RELAXATION_TIMES:
        decay = np.exp(-step / (time * record.time_scale))
        columns.append(lfilter([1 - decay], [1, -decay], position))
    columns = np.column_stack(columns)
    kept = np.ones(len(position), dtype=bool)
    if left_out is not None:
        kept[left_out] = False
    return columns @ np.linalg.lstsq(columns[kept], record["output"][kept], rcond=1e-10)[0]
