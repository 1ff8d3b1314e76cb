"""Compare and locate on a fitted model: its free run on every record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.diagnosis.fitting.joint_fit import Fit
from lumbar.diagnosis.noise.noise_floor import NoiseFloor
from lumbar.diagnosis.residuals.compare import Comparison, compare_record
from lumbar.diagnosis.residuals.locate import Location, locate
from lumbar.models.measured_angle import for_base
from lumbar.models.motion import Motion
from lumbar.records.record import Record


@dataclass(frozen=True, eq=False)
class Simulated:
    """A record beside a model's free run, and what is seen of the error.

    Attributes
    ----------
    record : Record
    values : numpy.ndarray, shape (samples,)
        Free run.
    comparison : Comparison
    location : Location
    """

    record: Record
    values: np.ndarray
    comparison: Comparison
    location: Location


def compare_and_locate(
    records: list[Record],
    fit: Fit,
    floor: NoiseFloor | None,
    floor_from: str,
    seed: int,
    centre: bool = False,
) -> list[Simulated]:
    """Simulate a fitted model on every record, compare it, and see where it fails.

    Parameters
    ----------
    records : list of Record
    fit : Fit
    floor : NoiseFloor or None
        Noise floor of the record named `floor_from`.
    floor_from : str
    seed : int
        Seed of the intervals.
    centre : bool
        Whether the fit was made on records less their means.
    """
    found = []
    for number, record in enumerate(for_base(record, fit.structure.base) for record in records):
        offset, level = (float(record[role].mean()) if centre else 0.0 for role in ("input", "output"))
        values = fit.simulate(Motion.of(record, offset=offset)) + level
        source = "" if record.name == floor_from else floor_from
        comparison = compare_record(record, values, floor, source, seed=seed + number)
        found.append(Simulated(record, values, comparison, locate(record, values, floor, source)))
    return found


def least_explained(simulated: list[Simulated]) -> Simulated:
    """The record of whose output the model explains the smallest share."""
    return min(simulated, key=lambda item: item.comparison.vaf.value)
