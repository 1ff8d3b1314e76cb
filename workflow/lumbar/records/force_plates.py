"""Force plates of a recording, whatever file holds them: metres and newtons in the axes of the markers."""

from __future__ import annotations

import os
from pathlib import Path

from lumbar.base.errors import InputError
from lumbar.records.c3d_force_plates import read_c3d_plates
from lumbar.records.force_plate import ForcePlate
from lumbar.records.mot_file import read_mot
from lumbar.records.unpacking import ending_of, unpacked
from lumbar.settings.layout import MarkerLayout


def read_force_plates(path: str | os.PathLike, layout: MarkerLayout | None = None) -> list[ForcePlate]:
    """Read the force plates of a recording.

    Parameters
    ----------
    path : path
        C3D file, or OpenSim's ``.mot`` with ground reaction forces, also packed (``.gz``).
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
    ending = ending_of(path)
    if ending not in (".mot", ".c3d"):
        return []
    with unpacked(path) as plain:
        return read_mot(plain, layout) if ending == ".mot" else read_c3d_plates(plain, layout)
