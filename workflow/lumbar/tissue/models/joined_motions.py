"""Motions of several records that one model is fitted to: each begins anew."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lumbar.tissue.models.motion import Motion


@dataclass(frozen=True, eq=False)
class JoinedMotions:
    """Motions one after the other, each on its own clock and with a path and a memory of its own."""

    parts: tuple[Motion, ...]
    """Sampled at the same interval."""

    def __len__(self) -> int:
        return sum(len(part) for part in self.parts)

    @property
    def sampling_time(self) -> float:
        """Seconds."""
        return self.parts[0].sampling_time

    @cached_property
    def time(self) -> np.ndarray:
        """Seconds since the start of each record."""
        return np.concatenate([part.time for part in self.parts])

    @cached_property
    def position(self) -> np.ndarray:
        """Positions, one record after the other."""
        return np.concatenate([part.position for part in self.parts])

    @cached_property
    def velocity(self) -> np.ndarray:
        """First derivative within each record."""
        return np.concatenate([part.velocity for part in self.parts])

    @cached_property
    def acceleration(self) -> np.ndarray:
        """Second derivative within each record."""
        return np.concatenate([part.acceleration for part in self.parts])

    @property
    def channels(self) -> dict[str, np.ndarray]:
        """What all records have beside input and output."""
        common = set.intersection(*(set(part.channels) for part in self.parts))
        return {
            name: np.concatenate([part.channels[name] for part in self.parts])
            for name in self.parts[0].channels
            if name in common
        }

    def scale(self, kind: str) -> float:
        """Largest size of a quantity in any of the records: see `lumbar.tissue.models.parameter.NonlinearParameter`."""
        return max(part.scale(kind) for part in self.parts)

    def split(self, signal: np.ndarray) -> list[np.ndarray]:
        """Cut a signal over all samples (first axis) into those of the records."""
        return np.split(signal, np.cumsum([len(part) for part in self.parts])[:-1])
