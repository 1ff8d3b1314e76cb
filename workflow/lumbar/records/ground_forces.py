"""Ground reaction forces: what a force plate measured, and those in OpenSim's ``.mot`` files."""

import os
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.marker_axes import file_axis, rotation_to_standard
from lumbar.records.text_rows import check_even, read_rows
from lumbar.settings.layout import MarkerLayout

UNLOADED_N = 20.0
"""Vertical force below which a plate counts as unloaded: the centre of pressure is a ratio of noise there."""
_FORCE = re.compile(r"^(.*?)_?vx(_?\d*)$", re.IGNORECASE)
"""Name of a plate's first column: what stands before and after is the plate's name."""
_HEADER_CHARACTERS = 100_000


@dataclass(frozen=True, repr=False)
class ForcePlate:
    """What one force plate measured."""

    name: str
    """E.g. ``"plate 1"``."""
    time: np.ndarray
    """Shape (n,): seconds on the clock of the markers."""
    force: np.ndarray
    """Shape (n, 3): force of the ground on the person in newtons: lateral (right), forward, up."""
    centre_of_pressure: np.ndarray
    """Shape (n, 3): metres; NaN where less than `UNLOADED_N` press on the plate."""
    free_moment: np.ndarray
    """Shape (n,): moment about the vertical through the centre of pressure, in N·m; NaN as above."""
    rate: float
    """Samples per second."""
    corners: np.ndarray | None = None
    """Shape (4, 3), or None: metres; None where a file states none."""
    notes: tuple[str, ...] = ()
    """What was taken for granted or changed: a reversed sign, a baseline that was subtracted, a unit."""

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        largest = self.force[:, 2].max() if len(self) else 0
        return f"<ForcePlate {self.name}: {len(self)} samples at {self.rate:g} Hz, up to {largest:.0f} N>"


def read_mot(path: str | os.PathLike, layout: MarkerLayout) -> list[ForcePlate]:
    """Read the ground reaction forces of an OpenSim motion file.

    One plate per triple of columns ``…_vx``, ``…_vy``, ``…_vz`` with ``…_px`` and so on; none without any.

    Parameters
    ----------
    layout : MarkerLayout
        Axes; OpenSim's own are ``up: "+y", forward: "+x"``. Lengths are metres.

    Raises
    ------
    InputError
        No OpenSim header, a row that is cut short, no number, a clock that is not even, columns that lack their fellows,
        forces that do not push upwards.
    """
    path = Path(path)
    names, table = _table(path)
    if names[0].lower() != "time":
        raise InputError(f"{path}: the first column is {names[0]!r}; time is needed")
    time = table[:, 0]
    if len(time) < 2 or not time[-1] > time[0]:
        raise InputError(f"{path}: time does not increase; two instants or more are needed")
    rotation = rotation_to_standard(layout.up, layout.forward)
    rate = (len(time) - 1) / (time[-1] - time[0])
    check_even(path, time, np.linspace(time[0], time[-1], len(time)), rate)
    plates = []
    for found in filter(None, map(_FORCE.match, names)):
        stem, number = found.groups()
        force, point, torque = (
            _vectors(path, names, table, stem, kind, number) @ rotation.T for kind in ("v", "p", "torque")
        )
        unloaded = np.abs(force[:, 2]) < UNLOADED_N
        point[unloaded] = np.nan
        free = np.where(unloaded, np.nan, torque[:, 2])
        plates.append(ForcePlate(stem + number, time, force, point, free, rate))
    _check_upward(path, plates, rotation, layout)
    return plates


def names_forces(path: Path) -> bool:
    """Whether the header of a motion file names columns of ground reaction forces; joint angles have the same ending."""
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        lines = stream.read(_HEADER_CHARACTERS).splitlines()
    ends = [number for number, line in enumerate(lines) if line.strip().lower() == "endheader"]
    names = next((line.split() for line in lines[ends[0] + 1 :] if line.strip()), []) if ends else []
    return any(map(_FORCE.match, names))


def _check_upward(path: Path, plates: list[ForcePlate], rotation: np.ndarray, layout: MarkerLayout) -> None:
    """Raise when the ground does not push upwards on the whole: the axes are not those of the markers."""
    total = np.sum([plate.force.mean(axis=0) for plate in plates], axis=0)
    if plates and np.linalg.norm(total) > UNLOADED_N and total[2] <= np.abs(total[:2]).max():
        raise InputError(
            f"{path}: the forces push along {file_axis(total, rotation)}, but markers.up is {layout.up}; forces of the ground on "
            "the person are needed, in the axes of the markers: export both in the same"
        )


def _vectors(
    path: Path, names: list[str], table: np.ndarray, stem: str, kind: str, number: str
) -> np.ndarray:
    """Three columns of a plate, shape (n, 3); torques may be named after the plate or after the force."""
    columns = []
    for axis in "xyz":
        if kind == "torque":
            wanted = [f"{stem.replace('force', 'torque')}_{axis}{number}", f"{stem}_m{axis}{number}"]
        else:
            wanted = [f"{stem}_{kind}{axis}{number}", f"{stem}{kind}{axis}{number}"]
        present = [names.index(name) for name in wanted if name in names]
        if not present:
            raise InputError(f"{path}: no column {' or '.join(wanted)}; the file has {', '.join(names)}")
        columns.append(present[0])
    return table[:, columns]


def _table(path: Path) -> tuple[list[str], np.ndarray]:
    """Column names and numbers."""
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    ends = [number for number, line in enumerate(lines) if line.strip().lower() == "endheader"]
    rows = [(number, line.split()) for number, line in enumerate(lines, start=1) if line.strip()]
    rows = [row for row in rows if ends and row[0] > ends[0] + 1]
    if len(rows) < 2:
        raise InputError(
            f"{path}: no OpenSim motion file; a header that ends with 'endheader', a line of column names and "
            "rows of numbers are needed"
        )
    names = rows[0][1]
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    problems = Problems(str(path))
    if twice:
        problems.add(
            f"line {rows[0][0]}", f"{', '.join(twice)} stands twice", "every column needs its own name"
        )
    problems.raise_if_any()
    return names, read_rows(path, rows[1:], len(names), empty=False)
