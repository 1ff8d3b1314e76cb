"""Whether records can be fitted to at all: units that agree, a training record that moves and responds."""

from __future__ import annotations

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.noise.noise_floor import NoiseFloor

_UNIT_FACTOR = 200.0
"""Ratio of two records' force over position, in slow motion, that only another unit explains."""
_SLOWEST = 0.3
"""Share of the samples that count as slow: at high speed a force may grow beyond all measure."""
_LEAST_RANGE = 0.05
"""Share of another record's range that a training record must cover."""
_ABOVE_NOISE = 2.0
"""Variance of a response in noise variances, below which it holds little else."""


def check_excitation(training: Record, others: list[Record]) -> None:
    """Refuse a training record that hardly moves beside the others, and records whose numbers are in different units."""
    for other in others:
        stiffness = _slow_stiffness(training) / max(_slow_stiffness(other), 1e-300)
        if max(stiffness, 1 / max(stiffness, 1e-300)) > _UNIT_FACTOR:
            position, force = (
                float(np.std(training[role]) / np.std(other[role])) for role in ("input", "output")
            )
            moved = abs(np.log(position)) > abs(np.log(force))
            channel = training.channels["input" if moved else "output"]
            raise InputError(
                f"{training.source or training.name}: its {channel.quantity} is {position if moved else force:.3g} times that "
                f"of {other.name}, at a like {'force' if moved else 'motion'}: the records seem to be in different units; all "
                f"must be in {channel.unit}, or give each its scale in the layout"
            )
        share = float(np.ptp(training["input"]) / np.ptp(other["input"]))
        if share < _LEAST_RANGE:
            unit = training.channels["input"].unit
            raise InputError(
                f"{training.source or training.name}: it moves by {np.ptp(training['input']):.3g} {unit} where {other.name} "
                f"moves by {np.ptp(other['input']):.3g} {unit}: a model fitted on it says nothing about {other.name}; train on "
                "another record, or record one that moves as far"
            )


def _slow_stiffness(record: Record) -> float:
    """Spread of the force over that of the position where the position changes slowly."""
    speed = np.abs(np.gradient(record["input"]))
    slow = speed <= np.quantile(speed, _SLOWEST)
    return float(np.std(record["output"][slow]) / max(np.std(record["input"][slow]), 1e-300))


def check_response(training: Record, floor: NoiseFloor | None) -> None:
    """Refuse a training record whose response is little but noise."""
    if floor is None or np.var(training["output"]) > _ABOVE_NOISE * floor.rms**2:
        return
    channel, spread = training.channels["output"], np.std(training["output"])
    raise InputError(
        f"{training.source or training.name}: its {channel.quantity} varies by {spread:.3g} {channel.unit} RMS, of which "
        f"{floor.rms:.3g} is noise: nothing can be fitted to it; excite more strongly"
    )
