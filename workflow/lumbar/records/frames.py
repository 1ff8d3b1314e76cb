"""The frame of a force sensor that is mounted turned against the axes of the position, declared by a rotation vector."""

from collections.abc import Sequence

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.settings.layout import AXES


def rotation_matrix(rotation_vector_deg: Sequence[float]) -> np.ndarray:
    """Rotation about a vector by its length in degrees, right-handed (Rodrigues): shape (3, 3).

    Examples
    --------
    >>> (rotation_matrix([0, 0, 90]) @ [1, 0, 0]).round(9).tolist()
    [0.0, 1.0, 0.0]
    """
    vector = np.radians(rotation_vector_deg)
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / (angle or 1.0)
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * across + 2 * np.sin(angle / 2) ** 2 * across @ across


def with_force_frame(record: Record, rotation_vector_deg: Sequence[float] | None) -> Record:
    """Return a record of several axes with its forces in the axes of its position.

    Parameters
    ----------
    rotation_vector_deg : sequence of three float, or None
        Rotation R that takes a force in the sensor's axes to the position's, ``f_position = R f_sensor``, as a rotation vector:
        along the axis of rotation, as long as the angle in degrees, right-handed. Its columns are the sensor's axes in those of
        the position. None: they are the same.

    Raises
    ------
    InputError
        If a record of one axis is to be turned, or one of two axes out of their plane.
    """
    if rotation_vector_deg is None or not any(rotation_vector_deg):
        return record
    if not record.axes:
        raise InputError(f"{record.name}: has one axis; tissue.force_frame turns the forces of several")
    chosen = [AXES.index(axis) for axis in record.axes]
    out_of_plane = [AXES[at] for at in chosen if len(chosen) < len(AXES) and rotation_vector_deg[at]]
    if out_of_plane:
        normal = next(axis for axis in AXES if axis not in record.axes)
        raise InputError(
            f"{record.name}: tissue.force_frame turns about {' and '.join(out_of_plane)}, but the record has the axes "
            f"{' and '.join(record.axes)}; only its component along {normal} may differ from 0"
        )
    roles = record.roles(
        "input" if record.channels[record.roles("input")[0]].quantity == "force" else "output"
    )
    forces = np.stack([record[role] for role in roles])
    turned = rotation_matrix(rotation_vector_deg)[np.ix_(chosen, chosen)] @ forces
    return record.with_values(**dict(zip(roles, turned, strict=True)))
