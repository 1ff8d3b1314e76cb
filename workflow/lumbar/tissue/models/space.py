"""Bases of tissue in space: with a matrix for each stiffness and viscosity, or with contact at a plane surface.

A force of the one-axis base of `SpatialBase`, for example ``k_e*z``, becomes K z with K = Σ kᵢ Pᵢ, kᵢ ≥ 0 and projections Pᵢ.
K is symmetric and positive semidefinite, so that the base is passive for all parameters. The number of kᵢ depends on the symmetry
of the tissue (Lai, Rubin and Krempl, Introduction to Continuum Mechanics, 2010, chapter 5; here for the tool's forces):

- isotropic: one for all directions;
- transversely isotropic: one along an axis, one perpendicular to it;
- orthotropic: one along each of three perpendicular axes, which all matrices share;
- full: one along each of three perpendicular axes, which differ between matrices.

A fit determines the axes as small rotations of a given frame.

`PlaneContact` is a base for a free tool: F = f(s) (n + μ tanh(|v_t|/v_s) v_t/|v_t|), with the force f of a one-axis base with
contact, the normal n into the tissue, the depth s = n·z − d and the velocity v_t along the plane.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from itertools import cycle
from typing import Any, ClassVar

import numpy as np
import scipy

from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.equation import CStep
from lumbar.tissue.models.form import Effect, Form, HandWritten, Place
from lumbar.tissue.models.motion import Motion, SpatialMotion
from lumbar.tissue.models.parameter import LinearParameter, NonlinearParameter
from lumbar.tissue.models.spatial_equation import SpatialEquation, element


class Symmetry(StrEnum):
    """Symmetry of the tissue."""

    ISOTROPIC = "isotropic"
    TRANSVERSE = "transversely isotropic"
    ORTHOTROPIC = "orthotropic"
    FULL = "full"


MAX_ROTATION_RAD = 1.2
"""Largest rotation of axes from the given frame, in radians."""
_MAX_COUPLING = 0.5  # largest fraction of one channel's force that another one may read
_MAX_SHIFT = 0.5  # largest shift of a plane, relative to the motion's range


def signed(name: str, unit: str, symbol: str, most: float) -> NonlinearParameter:
    """Return a parameter of either sign that starts at 0.

    Parameters
    ----------
    name, unit, symbol : str
        Fields of the parameter.
    most : float
        Largest size, in the parameter's unit.
    """
    ends = float(np.exp(-most)), float(np.exp(most))
    return NonlinearParameter(
        name, unit, "one", low=1.0, high=1.0, points=1, reach=ends, symbol=symbol, signed=True, decisive=True
    )


def turn(vector: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a rotation vector, shape (2, 2) or (3, 3), which rotates column vectors.

    Parameters
    ----------
    vector : numpy.ndarray, shape (1,) in the plane or (3,) in space
        Rotation in radians.
    """
    x, y, z = vector if len(vector) == 3 else (0.0, 0.0, vector[0])
    generator = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return scipy.linalg.expm(generator if len(vector) == 3 else generator[:2, :2])


