"""Compare and locate on a fitted model: its free run on every record."""

from __future__ import annotations

from lumbar.effects.motion import Motion
from lumbar.improvement.angle import for_base
from lumbar.improvement.compare import Comparison, compare_record
from lumbar.improvement.fitting import Fit
from lumbar.improvement.locate import Location, locate
from lumbar.improvement.noise_floor import NoiseFloor
from lumbar.records.record import Record


def compare_and_locate(
    records: list[Record],
    fit: Fit,
    floor: NoiseFloor | None,
    floor_from: str,
    seed: int,
    centre: bool = False,
) -> tuple[list[Comparison], list[Location]]:
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

    Returns
    -------
    list of Comparison
    list of Location
    """
    comparisons, locations = [], []
    for number, record in enumerate(for_base(record, fit.structure.base) for record in records):
        offset, level = (float(record[role].mean()) if centre else 0.0 for role in ("input", "output"))
        simulated = fit.simulate(Motion.of(record, offset=offset)) + level
        source = "" if record.name == floor_from else floor_from
        comparisons.append(compare_record(record, simulated, floor, source, seed=seed + number))
        locations.append(locate(record, simulated, floor, source))
    return comparisons, locations
