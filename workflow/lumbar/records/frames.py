"""The frame of a force sensor that is mounted turned against the axes of the position, declared by a rotation vector."""

from collections.abc import Sequence

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.settings.layout import AXES


def rotate_forces(record: Record, rotation_vector_deg: Sequence[float] | None) -> Record:
    """Return a record of several axes with its forces in the axes of its position.

    Parameters
    ----------
    rotation_vector_deg : sequence of three float, or None
        Rotation R that takes a force in the sensor's axes to the position's, ``f_position = R f_sensor``, as a rotation vector:
        along the axis of rotation, as long as the angle in degrees, right-handed. R's columns are the sensor's axes in those of
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
    from scipy.spatial.transform import Rotation

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
    rotation = Rotation.from_rotvec(rotation_vector_deg, degrees=True).as_matrix()
    turned = rotation[np.ix_(chosen, chosen)] @ forces
    return record.with_values(**dict(zip(roles, turned, strict=True)))