@dataclass(frozen=True)
class SpatialBase:
    """A base of one axis, its symmetry in space, and the frames from which its principal axes are rotated."""

    base: Base
    """Base along one axis."""
    symmetry: Symmetry
    axes: tuple[str, ...]
    frames: tuple[tuple[float, ...], ...]
    """Rotation matrices, row by row, with principal axes as columns: one, or for a full base one per matrix."""
    free: bool = True
    """True if a fit rotates the axes; false if the axes of the frames are fixed."""

    @property
    def turns(self) -> int:
        """Number of angles that rotate one frame; two if a single axis matters."""
        if self.symmetry is Symmetry.ISOTROPIC:
            return 0
        return 2 if self.symmetry is Symmetry.TRANSVERSE else len(self.axes) * (len(self.axes) - 1) // 2

    @cached_property
    def form(self) -> Form:
        """The base's equation in space."""
        return self.base.form.to_space(self.axes)

    @property
    def equal_axes(self) -> dict[str, list[int]]:
        """Groups of principal axes with equal parameters, by the suffix of the parameters' names."""
        first, *others = every = list(range(len(self.axes)))
        if self.symmetry is Symmetry.ISOTROPIC:
            return {"": every}
        if self.symmetry is Symmetry.TRANSVERSE:
            return {"_along": [first], "_across": others}
        return {f"_{axis + 1}": [axis] for axis in every}

    @property
    def linear(self) -> tuple[LinearParameter, ...]:
        """Linear parameters of the base, one for each group of equal principal axes."""
        return tuple(
            replace(item, name=item.name + which, symbol=item.symbol + which)
            for item in self.base.linear
            for which in self.equal_axes
        )

    @property
    def nonlinear(self) -> tuple[NonlinearParameter, ...]:
        """Nonlinear parameters of the base, then the angles of every frame."""
        return (*self.base.nonlinear, *(self.turning if self.free else ()))

    @property
    def turning(self) -> tuple[NonlinearParameter, ...]:
        """The angles that rotate every frame."""
        several = len(self.frames) > 1
        return tuple(
            signed(
                f"turn_{number}" + f"_of_{owner.name}" * several,
                "rad",
                f"r_{number}" + owner.symbol * several,
                MAX_ROTATION_RAD,
            )
            for owner, _ in zip(self.base.linear, self.frames, strict=False)
            for number in range(1, self.turns + 1)
        )

    def frames_at(self, nonlinear: np.ndarray) -> list[np.ndarray]:
        """Return a matrix for every frame, shape (axes, axes), with the principal axes at nonlinear parameters as columns.

        Parameters
        ----------
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Parameters of the field `nonlinear`, as a fit searches them.
        """
        size = len(self.axes)
        given = [np.array(frame).reshape(size, size) for frame in self.frames]
        if not self.free or not self.turns:
            return given
        angles = np.log(nonlinear[len(self.base.nonlinear) :]).reshape(len(given), self.turns)
        if self.symmetry is Symmetry.TRANSVERSE:
            angles = np.concatenate([np.zeros((len(given), 1)), angles], axis=1)
        return [frame @ turn(angle) for frame, angle in zip(given, angles, strict=True)]

    def columns(self, motion: Motion, nonlinear: np.ndarray) -> list[np.ndarray]:
        """Return the forces of every linear parameter at size 1, one axis after the other, shape (axes × samples,) each.

        Parameters
        ----------
        motion : Motion
            Motion along the axes of the base.
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Parameters of the field `nonlinear`, as a fit searches them.
        """
        own_values = nonlinear[: len(self.base.nonlinear)]
        forces = motion.cache.compute_at(
            self.form.key, own_values, lambda: self.form.columns(motion, own_values)
        )
        columns = []
        for force, frame in zip(forces, cycle(self.frames_at(nonlinear)), strict=False):
            projected = frame.T @ force.reshape(len(frame), -1)
            columns += [(frame[:, axes] @ projected[axes]).ravel() for axes in self.equal_axes.values()]
        return columns

    def matrices(self, linear: np.ndarray, nonlinear: np.ndarray) -> dict[str, np.ndarray]:
        """Return the symmetric matrices, shape (axes, axes), by the name of the one-axis parameter and in its unit.

        Parameters
        ----------
        linear : numpy.ndarray, shape (linear parameters,)
            Linear parameters, in the order of the field `linear`.
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Parameters of the field `nonlinear`, as a fit searches them.
        """
        sizes = [len(axes) for axes in self.equal_axes.values()]
        values = np.repeat(linear.reshape(-1, len(sizes)), sizes, axis=1)
        items = zip(self.base.linear, values, cycle(self.frames_at(nonlinear)), strict=False)
        return {item.name: frame * along @ frame.T for item, along, frame in items}

    @cached_property
    def _c_step(self) -> CStep:
        """C code of the base: its equation with the elements of its matrices, computed at export."""
        equation = self.form.parsed_equation
        assert isinstance(equation, SpatialEquation)
        step = equation.c_step_by_matrices()

        def constants(parameters: Mapping[str, float], sampling_time: float) -> dict[str, float]:
            linear, nonlinear = (
                np.array([parameters[item.name] for item in items]) for items in (self.linear, self.nonlinear)
            )
            elements = {
                element(name, self.axes, row, column): float(matrix[row, column])
                for name, matrix in self.matrices(linear, nonlinear).items()
                for row, column in np.ndindex(matrix.shape)
            }
            return step.constants(parameters, sampling_time) | elements

        return replace(step, constants=constants)

    @cached_property
    def structural(self) -> Base:
        """The base for structures."""
        written = HandWritten(columns=self.columns, c_step=lambda: self._c_step, spatial=True)
        parameters = {"linear": self.linear, "nonlinear": self.nonlinear}
        name, equation = f"{self.symmetry} {self.base.name}", self.base.form.latex
        return _write_by_hand(self.base, self, written, name=name, equation=equation, **parameters)

    def freeze(self, nonlinear: np.ndarray) -> "SpatialBase":
        """Return the base with fixed frames, rotated by these parameters.

        Parameters
        ----------
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Parameters of the field `nonlinear`, as a fit searches them.
        """
        return self.replace_frames(self.frames_at(nonlinear), free=False)

    def replace_frames(self, frames: Sequence[np.ndarray], free: bool = True) -> "SpatialBase":
        """Return the base with other frames.

        Parameters
        ----------
        frames : sequence of numpy.ndarray, shape (axes, axes)
            Rotation matrices with the principal axes as columns.
        free : bool, optional
            True if a fit rotates the axes.
        """
        rows = tuple(tuple(frame.ravel().tolist()) for frame in frames)
        return SpatialBase(self.base, self.symmetry, self.axes, rows, free)


