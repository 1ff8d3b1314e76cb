"""Dropped samples: rows that were lost and whose times were written evenly all the same."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding

MOST_TOGETHER = 3
"""Samples lost in one place that are told; where more would fit better, a corner of the motion may be taken for them."""
_DEGREE = 5
_POINTS = 12
"""Points of the polynomial through a place, half of them on either side."""
_CLEAR = 100.0
"""Squared misfit, in those that are usual in the record, that is a jump."""
_CURED = 30.0
"""Times by which the squared misfit must fall when samples are put in."""
_FEWEST_STEPS = 0.03
"""Least travel per sample, in that of the whole record, at a place where loss is told."""


@dataclass(frozen=True, eq=False)
class DroppedSamples:
    """Places where samples are missing."""

    places: np.ndarray
    """Shape (places,): last sample before each."""
    missing: np.ndarray
    """Shape (places,)."""

    kind = "dropped_samples"

    def finding(self, record: Record) -> Finding:
        """Say how many samples were lost, and where the first is."""
        count = int(self.missing.sum())
        return Finding(
            self.kind,
            f"{record.name}: the motion jumps in {len(self.places)} place{'s' * (len(self.places) > 1)} by the travel of "
            f"{count} sample{'s' * (count > 1)}, first after {record.time[self.places[0]]:.4g} s: rows were lost though the "
            "clock goes on; they are put back in from beside: record time stamps where the samples are taken",
            count,
            "samples",
            record.name,
        )

    def mended(self, record: Record) -> Record:
        """The record with the lost samples put in by a cubic spline, and noted as filled; its clock goes on for longer."""
        from scipy.interpolate import make_interp_spline

        late = np.zeros(len(record), dtype=int)
        late[self.places + 1] = self.missing
        places = np.arange(len(record)) + np.cumsum(late)
        every = np.arange(places[-1] + 1)
        channels = {}
        for role, channel in record.channels.items():
            values = make_interp_spline(places, channel.values, k=3)(every)
            values[places] = channel.values
            channels[role] = replace(channel, values=values)
        filled = np.union1d(np.setdiff1d(every, places), places[list(record.filled)]).astype(int)
        time = record.time[0] + record.sampling_time * every
        return replace(record, time=time, channels=channels, filled=tuple(filled.tolist()))


def find_dropped(record: Record) -> DroppedSamples | None:
    """Return the places where the position jumps by whole samples' travel, or None.

    Through the samples on either side of every place a polynomial is laid, as they stand and as they would stand with one to
    `MOST_TOGETHER` samples missing between. A corner of the motion, a step or a spike fits neither way; a lost sample fits
    once it is put in.
    """
    from scipy.ndimage import maximum_filter1d, uniform_filter1d

    values = record["input"]
    if len(values) < 4 * _POINTS:
        return None
    half = _POINTS // 2
    travel = np.abs(np.diff(values))
    moving = uniform_filter1d(travel, _POINTS - 1)[half - 1 : -half + 1] > _FEWEST_STEPS * travel.mean()
    misfit = sum(np.convolve(values, column[::-1], "valid") ** 2 for column in _across(0))
    usual = np.median(misfit[moving]) + (1e-7 * np.ptp(values)) ** 2
    windows = np.flatnonzero((misfit > _CLEAR * usual) & moving)
    if not windows.size:
        return None
    around = values[windows[:, None] + np.arange(_POINTS)]
    put_in = np.array(
        [np.sum((around @ _across(missing).T) ** 2, axis=1) for missing in range(1, MOST_TOGETHER + 3)]
    )
    best, least = put_in.argmin(axis=0) + 1, put_in.min(axis=0)
    cured = np.zeros(len(misfit))
    cured[windows] = misfit[windows] / np.maximum(least, 1e-3 * usual)
    told = (cured[windows] > _CURED) & (best <= MOST_TOGETHER)
    told &= cured[windows] >= maximum_filter1d(cured, 2 * half - 1)[windows]
    return DroppedSamples(windows[told] + half - 1, best[told]) if told.any() else None


def _across(missing: int) -> np.ndarray:
    """What is at right angles to all polynomials through `_POINTS` samples, so many missing in their middle."""
    half = _POINTS // 2
    places = np.concatenate([np.arange(half), half + missing + np.arange(half)]).astype(float)
    places = (places - places.mean()) / np.ptp(places)
    return np.linalg.qr(np.vander(places, _POINTS, increasing=True))[0][:, _DEGREE + 1 :].T
