"""A model as a device meets it: force in newtons on sampled positions in metres, held from sample to sample."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

_SMALLEST_ANGLE = 1e-4


def all_angles(points: int = 2000) -> np.ndarray:
    """Angles ωT from near 0 to π: evenly spaced, and closer and closer towards 0, where slow relaxations lie."""
    slow = np.geomspace(_SMALLEST_ANGLE, np.pi / points, points // 4)
    return np.concatenate([slow[:-1], np.linspace(slow[-1], np.pi, points)])


@dataclass(frozen=True)
class SampledModel:
    """H(z) from sampled positions to the force that pushes back, held for one sampling time."""

    name: str
    numerator: np.ndarray
    denominator: np.ndarray
    """`numerator`, `denominator`: coefficients of z⁰, z⁻¹, …, in N/m; positive where the force is against the motion.
    Moving average and delays of whole samples are in them."""
    sampling_time: float
    """Seconds between two samples."""
    delay: float = 0.0
    """Seconds from a sample to the force that follows from it, less than `sampling_time`."""

    def response(self, angles: np.ndarray) -> np.ndarray:
        """H(exp(jθ)) at angles θ = ωT in radians, without `delay`; shape of `angles`, complex."""
        back = np.exp(-1j * np.asarray(angles))
        late = int(np.argmax(self.numerator != 0))  # a delay may be hundreds of zeros long
        numerator = np.polyval(self.numerator[late:][::-1], back) * back**late
        return numerator / np.polyval(self.denominator[::-1], back)

    @property
    def stable(self) -> bool:
        """Whether all poles lie inside the unit circle."""
        return bool((np.abs(np.roots(self.denominator)) < 1.0).all())

    def scaled(self, factor: float) -> SampledModel:
        """The model with its force times a factor."""
        return replace(self, numerator=factor * self.numerator)

    def late(self, seconds: float) -> SampledModel:
        """The model with its force later by this time."""
        whole, part = divmod(self.delay + seconds, self.sampling_time)
        if self.sampling_time - part < 1e-9 * self.sampling_time:
            whole, part = whole + 1, 0.0
        part = part if part > 1e-9 * self.sampling_time else 0.0
        return replace(self, numerator=np.concatenate([np.zeros(int(whole)), self.numerator]), delay=part)

    def every(self, samples: int) -> SampledModel:
        """The model in a loop that is slower by a whole factor: positions wait for `samples` steps of the model.

        The force is that of the first of these steps; the others follow with the same position.
        """
        if samples == 1:
            return self
        slow = samples * self.sampling_time
        if len(self.denominator) == 1:
            # Of the samples before a tick's first one, each `samples` have the position of one tick.
            numerator = np.add.reduceat(self.numerator, np.r_[0, 1 : len(self.numerator) : samples])
            return replace(self, numerator=numerator, sampling_time=slow)
        from scipy.signal import ss2tf, tf2ss

        length = max(len(self.numerator), len(self.denominator))
        padded = [np.pad(part, (0, length - len(part))) for part in (self.numerator, self.denominator)]
        a, b, c, d = tf2ss(*padded)
        held = sum((np.linalg.matrix_power(a, step) @ b for step in range(samples)), np.zeros_like(b))
        numerator, denominator = ss2tf(np.linalg.matrix_power(a, samples), held, c, d)
        return replace(self, numerator=numerator[0], denominator=denominator, sampling_time=slow)
