"""Wild samples of the force: single readings far outside the range of all others, as of a loose contact or a lost bit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding

_BESIDE = 7
"""Samples of the running median that a wild one is measured from."""
_MOST = 1e-3
"""Share of the samples that may be wild: what comes more often belongs to the force."""


@dataclass(frozen=True, eq=False)
class WildSamples:
    """Single samples of the force that no other one comes near."""

    samples: np.ndarray

    kind = "wild_samples"

    def finding(self, record: Record) -> Finding:
        """Say how many there are, how large, and where the first is."""
        channel, count = record.channels["output"], len(self.samples)
        worst = channel.values[self.samples]
        worst = float(worst[np.argmax(np.abs(worst))])
        are = "samples of the {} stand" if count > 1 else "sample of the {} stands"
        return Finding(
            self.kind,
            f"{record.name}: {count} single {are.format(channel.quantity)} outside the range of all others, the first at "
            f"{record.time[self.samples[0]]:.4g} s, the largest {worst:.3g} {channel.unit}; replaced from beside: look for a "
            "loose contact, or for readings that were lost on the way",
            count,
            "samples",
            record.name,
        )

    def mended(self, record: Record) -> Record:
        """The record with these samples on the straight line between their neighbours."""
        force = record["output"].copy()
        force[self.samples] = 0.5 * (force[self.samples - 1] + force[self.samples + 1])
        return record.with_values(output=force)


def find_wild(record: Record) -> WildSamples | None:
    """Return the wild samples of the force, or None.

    One is wild that lies further from the median of the seven samples about it than the medians of the whole record lie from
    one another. A force that jumps, or stands for more than a sample where it went, is none.
    """
    from scipy.ndimage import median_filter

    force = record["output"]
    smooth = median_filter(force, _BESIDE, mode="nearest")
    wild = np.flatnonzero(np.abs(force - smooth) > np.ptp(smooth))
    alone = wild[(wild > 0) & (wild < len(force) - 1)]
    if not len(alone) or len(alone) < len(wild) or len(wild) > max(1.0, _MOST * len(force)):
        return None
    return WildSamples(alone) if np.all(np.diff(alone) > 1) else None
