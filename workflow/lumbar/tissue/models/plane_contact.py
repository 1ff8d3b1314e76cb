"""Bases of a tool that is not fastened to the tissue and meets it at a plane surface, with friction along it.

Into the plane the force is that of a one-axis base with contact; along it friction grows with it:
F = f(s) (n + μ tanh(|v_t|/v_s) v_t/|v_t|), s = n·z − d the depth, v_t the velocity along the plane. The normal n points to
where the tissue is deeper.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.form import HandWritten
from lumbar.tissue.models.motion import Motion, SpatialMotion
from lumbar.tissue.models.parameter import LinearParameter, NonlinearParameter
from lumbar.tissue.models.symmetry import FARTHEST, signed, turn

_DEEPEST = 0.5
"""Share of the motion's range by which the surface may be moved from where it is given."""


@dataclass(frozen=True)
class PlaneContact:
    """A base with contact, the plane that it is met at, and how far a fit may move that."""

    base: Base
    """Of one axis, with contact."""
    axes: tuple[str, ...]
    frames: tuple[tuple[float, ...], ...]
    """One rotation matrix, row by row, whose first column is the normal."""
    depth: float
    """Of the surface along the normal."""
    reach: float
    """Length that a change of the depth is counted in."""

    @property
    def linear(self) -> tuple[LinearParameter, ...]:
        """Those of the base, and their friction."""
        return (
            *self.base.linear,
            *(
                replace(item, name=f"friction_of_{item.name}", symbol=f"mu_{item.symbol}")
                for item in self.base.linear
            ),
        )

    @property
    def nonlinear(self) -> tuple[NonlinearParameter, ...]:
        """Those of the base, the speed within which friction turns round, turns of the normal, and how far the plane is moved."""
        speed = NonlinearParameter(
            "smoothing_speed", "{x}/s", "speed", 0.01, 0.1, 2, (0.05, 3.0), symbol="v_s"
        )
        turns = [
            signed(f"turn_{number}", "rad", f"r_{number}", FARTHEST) for number in range(1, len(self.axes))
        ]
        return (*self.base.nonlinear, speed, *turns, signed("moved", "1", "delta", _DEEPEST))

    symmetry: ClassVar[str] = "plane"
    turning: ClassVar[tuple[NonlinearParameter, ...]] = ()
    """Parameters that a model of it has no need of: none."""

    def plane(self, nonlinear: np.ndarray) -> tuple[np.ndarray, float]:
        """Normal and depth of the surface at nonlinear parameters of the base."""
        frame = np.array(self.frames[0]).reshape(len(self.axes), -1)
        numbers = np.log(nonlinear[len(self.base.nonlinear) + 1 :])
        turns = numbers[:-1] if len(self.axes) == 2 else np.array([0.0, *numbers[:-1]])
        return (frame @ turn(turns))[:, 0], self.depth + self.reach * float(numbers[-1])

    def _pressed(self, motion: SpatialMotion, nonlinear: np.ndarray) -> Motion:
        """Motion into the surface."""

        def pressed() -> Motion:
            normal, depth = self.plane(nonlinear)
            position = normal @ motion.position.reshape(len(self.axes), -1) - depth
            return Motion(motion.time, position, motion.sampling_time)

        return motion.cache.compute_at("into the surface", nonlinear[len(self.base.nonlinear) + 1 :], pressed)

    def columns(self, motion: SpatialMotion, nonlinear: np.ndarray) -> list[np.ndarray]:
        """Forces along the axes, one after the other, of every linear parameter at size 1."""
        normal, _ = self.plane(nonlinear)
        own, speed = nonlinear[: len(self.base.nonlinear)], nonlinear[len(self.base.nonlinear)]
        into = self.base.columns(self._pressed(motion, nonlinear), own)
        velocity = motion.velocity.reshape(len(self.axes), -1)
        along = velocity - np.multiply.outer(normal, normal @ velocity)
        size = np.sqrt(np.sum(along**2, axis=0))
        direction = along * np.tanh(size / speed) / np.maximum(size, 1e-300)
        return [
            *(np.multiply.outer(normal, item).ravel() for item in into),
            *((item * direction).ravel() for item in into),
        ]

    def touching(self, motion: SpatialMotion, nonlinear: np.ndarray) -> np.ndarray:
        """Whether the tool touches the tissue, one axis after the other."""
        assert self.base.touching is not None
        own = nonlinear[: len(self.base.nonlinear)]
        return np.tile(self.base.touching(self._pressed(motion, nonlinear), own), len(self.axes))

    @cached_property
    def structural(self) -> Base:
        """The base that structures are made of."""
        return replace(
            self.base,
            name=f"{self.base.name} with a plane",
            linear=self.linear,
            nonlinear=self.nonlinear,
            state=(),
            hand_written=HandWritten(columns=self.columns, spatial=True),
            touching=self.touching,
            spatial=self,
        )

    def held(self, nonlinear: Sequence[float]) -> "PlaneContact":
        """The base with the plane where these parameters have moved it."""
        numbers = np.asarray(nonlinear)
        normal, depth = self.plane(numbers)
        return replace(self, frames=(tuple(frame_of(normal).ravel().tolist()),), depth=depth)


def frame_of(normal: np.ndarray) -> np.ndarray:
    """A rotation matrix whose first column is this direction."""
    matrix = np.column_stack([normal, np.eye(len(normal))])
    frame = np.linalg.qr(matrix)[0][:, : len(normal)]
    frame *= np.sign(frame[:, 0] @ normal)
    frame[:, -1] *= np.sign(np.linalg.det(frame))
    return frame
