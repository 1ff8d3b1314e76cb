"""Compare and locate on a fitted model: its free run on every record."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lumbar.base.progress import track
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.session import in_session
from lumbar.tissue.diagnosis.noise.noise_floor import NoiseFloor
from lumbar.tissue.diagnosis.residuals.compare import Comparison, compare_record
from lumbar.tissue.diagnosis.residuals.locate import Location, locate
from lumbar.tissue.models.measured_angle import for_base
from lumbar.tissue.models.motion import Motion


@dataclass(frozen=True, eq=False)
class Simulated:
    """A record beside a model's free run, and what is seen of the error."""

    record: Record
    values: np.ndarray
    """Shape (samples,): free run."""
    comparison: Comparison
    location: Location


def compare_and_locate(
    records: Sequence[Record],
    fit: Fit,
    floor: NoiseFloor | None,
    floor_from: str,
    seed: int,
    surface: float = 0.0,
    session: bool = False,
) -> list[Simulated]:
    """Simulate a fit on every record, compare it, and see where it fails.

    Parameters
    ----------
    records : list of Record
    floor, floor_from, seed
        As for `residual_reports`.
    surface : float
        Position that the fit counts positions from.
    session : bool
        Whether the records were cut from one session, in their order.
    """
    seen = [for_base(record, fit.structure.base) for record in records]
    return residual_reports(seen, simulation(seen, fit, surface, session), floor, floor_from, seed)


def simulation(
    records: Sequence[Record], fit: Fit, surface: float = 0.0, session: bool = False
) -> Callable[[Record], np.ndarray]:
    """A fit's free run as a function of the record; `records` as the fit's base asks for them, else as above."""

    def simulate(record: Record) -> np.ndarray:
        return fit.simulate(Motion.of(record, offset=surface))

    return in_session(records, simulate) if session else simulate


def residual_reports(
    records: list[Record],
    simulate: Callable[[Record], np.ndarray],
    floor: NoiseFloor | None,
    floor_from: str,
    seed: int,
) -> list[Simulated]:
    """Simulate any model on every record, compare it, and see where it fails.

    Parameters
    ----------
    simulate : callable
        From a record to the model's free run, shape (samples,).
    floor : NoiseFloor or None
        Noise floor of the record named `floor_from`.
    seed : int
        Seed of the intervals.
    """
    found = []
    for number, record in enumerate(track(records, "records compared and located")):
        values = simulate(record)
        source = "" if record.name == floor_from else floor_from
        comparison = compare_record(record, values, floor, source, seed=seed + number)
        found.append(Simulated(record, values, comparison, locate(record, values, floor, source)))
    return found


def least_explained(simulated: list[Simulated]) -> Simulated:
    """The record of whose output the model explains the smallest share."""
    return min(simulated, key=lambda item: item.comparison.vaf.value)