def symmetric_base(base: Base, axes: tuple[str, ...]) -> Base:
    """Return the base with general symmetric matrices, linear in their elements, for the start of a search of axes.

    Parameters
    ----------
    base : Base
        Base along one axis.
    axes : tuple of str
        Names of the axes.
    """
    form, size = base.form.to_space(axes), len(axes)
    places = [(row, column) for row in range(size) for column in range(row, size)]

    def columns(motion: Motion, nonlinear: np.ndarray) -> list[np.ndarray]:
        elements = []
        for force in motion.cache.compute_at(form.key, nonlinear, lambda: form.columns(motion, nonlinear)):
            vectors = force.reshape(size, -1)
            for row, column in places:
                forces = np.zeros_like(vectors)
                forces[row] = vectors[column]
                forces[column] = vectors[row]
                elements.append(forces.ravel())
        return elements

    linear = tuple(
        replace(item, name=f"{item.name}_{axes[row]}{axes[column]}", sign=0)
        for item in base.linear
        for row, column in places
    )
    written = HandWritten(columns=columns, spatial=True)
    return _write_by_hand(base, ("symmetric", axes), written, linear=linear)


def _write_by_hand(
    base: Base, spatial: Any, written: HandWritten, touching: Any = None, **fields: Any
) -> Base:
    """Return a base with a hand-written form in space."""
    form = replace(base.form, state=(), hand_written=written, **fields)
    return replace(base, form=form, spatial=spatial, touching=touching or base.touching)


