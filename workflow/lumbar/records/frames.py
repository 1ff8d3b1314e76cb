"""Frame of a force sensor that is mounted at an angle to the axes of the position, declared as a rotation vector."""

from collections.abc import Sequence

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.settings.layout import AXES


def rotate_forces(record: Record, rotation_vector_deg: Sequence[float] | None) -> Record:
    """Return a record of several axes with its forces in the axes of its position.

    Parameters
    ----------
    record : Record
        Forces in the sensor's axes.
    rotation_vector_deg : sequence of three float, or None
        Rotation R from the sensor's axes to the position's, ``f_position = R f_sensor``: along the axis of rotation, its length
        the angle in degrees, right-handed. R's columns are the sensor's axes in those of the position. None: no rotation.

    Raises
    ------
    InputError
        If the record has one axis, or two axes and the rotation leaves their plane.
    """
    if rotation_vector_deg is None or not any(rotation_vector_deg):
        return record
    if not record.axes:
        raise InputError(f"{record.name}: has one axis; tissue.force_frame turns the forces of several")
    from scipy.spatial.transform import Rotation

    chosen = [AXES.index(axis) for axis in record.axes]
    out_of_plane = [AXES[index] for index in chosen if rotation_vector_deg[index]]
    if out_of_plane and len(chosen) < len(AXES):
        normal = next(axis for axis in AXES if axis not in record.axes)
        raise InputError(
            f"{record.name}: tissue.force_frame turns about {' and '.join(out_of_plane)}, but the record has the axes "
            f"{' and '.join(record.axes)}; only its component along {normal} may differ from 0"
        )
    is_input = record.channels[record.roles("input")[0]].quantity == "force"
    side = "input" if is_input else "output"
    roles, forces = record.roles(side), record.stacked(side)
    rotation = Rotation.from_rotvec(rotation_vector_deg, degrees=True).as_matrix()
    rotated = rotation[np.ix_(chosen, chosen)] @ forces
    return record.with_values(**dict(zip(roles, rotated, strict=True)))
