"""C3D marker files, through the c3d package after `lumbar.records.c3d_structure` has found them sound.

The c3d package reads Intel, DEC and MIPS files and recordings of any length, and being Python it cannot end
the process. Its last frame is compared with the bytes of the file: a reader that miscounts frames or analog
samples is off there most.
"""

from __future__ import annotations

import itertools
import os
import warnings
from pathlib import Path

import numpy as np

from lumbar.errors import InputError
from lumbar.records.c3d_structure import C3dStructure, check_structure, last_frame
from lumbar.records.marker_file import MarkerFile, mark_missing
from lumbar.records.point_kinds import split_points

_AGREEMENT = 1e-5
"""Largest difference to the bytes of the file, relative to the coordinate: single precision."""
_KINDS = {
    "ANGLES": "joint angle, not a position",
    "FORCES": "force, not a position",
    "MOMENTS": "moment, not a position",
    "POWERS": "power, not a position",
    "SCALARS": "computed number, not a position",
    "REACTIONS": "reaction, not a position",
}


def read_c3d(path: str | os.PathLike) -> MarkerFile:
    """Read the points of a C3D file.

    Parameters
    ----------
    path : path

    Returns
    -------
    MarkerFile
        Time counts from the system's first frame, so that a recording that was trimmed keeps its clock.

    Raises
    ------
    InputError
        The file is broken, cut short or contradicts itself, or what is read is not what its bytes hold.
    """
    path = Path(path)
    structure = check_structure(path)
    points = _coordinates(path, structure)
    labels = _labels(structure)
    return split_points(
        source=str(path),
        time=(structure.first_frame - 1 + np.arange(structure.n_frames)) / structure.rate,
        rate=structure.rate,
        unit=(structure.parameters.get("POINT:UNITS") or [""])[0],
        labels=labels,
        points=mark_missing(points),
        listed=_listed_kinds(structure),
    )


def _coordinates(path: Path, structure: C3dStructure) -> np.ndarray:
    """Coordinates in the file's unit, shape (n_frames, n_points, 3); NaN where the residual is negative."""
    import c3d

    try:
        with warnings.catch_warnings(), path.open("rb") as stream:
            # The package warns of labels and of analog parameters that the points do not need.
            warnings.simplefilter("ignore")
            values = np.array(
                [points for _, points, _ in c3d.Reader(stream).read_frames(copy=True)], dtype=float
            )
    except Exception as error:
        # The package raises whatever its parser stumbles over.
        raise InputError(
            f"{path}: the c3d package cannot read the file ({error}); export it again"
        ) from error
    announced = (structure.n_frames, structure.n_points)
    if values.shape[:2] != announced:
        raise InputError(f"{path}: {values.shape[:2]} frames and points were read; {announced} are announced")
    points, valid = values[..., :3], values[..., 3] >= 0
    from_bytes = last_frame(path, structure)
    if not np.allclose(points[-1, valid[-1]], from_bytes[valid[-1]], rtol=_AGREEMENT, atol=0):
        raise InputError(
            f"{path}: the c3d package reads other coordinates than the file holds; export it again"
        )
    return np.where(valid[..., None], points, np.nan)


def _labels(structure: C3dStructure) -> list[str]:
    """One label per point; lists of more than 255 continue in LABELS2, LABELS3 and so on."""
    parameters = structure.parameters
    names = ["POINT:LABELS", *(f"POINT:LABELS{number}" for number in range(2, 256))]
    lists = [parameters[name] for name in itertools.takewhile(parameters.__contains__, names)]
    labels = list(itertools.chain.from_iterable(lists))[: structure.n_points]
    return labels + [""] * (structure.n_points - len(labels))


def _listed_kinds(structure: C3dStructure) -> dict[str, str]:
    """Labels listed as angles, forces, …: by POINT:TYPE_GROUPS, and by the lists of the usual names."""
    parameters = structure.parameters
    kinds = dict(_KINDS)
    for group in parameters.get("POINT:TYPE_GROUPS", [])[::2]:
        kinds.setdefault(group.upper(), f"listed under POINT:{group}, not a position")
    listed = {}
    for group, reason in kinds.items():
        names = [f"POINT:{group}", *(f"POINT:{group}{number}" for number in range(2, 10))]
        for name in itertools.takewhile(parameters.__contains__, names):
            listed.update(dict.fromkeys(filter(None, map(str, parameters[name])), reason))
    return listed
