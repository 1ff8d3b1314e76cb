"""Where a hand feels a model's error: over position and direction of the motion, and over frequency."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from lumbar.tables.described import described
from lumbar.tables.table import Table
from lumbar.tissue.diagnosis.residuals.locate import ResidualReport
from lumbar.tissue.diagnosis.residuals.residual import said
from lumbar.tissue.perception.felt import PHASES, Difference, Felt, Reach, force_difference
from lumbar.tissue.perception.thresholds import FASTEST_HZ

_DEPTHS = 5
"""Parts of the motion's range."""
_FEWEST_S = 0.2
"""Time that must be spent in a part of it."""
OVER_MOTION, OVER_FREQUENCY = "position and direction", "frequency"


def felt_where(report: ResidualReport) -> list[dict]:
    """Rows of the table: all of a record, its parts of position and direction, its octaves; none where the output is no force."""
    residual, record = report.location.residual, report.record
    measured = record["output"][-len(residual.values) :]
    noise = None if residual.floor is None else residual.floor.spectrum
    met = force_difference(
        measured,
        measured - residual.values,
        residual.unit,
        residual.position,
        residual.sampling_time,
        report.hands,
        noise,
    )
    if met is None:
        return []
    rows = [_row("all", "", met.felt.jnd, met.felt)]
    rows += [
        _row(OVER_MOTION, words, felt.jnd, felt) for words, felt in _over_motion(met, residual.position_unit)
    ]
    rows += [
        _row(OVER_FREQUENCY, f"{low:.3g} to {high:.3g} Hz", felt, None) for low, high, felt in _octaves(met)
    ]
    return [{"record": record.name, **row} for row in rows]


def _row(along: str, part: str, jnd: Reach, felt: Felt | None) -> dict:
    found = dict(zip(("felt_jnd", "felt_low", "felt_high"), jnd, strict=True))
    time = None if felt is None else felt.time_percent.value
    return {"along": along, "part": part or None, **found, "felt_time_percent": time}


def _over_motion(met: Difference, unit: str) -> Iterator[tuple[str, Felt]]:
    edges = np.linspace(met.position.min(), met.position.max(), _DEPTHS + 1)
    depth = np.clip(np.searchsorted(edges, met.position, side="right") - 1, 0, _DEPTHS - 1)
    for number in range(_DEPTHS):
        for name in PHASES:
            counts = (depth == number) & met.phase(name)
            if np.count_nonzero(counts) * met.sampling_time >= _FEWEST_S:
                words = f"{edges[number]:.3g} to {edges[number + 1]:.3g} {unit}, {name}"
                yield words, met.felt_where(counts)


def _octaves(met: Difference) -> Iterator[tuple[float, float, Reach]]:
    highest = min(FASTEST_HZ, 0.5 / met.sampling_time)
    for octave in range(int(np.ceil(np.log2(highest))) + 1):
        low, high = (2.0 ** (octave - 1) if octave else 0.0), min(2.0**octave, highest)
        if high > low:
            yield low, high, met.jnd_between(low, high)


def felt_table(reports: Sequence[ResidualReport], data: str) -> Table:
    """Where the error is felt on every record, as ``felt.csv`` publishes it."""
    rows = [row for report in reports for row in felt_where(report)]
    return described(__file__, "felt", rows, data)


def felt_sentence(report: ResidualReport) -> str:
    """Where a hand feels the error most; empty where nothing is felt, or the output is no force."""
    rows = felt_where(report)
    if not rows or rows[0]["felt_jnd"] == 0:
        return ""
    first, second = (
        max((row for row in rows if row["along"] == along), key=lambda row: row["felt_jnd"], default=None)
        for along in (OVER_MOTION, OVER_FREQUENCY)
    )
    return said("felt_most", whole=rows[0]["felt_jnd"], motion=first or rows[0], frequency=second or rows[0])


def located_sentences(report: Any) -> list[str]:
    """What is seen of a record's error, and along one axis what of it is felt, in plain English."""
    felt = "" if report.record.axes else felt_sentence(report)
    return [*report.sentences, *([felt] if felt else [])]
