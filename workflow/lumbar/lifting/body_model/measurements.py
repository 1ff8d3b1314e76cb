"""What ties the unknowns of the body model to a recording and to each other: markers, soft joints, constant lengths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.lifting.body_model.information import Noise
from lumbar.lifting.body_model.structure import Position, Structure, Unknowns, position

Where = tuple[str | None, str]
"""Part and place, or None and a point."""
ROBUST_DEGREES = 4.0
"""Degrees of freedom of Student's t, by which residuals are weighted before outliers are known."""
OUTLIER = 6.0
"""Standard deviations, as a distance in space, from which a marker is another one or elsewhere."""
OUTLIER_M = 0.025
"""Nothing nearer than this is left out."""
LAG_S = 0.1
"""Lag at which the correlation of a residual is read: noise of single frames has gone, skin is still displaced."""
PRIOR_SAMPLES = 6.0
"""Independent samples that the declared standard deviation counts as much as."""


@dataclass(frozen=True)
class Measurement:
    """One marker, soft joint or constant length, at every instant."""

    name: str
    first: Where
    """What is measured."""
    second: Where | None
    """What its place or distance is measured from; None for a marker."""
    observed: np.ndarray | None
    """Shape (n, 3), or None: of a marker, metres."""
    length: tuple[str, str] | None
    """The constant length, of a distance."""
    seen: np.ndarray
    """Shape (n,)."""
    sd: float
    """Declared standard deviation per axis, metres."""
    correlation_s: float
    """Declared time over which its error stays; 0 for none."""
    estimated: bool
    """Whether the residuals tell its standard deviation too."""

    @property
    def axes(self) -> int:
        """Number of values at one instant."""
        return 1 if self.length else 3

    def residual(self, structure: Structure, unknowns: Unknowns) -> tuple[np.ndarray, Position]:
        """Measured less predicted, shape (n, m), and the prediction's derivatives."""
        first = position(structure, unknowns, *self.first)
        if self.second is None:
            return self.observed - first.value, first
        second = position(structure, unknowns, *self.second)
        apart = first.value - second.value
        states = first.states + [(where, -values) for where, values in second.states]
        constants = first.constants + [(where, -values) for where, values in second.constants]
        if self.length is None:
            return -apart, Position(apart, states, constants)
        distance = np.linalg.norm(apart, axis=1, keepdims=True)
        along = (apart / distance)[:, None, :]
        where = structure.of_length(self.length)
        states = [(at, along @ values) for at, values in states]
        constants = [(at, along @ values) for at, values in constants]
        constants.append((where, np.full((len(distance), 1, 1), -1.0)))
        return unknowns.constants[where] - distance, Position(distance, states, constants)

    def robust_weight(self, residual: np.ndarray) -> np.ndarray:
        """Weights of Student's t, shape (n,); 0 where nothing is measured."""
        size = np.sum(np.where(self.seen[:, None], residual, 0.0) ** 2, axis=1) / self.sd**2
        weight = (ROBUST_DEGREES + self.axes) / (ROBUST_DEGREES + size)
        return np.where(self.seen, np.minimum(weight, 1.0), 0.0)

    def declared(self, step: float) -> Noise:
        """Noise as declared, at a time step in seconds."""
        phi = float(np.exp(-step / self.correlation_s)) if self.correlation_s else 0.0
        return Noise(self.sd, phi)

    def noise(self, residual: np.ndarray, kept: np.ndarray, step: float, freedom: float) -> Noise:
        """Noise from residuals and the declared one, weighed by the independent samples there are.

        Parameters
        ----------
        residual : ndarray, shape (n, m)
        kept : ndarray, shape (n,)
            Frames that count.
        step : float
            Seconds.
        freedom : float
            Share of the measured values that the poses do not follow.
        """
        declared = self.declared(step)
        if not self.estimated or kept.sum() < 10:
            return declared
        values = residual[kept]
        variance = np.mean(values**2) / freedom
        lag = max(1, round(LAG_S / step))
        both = kept[lag:] & kept[:-lag]
        power = np.mean(values**2)
        alike = np.mean(residual[lag:][both] * residual[:-lag][both]) / power if both.any() and power else 0.0
        phi = float(np.clip(alike, 0.0, 0.98)) ** (1 / lag) if alike > 0.05 else 0.0
        phi = min(phi, float(np.exp(-step / 2.0)))
        samples = len(values) * (1 - phi) / (1 + phi)
        pooled = (samples * variance + PRIOR_SAMPLES * self.sd**2) / (samples + PRIOR_SAMPLES)
        return Noise(float(np.sqrt(pooled)), phi)

    def inliers(self, residual: np.ndarray, sd: float) -> np.ndarray:
        """Frames of a marker that are seen and no outliers, one frame beside them left out too."""
        far = np.linalg.norm(np.where(self.seen[:, None], residual, 0.0), axis=1)
        out = far > max(OUTLIER * sd, OUTLIER_M)
        out[1:] |= out[:-1].copy()
        out[:-1] |= out[1:].copy()
        return self.seen & ~out
