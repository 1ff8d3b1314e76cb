"""Noise of the position: what lies beyond the excitation's band, moving or not, and the force does not follow."""

from __future__ import annotations

from dataclasses import dataclass

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.sensors.roughness import Roughness


@dataclass(frozen=True, eq=False)
class PositionNoise:
    """Noise in a measured position."""

    roughness: Roughness

    kind = "position_noise"

    def finding(self, record: Record) -> Finding:
        """Say how large the noise is."""
        channel, size = record.channels["input"], self.roughness.noise
        return Finding(
            self.kind,
            f"{record.name}: the {channel.quantity} carries noise of {size:.2g} {channel.unit} RMS, which the "
            f"{record.channels['output'].quantity} does not follow; what lies above {self.roughness.edge:.3g} Hz is taken "
            "off before fitting: a quieter sensor, or a filter before it, would do better",
            size,
            channel.unit,
            record.name,
        )

    def mended(self, record: Record) -> Record:
        """The record with the position as it is within the excitation's band."""
        return record.with_values(input=self.roughness.smooth)
