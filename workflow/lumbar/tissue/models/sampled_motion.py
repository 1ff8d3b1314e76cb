"""Motion as a running loop knows it: sample by sample, nothing later."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lumbar.tissue.models.motion import Motion


@dataclass(frozen=True, eq=False)
class SampledMotion(Motion):
    """Motion whose derivatives are backward differences, both 0 at the first sample.

    Against the true derivative of a smooth motion the velocity is late by half a sample, the acceleration by a whole
    one. Attributes are those of `Motion`.
    """

    smooth: bool = False

    @classmethod
    def of_positions(cls, position: np.ndarray, sampling_time: float) -> SampledMotion:
        """Motion through these positions, shape (samples,), from time 0 on."""
        return cls(np.arange(len(position)) * sampling_time, position, sampling_time)

    @cached_property
    def velocity(self) -> np.ndarray:
        """Backward difference of the position."""
        return self.increments / self.sampling_time

    @cached_property
    def acceleration(self) -> np.ndarray:
        """Backward difference of the velocity."""
        return np.diff(self.velocity, prepend=0.0) / self.sampling_time

    def delayed(self, delay: float) -> SampledMotion:
        """Motion `delay` seconds ago, in straight lines between samples, at rest before the first one."""
        samples = delay / self.sampling_time
        whole = math.floor(samples)
        newer, older = (
            np.concatenate([np.full(min(late, len(self)), self.position[0]), self.position[: -late or None]])
            for late in (whole, whole + 1)
        )
        length = len(self)
        return self.replaced(newer[:length] + (samples - whole) * (older[:length] - newer[:length]))

    def through(self, moved: Callable[[Motion], np.ndarray]) -> SampledMotion:
        """Motion whose position is what `moved` makes of the samples, on the same clock."""
        return self.replaced(moved(self))

    def replaced(self, position: np.ndarray) -> SampledMotion:
        """Motion with another position, on the same clock."""
        return SampledMotion(self.time, position, self.sampling_time)
