"""Quantisation of the position: values that lie on the steps of a coarse encoder or converter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.sensors.roughness import Roughness

_ON_STEPS = 0.9
"""Share of the values that lie on steps."""
_WITHIN = 0.05
"""How far from a step a value may lie, in steps."""
_EXPLAINS = 3.0
"""Noise over that of the steps, up to which they explain it: at low speed it is coloured."""


@dataclass(frozen=True, eq=False)
class PositionStep:
    """Steps of a measured position."""

    step: float
    roughness: Roughness

    kind = "quantisation"

    def finding(self, record: Record) -> Finding:
        """Say how large the steps are."""
        channel = record.channels["input"]
        return Finding(
            self.kind,
            f"{record.name}: the {channel.quantity} is read in steps of {self.step:.3g} {channel.unit}; what lies above "
            f"{self.roughness.edge:.3g} Hz is taken off before fitting: use the sensor's full resolution",
            self.step,
            channel.unit,
            record.name,
        )

    def mended(self, record: Record) -> Record:
        """The record with the position as it is within the excitation's band."""
        return record.with_values(input=self.roughness.smooth)


def find_step(values: np.ndarray, noise: float) -> float | None:
    """Return the step of quantised values, where it explains noise of this size (step over √12), or None.

    Parameters
    ----------
    values : numpy.ndarray, shape (samples,)
    noise : float
        RMS.
    """
    levels, counts = np.unique(values, return_counts=True)
    often = levels[counts > 1] if np.mean(counts > 1) > 0.5 else levels
    gaps = np.diff(often)
    gaps = gaps[gaps > 1e-9 * np.ptp(values)]
    if not gaps.size:
        return None
    step = float(np.quantile(gaps, 0.1))
    near = gaps[np.abs(gaps / step - 1) < 2 * _WITHIN]
    step = float(near.mean())
    # The mean of many gaps is finer than the step's rounding; over the whole range it still has to count them right.
    step = float(np.ptp(often) / max(round(np.ptp(often) / step), 1))
    places = (values - often[0]) / step
    on_steps = np.mean(np.abs(places - np.round(places)) < _WITHIN)
    explains = noise <= _EXPLAINS * step / np.sqrt(12)
    return step if on_steps >= _ON_STEPS and explains else None
