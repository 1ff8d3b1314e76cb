"""Sampling jitter: samples taken a little early or late, so that the position is off by speed times that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.sensors.excitation_band import within_band
from lumbar.tissue.diagnosis.sensors.roughness import Roughness

_FORCE_EDGE = 2.0
"""Edge of the force's band over that of the excitation: a nonlinear tissue answers at harmonics too."""
_SHARED = 5.0
"""Standard errors by which the force must be off by its own rate of change times the same times."""


@dataclass(frozen=True, eq=False)
class SamplingJitter:
    """A clock that jitters."""

    roughness: Roughness

    kind = "jitter"

    def finding(self, record: Record) -> Finding:
        """Say how large the jitter is."""
        found = self.roughness
        milliseconds = 1e3 * found.jitter
        moved = found.jitter * float(np.sqrt(np.mean(found.speed**2)))
        channel = record.channels["input"]
        return Finding(
            self.kind,
            f"{record.name}: samples are taken {milliseconds:.2g} ms RMS beside their times: the {channel.quantity} is off in "
            f"proportion to speed, by {moved:.2g} {channel.unit} RMS; what lies above {found.edge:.3g} Hz is taken off before "
            "fitting: let a hardware clock start the samples, or record their times",
            milliseconds,
            "ms",
            record.name,
        )

    def mended(self, record: Record) -> Record:
        """The record with the position within the excitation's band, and what the same jitter did to the force taken off.

        The times by which samples are off are r v / (v² + λ), with r what lies beyond the band and λ what its noise is
        worth; the force is off by its own rate of change times them, where it was sampled with the position.
        """
        found, step, force = self.roughness, record.sampling_time, record["output"]
        slack = 0.1 * np.mean(found.speed**2) + (found.noise / found.jitter) ** 2
        late = found.rough * found.speed / (found.speed**2 + slack)
        smooth = within_band(force, step, min(_FORCE_EDGE * found.edge, 0.39 / step))
        effect = late * np.gradient(smooth, step)
        rough = force - smooth
        beyond = effect - within_band(effect, step, min(_FORCE_EDGE * found.edge, 0.39 / step))
        gain = float(beyond @ rough / np.maximum(beyond @ beyond, 1e-300))
        error = float(np.std(rough - gain * beyond) / np.sqrt(np.maximum(beyond @ beyond, 1e-300)))
        shared = gain if gain > _SHARED * error else 0.0
        return record.with_values(input=found.smooth, output=force - shared * effect)
