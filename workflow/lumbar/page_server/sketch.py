"""A record in a line, as it is drawn while its diagnosis is made: a few hundred points, no library."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.records.record import Record

WIDTH, HEIGHT = 1000, 120
_COLUMNS = 500


@dataclass(frozen=True)
class Sketch:
    """The measured output of a record over time."""

    words: str
    """Record, quantity, range and duration."""
    points: str
    """Of an SVG polyline in a box of `WIDTH` by `HEIGHT`."""

    @classmethod
    def of(cls, record: Record) -> Sketch:
        """Draw the least and the largest value of each of `_COLUMNS` stretches of time."""
        channel = record.channels["output"]
        values = channel.values
        stretches = np.array_split(values, min(_COLUMNS, len(values)))
        ends = np.array([(part.min(), part.max()) for part in stretches])
        low, high = float(ends.min()), float(ends.max())
        across = np.repeat((np.arange(len(ends)) + 0.5) * WIDTH / len(ends), 2)
        up = HEIGHT * (1 - (ends.ravel() - low) / ((high - low) or 1.0))
        points = " ".join(f"{x:.0f},{y:.1f}" for x, y in zip(across, up, strict=True))
        words = (
            f"{record.name}: {channel.quantity} from {low:.3g} to {high:.3g} {channel.unit} "
            f"in {record.duration:.3g} s"
        )
        return cls(words, points)
