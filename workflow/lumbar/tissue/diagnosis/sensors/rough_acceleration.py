"""Acceleration of which the force knows nothing: noise of a position, too small to be seen in it, that is large derived twice.

Where a mass is moved, force is mass times acceleration. Noise in the acceleration makes the mass come out too small, by its
share of the acceleration's power, and the interval with it. From the frequency on at which the force follows less than half of
the acceleration, the position is taken for noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.sensors.excitation_band import within_band
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.signals.spectral_edge import spectral_edge

_SEGMENTS = 12
_SHORTEST = 64
"""Samples of the shortest segment whose spectrum is taken."""
_BINS = 9
"""Neighbouring frequencies whose spectra are taken together."""
_BAND_POWER = 0.99
"""Share of the force's power within which the mass is told."""
_INERTIAL = 2.0
"""Factor by which the squared error grows without the mass from which on there is one."""
_FOLLOWED = 0.5
"""Share of the acceleration that the force follows within the band."""
_END = 8.0
"""Length at both ends, in periods of the edge, that stays as it is; over as much again what is taken off sets in."""
_MATTERS = 0.01
"""Share of the acceleration's power beyond the band from which on it moves a mass."""


@dataclass(frozen=True, eq=False)
class RoughAcceleration:
    """Acceleration beyond the band in which the force follows it."""

    edge: float
    """Hz."""
    share: float
    """Of the acceleration's power, beyond the edge."""

    kind = "rough_acceleration"

    def finding(self, record: Record) -> Finding:
        """Say how much of the acceleration is noise."""
        channel = record.channels["input"]
        return Finding(
            self.kind,
            f"{record.name}: {100 * self.share:.2g} % of the power of the {channel.quantity}'s second derivative lies above "
            f"{self.edge:.3g} Hz, where the {record.channels['output'].quantity} does not follow it: noise, which would make a "
            "mass come out too small by as much; it is taken off before fitting",
            self.edge,
            "Hz",
            record.name,
        )

    def mended(self, record: Record) -> Record:
        """The record with the position as it is within that band, and as it was at both ends.

        There what the filter adds is small beside the position, but not derived twice.
        """
        position, step = record["input"], record.sampling_time
        rough = position - within_band(position, step, self.edge)
        from_end = np.minimum(np.arange(len(position)), np.arange(len(position))[::-1])
        inside = np.clip(from_end * step * self.edge / _END - 1, 0, 1)
        return record.with_values(input=position - np.sin(0.5 * np.pi * inside) ** 2 * rough)


def find_rough_acceleration(record: Record) -> RoughAcceleration | None:
    """Return what of the acceleration the force does not follow; None where no mass is moved, or little of it is noise."""
    length = 2 ** int(np.log2(max(len(record) / _SEGMENTS, 1)))
    mass = _mass(record) if length >= _SHORTEST else None
    if mass is None:
        return None
    from scipy.signal import csd, welch

    rate = 1 / record.sampling_time
    acceleration, force = Motion.of(record).acceleration, record["output"]
    frequency, power = welch(acceleration, rate, nperseg=length)
    crossed = csd(acceleration, force, rate, nperseg=length)[1].real
    together = np.ones(_BINS) / _BINS
    followed = np.convolve(crossed, together, "same") / np.convolve(power, together, "same") / mass
    inside = np.flatnonzero(followed >= _FOLLOWED)
    if not inside.size or inside[-1] + 1 >= len(frequency):
        return None
    edge = frequency[inside[-1] + 1]
    share = float(power[frequency > edge].sum() / power.sum())
    return RoughAcceleration(float(edge), share) if share > _MATTERS else None


def _mass(record: Record) -> float | None:
    """Mass by which the force follows the acceleration, in the records' units; None where there is none."""
    force, step = record["output"], record.sampling_time
    edge = spectral_edge(force - force.mean(), _BAND_POWER) / step
    if 4 * edge * step > 1:
        return None
    smooth = within_band(record["input"], step, edge)
    speed = np.gradient(smooth, step)
    columns = np.column_stack([np.ones(len(force)), smooth, speed, np.gradient(speed, step)])
    fitted, errors = np.linalg.lstsq(columns, force, rcond=None)[:2]
    without = np.linalg.lstsq(columns[:, :-1], force, rcond=None)[1]
    moved = errors.size and without.size and fitted[-1] > 0 and without[0] > _INERTIAL * errors[0]
    return float(fitted[-1]) if moved else None