def matrices_of(linear: np.ndarray, count: int, size: int) -> list[np.ndarray]:
    """Return the symmetric matrices of `symmetric_base`, each of shape (size, size), from the values of their elements.

    Parameters
    ----------
    linear : numpy.ndarray, shape (count * size * (size + 1) / 2,)
        Elements of the upper triangles, row by row, one matrix after the other.
    count, size : int
        Number of matrices; number of axes.
    """
    rows, columns = np.triu_indices(size)
    matrices = np.zeros((count, size, size))
    matrices[:, rows, columns] = matrices[:, columns, rows] = linear.reshape(count, -1)
    return list(matrices)


@dataclass(frozen=True)
class PlaneContact:
    """A base with contact at a plane; a fit may move the plane."""

    base: Base
    """Base along one axis, with contact."""
    axes: tuple[str, ...]
    frames: tuple[tuple[float, ...], ...]
    """One rotation matrix, row by row; the first column is the normal."""
    depth: float
    """Position of the surface along the normal."""
    reach: float
    """Unit of a change of `depth` in a fit, in the position's unit."""

    @property
    def linear(self) -> tuple[LinearParameter, ...]:
        """Linear parameters of the base, then the friction of each."""
        friction = (
            replace(item, name=f"friction_of_{item.name}", symbol=f"mu_{item.symbol}")
            for item in self.base.linear
        )
        return (*self.base.linear, *friction)

    @property
    def nonlinear(self) -> tuple[NonlinearParameter, ...]:
        """Nonlinear parameters: of the base, smoothing speed of the friction, rotations of the normal, shift of the plane."""
        speed = NonlinearParameter(
            "smoothing_speed", "{x}/s", "speed", low=0.01, high=0.1, points=2, reach=(0.05, 3.0), symbol="v_s"
        )
        turns = [
            signed(f"turn_{number}", "rad", f"r_{number}", MAX_ROTATION_RAD)
            for number in range(1, len(self.axes))
        ]
        return (*self.base.nonlinear, speed, *turns, signed("moved", "1", "delta", _MAX_SHIFT))

    symmetry: ClassVar[str] = "plane"
    turning: ClassVar[tuple[NonlinearParameter, ...]] = ()
    """Angles of frames: none."""

    def plane(self, nonlinear: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the unit normal into the tissue, shape (axes,), and the surface's position along the normal.

        Parameters
        ----------
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Parameters of the field `nonlinear`, as a fit searches them.
        """
        frame = np.array(self.frames[0]).reshape(len(self.axes), -1)
        numbers = np.log(nonlinear[len(self.base.nonlinear) + 1 :])
        turns = numbers[:-1] if len(self.axes) == 2 else np.array([0.0, *numbers[:-1]])
        return (frame @ turn(turns))[:, 0], self.depth + self.reach * float(numbers[-1])

    def _pressed(self, motion: SpatialMotion, nonlinear: np.ndarray) -> Motion:
        """Return the motion into the surface."""

        def project() -> Motion:
            normal, depth = self.plane(nonlinear)
            position = normal @ motion.position.reshape(len(self.axes), -1) - depth
            return Motion(motion.time, position, motion.sampling_time)

        return motion.cache.compute_at("into the surface", nonlinear[len(self.base.nonlinear) + 1 :], project)

    def columns(self, motion: SpatialMotion, nonlinear: np.ndarray) -> list[np.ndarray]:
        """Return the forces of every linear parameter at size 1, one axis after the other, shape (axes × samples,) each.

        Parameters
        ----------
        motion : SpatialMotion
            Motion along the axes of the base.
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Parameters of the field `nonlinear`, as a fit searches them.
        """
        normal, count = self.plane(nonlinear)[0], len(self.base.nonlinear)
        into = self.base.form.columns(self._pressed(motion, nonlinear), nonlinear[:count])
        velocity = motion.velocity.reshape(len(self.axes), -1)
        along = velocity - np.multiply.outer(normal, normal @ velocity)
        size = np.sqrt(np.sum(along**2, axis=0))
        direction = along * np.tanh(size / nonlinear[count]) / np.maximum(size, 1e-300)
        return [
            *(np.multiply.outer(normal, item).ravel() for item in into),
            *((item * direction).ravel() for item in into),
        ]

    def touching(self, motion: SpatialMotion, nonlinear: np.ndarray) -> np.ndarray:
        """Return contact of the tool at every sample (bool), shape (axes × samples,), equal for all axes.

        Parameters
        ----------
        motion : SpatialMotion
            Motion along the axes of the base.
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Parameters of the field `nonlinear`, as a fit searches them.
        """
        assert self.base.touching is not None
        pressed = self._pressed(motion, nonlinear)
        return np.tile(self.base.touching(pressed, nonlinear[: len(self.base.nonlinear)]), len(self.axes))

    @cached_property
    def structural(self) -> Base:
        """The base for structures."""
        written = HandWritten(columns=self.columns, spatial=True)
        parameters = {"linear": self.linear, "nonlinear": self.nonlinear}
        name = f"{self.base.name} with a plane"
        return _write_by_hand(self.base, self, written, self.touching, name=name, **parameters)

    def freeze(self, nonlinear: Sequence[float]) -> "PlaneContact":
        """Return the base with the plane moved by these parameters.

        Parameters
        ----------
        nonlinear : sequence of float
            Parameters of the field `nonlinear`, as a fit searches them.
        """
        normal, depth = self.plane(np.asarray(nonlinear))
        frame = tuple(frame_of(normal).ravel().tolist())
        return PlaneContact(self.base, self.axes, (frame,), depth, self.reach)


def frame_of(normal: np.ndarray) -> np.ndarray:
    """Return a rotation matrix with a given direction as first column, shape (axes, axes).

    Parameters
    ----------
    normal : numpy.ndarray, shape (axes,)
        Unit vector.
    """
    frame = np.linalg.qr(np.column_stack([normal, np.eye(len(normal))]))[0][:, : len(normal)]
    frame *= np.sign(frame[:, 0] @ normal)
    frame[:, -1] *= np.sign(np.linalg.det(frame))
    return frame


def force_sensor_effects(axes: tuple[str, ...]) -> dict[str, Effect]:
    """Return the effects of a force sensor of several axes, by name; these are not effects of tissue.

    Parameters
    ----------
    axes : tuple of str
        Names of the axes.
    """
    size = len(axes)
    pairs = [(row, column) for row in range(size) for column in range(size) if row != column]

    def effect(
        effect_name: str, mechanism: str, nonlinear: Sequence[NonlinearParameter], **fields: Any
    ) -> Effect:
        form = Form(place=Place.FRAME, nonlinear=tuple(nonlinear), axes=axes, **fields)
        source = "Calibration matrix of a multi-axis force sensor"
        return Effect(effect_name, mechanism, (form,), source, linear=True)

    angles = axes if size == 3 else ("",)
    effects = (
        effect(
            "turned_frame",
            "The force sensor's axes are turned from those of the position.",
            [signed(f"turn_{axis}".strip("_"), "rad", f"r_{axis}", MAX_ROTATION_RAD) for axis in angles],
            name="rotation",
            equation=r"F \to R F",
            hand_written=HandWritten(matrix=lambda nonlinear: turn(np.log(nonlinear)), spatial=True),
        ),
        effect(
            "crosstalk",
            "A channel of the force sensor reads a share of the force along another axis.",
            [
                signed(f"share_of_{axes[j]}_in_{axes[i]}", "1", f"c_{axes[i]}{axes[j]}", _MAX_COUPLING)
                for i, j in pairs
            ],
            name="couplings",
            equation=r"F \to (I + C) F",
            # Shares row by row, between the ones of the diagonal.
            hand_written=HandWritten(
                matrix=lambda nonlinear: np.insert(
                    np.log(nonlinear), range(0, size * (size - 1) + 1, size), 1.0
                ).reshape(size, size),
                spatial=True,
            ),
        ),
    )
    return {item.name: item for item in effects}
