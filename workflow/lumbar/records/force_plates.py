"""Force plates of a recording, whatever file holds them: metres and newtons in the axes of the markers."""

from __future__ import annotations

import os
from pathlib import Path

from lumbar.errors import InputError
from lumbar.records.c3d_force_plates import read_c3d_plates
from lumbar.records.force_plate import ForcePlate
from lumbar.records.mot_file import read_mot
from lumbar.settings.layout import MarkerLayout


def read_force_plates(path: str | os.PathLike, layout: MarkerLayout | None = None) -> list[ForcePlate]:
    """Read the force plates of a recording.

    Parameters
    ----------
    path : path
        C3D file, or OpenSim's ``.mot`` with ground reaction forces.
    layout : MarkerLayout, optional
        Axes and unit, as of the markers; a ``.mot`` file is in metres.

    Returns
    -------
    list of ForcePlate
        Empty where the file has none (C3D without plates, any other marker file).

    Raises
    ------
    InputError
        A file that is broken, a plate of another type, corners that are no rectangle, a channel or unit that is
        missing.
    """
    path, layout = Path(path), layout or MarkerLayout()
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.suffix.lower() == ".mot":
        return read_mot(path, layout)
    return read_c3d_plates(path, layout) if path.suffix.lower() == ".c3d" else []
