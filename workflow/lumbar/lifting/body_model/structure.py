"""The model of one trial: its parts, points and constants, and where everything stands in state and constants.

Pelvis, thorax and box are free rigid parts of six coordinates, points of the limbs have three; soft joints couple them.
Constants are places in the axes of a part (landmarks, markers without a name, joint centres, hands on the box) and
lengths. The abdomen is the line between the joints L5/S1 and T12/L1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from lumbar.lifting.body_model.rotations import cross_matrix, exponential


@dataclass(frozen=True)
class Structure:
    """What the unknowns are."""

    parts: tuple[str, ...]
    """Rigid ones."""
    points: tuple[str, ...]
    """Of the limbs."""
    places: tuple[tuple[str, str], ...]
    """Part and name of every constant place."""
    lengths: tuple[tuple[str, str], ...]
    """Pairs whose distance is a constant."""
    _place_index: dict[tuple[str, str], int] = field(init=False, repr=False)

    def __post_init__(self):
        object.__setattr__(self, "_place_index", {place: i for i, place in enumerate(self.places)})

    @property
    def size(self) -> int:
        """Number of coordinates at one instant."""
        return 6 * len(self.parts) + 3 * len(self.points)

    @property
    def constants(self) -> int:
        """Number of constants."""
        return 3 * len(self.places) + len(self.lengths)

    def of_part(self, part: str) -> slice:
        """Shift and turning of a part within the state."""
        start = 6 * self.parts.index(part)
        return slice(start, start + 6)

    def of_point(self, point: str) -> slice:
        """Coordinates of a point within the state."""
        start = 6 * len(self.parts) + 3 * self.points.index(point)
        return slice(start, start + 3)

    def of_place(self, part: str, name: str) -> slice:
        """Coordinates of a place within the constants."""
        start = 3 * self._place_index[part, name]
        return slice(start, start + 3)

    def of_length(self, pair: tuple[str, str]) -> slice:
        """A length within the constants."""
        start = 3 * len(self.places) + self.lengths.index(pair)
        return slice(start, start + 1)

    def names_of(self, part: str) -> list[str]:
        """Names of the constant places of a part."""
        return [name for owner, name in self.places if owner == part]


@dataclass(frozen=True)
class Unknowns:
    """Values of all unknowns."""

    rotations: Mapping[str, np.ndarray]
    """Dict of str to ndarray, shape (n, 3, 3): axes of each part as columns."""
    shifts: Mapping[str, np.ndarray]
    """Dict of str to ndarray, shape (n, 3): origin of each part, metres."""
    points: Mapping[str, np.ndarray]
    """Dict of str to ndarray, shape (n, 3)."""
    constants: np.ndarray
    """Shape (structure.constants,)."""

    def moved(self, structure: Structure, states: np.ndarray, constants: np.ndarray) -> Unknowns:
        """Return the unknowns after steps of shapes (n, size) and (constants,); parts are turned from the left."""
        rotations, shifts = {}, {}
        for part in structure.parts:
            step = states[:, structure.of_part(part)]
            shifts[part] = self.shifts[part] + step[:, :3]
            rotations[part] = exponential(step[:, 3:]) @ self.rotations[part]
        points = {name: self.points[name] + states[:, structure.of_point(name)] for name in structure.points}
        return Unknowns(rotations, shifts, points, self.constants + constants)

    def place(self, structure: Structure, part: str, name: str) -> np.ndarray:
        """Trajectory of a place of a part, shape (n, 3) in metres."""
        return self.shifts[part] + self.rotations[part] @ self.constants[structure.of_place(part, name)]


@dataclass(frozen=True)
class Position:
    """A trajectory with its derivatives."""

    value: np.ndarray
    """Shape (n, 3)."""
    states: list[tuple[slice, np.ndarray]]
    """Columns of the state and the derivative by them, shape (n, 3, k)."""
    constants: list[tuple[slice, np.ndarray]]
    """Columns of the constants and the derivative by them, shape (n, 3, k)."""


def position(structure: Structure, unknowns: Unknowns, part: str | None, name: str) -> Position:
    """Where a place of a part, or a point (part None), is."""
    if part is None:
        value = unknowns.points[name]
        return Position(
            value, [(structure.of_point(name), np.broadcast_to(np.eye(3), (len(value), 3, 3)))], []
        )
    turn, where = unknowns.rotations[part], structure.of_place(part, name)
    arm = turn @ unknowns.constants[where]
    moving = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), -cross_matrix(arm)], axis=2)
    return Position(unknowns.shifts[part] + arm, [(structure.of_part(part), moving)], [(where, turn)])
