"""Whether records can be fitted to at all: units that agree, a training record that moves and responds."""

from __future__ import annotations

import numpy as np

from lumbar.errors import InputError
from lumbar.improvement.noise_floor import NoiseFloor
from lumbar.records.record import Record

_UNIT_FACTOR = 200.0
"""Ratio of one quantity between two records, the other alike, that only another unit explains."""
_ALIKE = 20.0
_LEAST_RANGE = 0.05
"""Share of another record's range that a training record must cover."""
_ABOVE_NOISE = 2.0
"""Variance of a response in noise variances, below which it holds little else."""


def check_excitation(training: Record, others: list[Record]) -> None:
    """Refuse a training record that hardly moves beside the others, and records whose numbers are in different units.

    Raises
    ------
    InputError
    """
    for other in others:
        position, force = (
            float(np.std(training[role]) / np.std(other[role])) for role in ("input", "output")
        )
        for ratio, rest, role in ((position, force, "input"), (force, position, "output")):
            if max(ratio, 1 / ratio) > _UNIT_FACTOR and max(rest, 1 / rest) < _ALIKE:
                channel = training.channels[role]
                raise InputError(
                    f"{training.source or training.name}: its {channel.quantity} is {ratio:.3g} times that of {other.name}, at a "
                    f"like {'force' if role == 'input' else 'motion'}: the records seem to be in different units; all must "
                    f"be in {channel.unit}, or give each its scale in the layout"
                )
        share = float(np.ptp(training["input"]) / np.ptp(other["input"]))
        if share < _LEAST_RANGE:
            unit = training.channels["input"].unit
            raise InputError(
                f"{training.source or training.name}: it moves by {np.ptp(training['input']):.3g} {unit} where {other.name} "
                f"moves by {np.ptp(other['input']):.3g} {unit}: a model fitted on it says nothing about {other.name}; train on "
                "another record, or record one that moves as far"
            )


def check_response(training: Record, floor: NoiseFloor | None) -> None:
    """Refuse a training record whose response is little but noise.

    Raises
    ------
    InputError
    """
    if floor is None or np.var(training["output"]) > _ABOVE_NOISE * floor.rms**2:
        return
    channel, spread = training.channels["output"], np.std(training["output"])
    raise InputError(
        f"{training.source or training.name}: its {channel.quantity} varies by {spread:.3g} {channel.unit} RMS, of which "
        f"{floor.rms:.3g} is noise: nothing can be fitted to it; excite more strongly"
    )
