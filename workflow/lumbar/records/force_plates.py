"""Force plates of a recording: those of a C3D file, of types 1 to 4, from their signals, others as their file has them.

A plate's own axes follow from its corners: x from corner 2 to 1, y from corner 4 to 1, z = x × y, down. Type 2 and 4 measure
a force and the moment about an origin below the surface, type 3 (Kistler) has eight forces at four posts, type 1 states
the centre of pressure itself. The ground cannot pull: where a file holds the force of the person on the plate, it is
reversed, and noted.
"""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from lumbar.base.confined import confined
from lumbar.base.errors import InputError
from lumbar.base.files import require_file
from lumbar.records.c3d_file import AnalogChannels, analog_channels
from lumbar.records.c3d_structure import check_structure
from lumbar.records.ground_forces import UNLOADED_N, ForcePlate, read_mot
from lumbar.records.marker_axes import rotation_to_standard
from lumbar.records.markers import METRES, metres_per_unit
from lumbar.records.stretches import flat_tops
from lumbar.records.unpacking import ending_of, read_readable
from lumbar.settings.layout import MarkerLayout

_CLEARLY_LOADED_N = 100.0
"""Vertical force from which on its sign says which way the file counts it."""
_LEVEL = 0.5
"""Smallest vertical part of a plate's z axis: walls and handles are no floor."""
_SQUARENESS = 0.02
"""Largest cosine between two sides of a plate, and largest square of the gap between them in areas."""
_RANGE_ENDS = 0.9
"""Share of the largest size of a channel's signal from which on a limit is one of the converter: at rest signals repeat too."""
_CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6}
"""Analog channels by type of plate."""
_FORCE_UNITS = {"n": 1.0, "nt": 1.0, "newton": 1.0, "newtons": 1.0, "kn": 1e3, "lb": 4.4482216152605}
_MOMENT_UNITS = {"nmm": 1e-3, "ntmm": 1e-3, "ncm": 1e-2, "nm": 1.0, "ntm": 1.0, "newtonmeters": 1.0}
_QUANTITIES = {1: "FFFLLM", 2: "FFFMMM", 3: "FFFFFFFF"}
"""Force, length or moment, by type of plate and channel."""
_Wrench = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Force (n, 3), centre of pressure from the middle of the surface (n, 2) and free moment (n,) in a plate's axes."""


@dataclass(frozen=True)
class _Plate:
    """What FORCE_PLATFORM says of one plate: lengths in metres, axes of the file."""

    place: str
    kind: int
    corners: np.ndarray
    origin: np.ndarray
    channels: tuple[int, ...]
    calibration: np.ndarray | None
    metres: float
    notes: list[str] = field(default_factory=list)

    @property
    def axes(self) -> np.ndarray:
        """Axes of the plate as columns, shape (3, 3)."""
        x, y = self.corners[0] - self.corners[1], self.corners[0] - self.corners[3]
        z = np.cross(x, y)
        columns = [x, np.cross(z, x), z]
        return np.transpose([column / np.linalg.norm(column) for column in columns])

    def signals(self, channels: AnalogChannels) -> np.ndarray:
        """Channels of the plate in N, N·m and (type 1) m, less the baseline; shape (n, 6 or 8)."""
        values = channels.read(self.channels)
        self.notes.extend(self._clipped(values, channels))
        if self.calibration is not None:
            values = values @ self.calibration.T
            factors = [1.0] * 3 + [self.metres] * 3
            self.notes.append(
                "moments are in newtons times the file's unit of length, as FORCE_PLATFORM:CAL_MATRIX has it"
            )
        else:
            each = enumerate(zip(self.channels, _QUANTITIES[self.kind], strict=True), 1)
            factors = [self._factor(channel, what, channels.units[at]) for channel, (at, what) in each]
        return self._without_baseline(values * factors, channels)

    def _clipped(self, values: np.ndarray, channels: AnalogChannels) -> list[str]:
        """Channels that stay at the largest size they reach: a converter's range ends at about the same on both sides."""
        quantities = _QUANTITIES.get(self.kind, "F" * 6)
        notes = []
        for channel, quantity, own in zip(self.channels, quantities, values.T, strict=True):
            tops = [top for top in flat_tops(own) if abs(top.level) > _RANGE_ENDS * np.abs(own).max()]
            if tops and quantity != "L":
                levels = " or ".join(f"{top.level:.6g} {channels.units[channel]}".rstrip() for top in tops)
                notes.append(
                    f"channel {channel + 1} ({channels.labels[channel]}) is clipped: {sum(top.samples for top in tops)} "
                    f"samples lie exactly at {levels}; what exceeded it is lost: record with a larger range"
                )
        return notes

    def _factor(self, channel: int, quantity: str, unit: str) -> float:
        """Factor to N, m or N·m."""
        word = re.sub(r"[\s.*·-]", "", unit).lower()
        if quantity == "L":
            # The user guide has no unit of its own for these two: systems write that of the forces beside them.
            return METRES.get(word, self.metres)
        known = _FORCE_UNITS if quantity == "F" else _MOMENT_UNITS
        if word in known:
            return known[word]
        if not word or (quantity == "M" and self.kind == 1):
            taken = "newtons" if quantity == "F" else "newtons times the file's unit of length"
            self.notes.append(f"channel {channel} states the unit {unit!r}; {taken} were taken")
            return 1.0 if quantity == "F" else self.metres
        raise InputError(
            f"{self.place}: channel {channel} is in {unit!r}; allowed are {', '.join(known)}: export scaled forces"
        )

    def _without_baseline(self, signals: np.ndarray, channels: AnalogChannels) -> np.ndarray:
        """Subtract the mean over the frames of FORCE_PLATFORM:ZERO, where the plate was unloaded in them."""
        zero = channels.structure.parameters.get("FORCE_PLATFORM:ZERO", [])
        if self.kind == 1 or len(zero) < 2 or not 1 <= zero[0] < zero[1] <= channels.structure.n_frames:
            return signals
        stretch = signals[(int(zero[0]) - 1) * channels.per_frame : int(zero[1]) * channels.per_frame]
        vertical = stretch[:, 2] if self.kind != 3 else stretch[:, 4:].sum(axis=1)
        baseline = float(np.median(vertical))
        where = f"over frames {int(zero[0])} to {int(zero[1])} (FORCE_PLATFORM:ZERO)"
        if np.abs(vertical).max() > 2 * UNLOADED_N:
            self.notes.append(f"no baseline was subtracted: {abs(baseline):.0f} N stand on the plate {where}")
            return signals
        self.notes.append(f"the mean {where}, {abs(baseline):.1f} N, was subtracted")
        return signals - stretch.mean(axis=0)

    def turned(self, wrench: _Wrench, rotation: np.ndarray) -> _Wrench:
        """Force, centre of pressure and free moment in the axes of the markers, where the ground pushes."""
        (force, beside, free), axes = wrench, rotation @ self.axes
        if axes[2, 2] > -_LEVEL:
            raise InputError(
                f"{self.place}: z of the plate, by the order of its corners, does not point down but along "
                f"{tuple(np.round(axes[:, 2], 2).tolist())} (right, forward, up); check up and forward of the layout, or "
                "list the corners in the order of the C3D user guide"
            )
        force, free = force @ axes.T, free * axes[2, 2]
        loaded = np.abs(force[:, 2]) >= UNLOADED_N
        if np.abs(force[:, 2]).max(initial=0) >= _CLEARLY_LOADED_N and np.median(force[loaded, 2]) < 0:
            force, free = -force, -free
            self.notes.append("the file holds the force on the plate; that on the person was taken")
        centre = rotation @ self.corners.mean(axis=0) + beside @ axes[:, :2].T
        sides = np.linalg.norm(self.corners[0] - self.corners[[1, 3]], axis=1)
        outside = np.abs(beside[loaded]) > 0.5 * sides
        if outside.any():
            share = outside.any(axis=1).mean()
            self.notes.append(
                f"the centre of pressure lies beside the plate in {share:.1%} of the loaded samples"
            )
        return force, np.where(loaded[:, None], centre, np.nan), np.where(loaded, free, np.nan)


def read_force_plates(path: str | os.PathLike, layout: MarkerLayout | None = None) -> list[ForcePlate]:
    """Read the force plates of a recording; none where it has none (C3D without plates, any other marker file).

    Parameters
    ----------
    path : path
        C3D file, or OpenSim's ``.mot`` with ground reaction forces, also packed (``.gz``).
    layout : MarkerLayout, optional
        Axes and unit, as of the markers; a ``.mot`` file is in metres.

    Raises
    ------
    InputError
        A file that is broken, a plate of another type, corners that are no rectangle, a channel or unit that is
        missing.
    """
    path, layout = Path(path), layout or MarkerLayout()
    size = require_file(path)
    ending = ending_of(path)
    if ending not in (".mot", ".c3d"):
        return []
    read = read_mot if ending == ".mot" else read_c3d_plates
    return confined(partial(read_readable, path, read, layout), path, size, (ForcePlate,))


def read_c3d_plates(path: Path, layout: MarkerLayout) -> list[ForcePlate]:
    """Return the plates of a C3D file in the axes of a layout; see `read_force_plates`."""
    structure = check_structure(path, points_needed=False)
    used = int((structure.parameters.get("FORCE_PLATFORM:USED") or [0])[0])
    channels = analog_channels(path, structure)
    if used < 1 or not len(channels):
        return []
    unit = (structure.parameters.get("POINT:UNITS") or [""])[0]
    notes: list[str] = []
    if not unit and not structure.n_points and layout.unit == "file":
        unit = "mm"  # the user guide's own; no marker of this file could have another
        notes.append("the file states no unit of length; millimetres were taken")
    metres = layout.scale * metres_per_unit(str(path), unit, layout.unit)
    rotation = rotation_to_standard(layout.up, layout.forward)
    frames_per_s = layout.rate_Hz or structure.rate
    rate = channels.rate * frames_per_s / structure.rate
    time = (structure.first_frame - 1) / frames_per_s + np.arange(
        structure.n_frames * channels.per_frame
    ) / rate
    plates = []
    for number in range(used):
        plate = _plate(path, structure.parameters, number, used, metres)
        wrench = _WRENCHES[plate.kind](plate.signals(channels), plate)
        turned, corners = plate.turned(wrench, rotation), plate.corners @ rotation.T
        plates.append(ForcePlate(f"plate {number + 1}", time, *turned, rate, corners, (*notes, *plate.notes)))
    return plates


def _plate(path: Path, parameters: dict[str, list], number: int, used: int, metres: float) -> _Plate:
    """Geometry and channels of one plate, checked."""
    place = f"{path}: force plate {number + 1}"
    kind = int(_share(place, parameters, "TYPE", number, used, 1)[0])
    if kind not in _CHANNELS:
        allowed = ", ".join(map(str, _CHANNELS))
        raise InputError(
            f"{place} is of type {kind}; types {allowed} are read: export ground reaction forces"
        )
    corners = _share(place, parameters, "CORNERS", number, used, 12).reshape(4, 3) * metres
    x, y = corners[0] - corners[[1, 3]]
    gap = x + corners[2] - corners[3]
    area = np.linalg.norm(x) * np.linalg.norm(y)
    square = area > 0 and max(abs(x @ y), gap @ gap) <= _SQUARENESS * area
    if not square:
        found = ", ".join(str(tuple(np.round(corner, 3).tolist())) for corner in corners)
        raise InputError(
            f"{place}: the corners {found} m are no rectangle in this order; put the four corners into the order "
            "round the plate"
        )
    needed = _CHANNELS[kind]
    per_plate = len(parameters.get("FORCE_PLATFORM:CHANNEL", [])) // used
    if per_plate < needed:
        raise InputError(
            f"{place}: FORCE_PLATFORM:CHANNEL names {per_plate} channels; type {kind} has {needed}"
        )
    listed = _share(place, parameters, "CHANNEL", number, used, per_plate)[:needed]
    channels = tuple(int(channel) - 1 for channel in listed)
    calibration = None
    if kind == 4:
        # Stored by columns.
        calibration = _share(place, parameters, "CAL_MATRIX", number, used, 36).reshape(6, 6).T
    origin = _share(place, parameters, "ORIGIN", number, used, 3) * metres
    return _Plate(place, kind, corners, origin, channels, calibration, metres)


def _share(
    place: str, parameters: dict[str, list], name: str, number: int, used: int, count: int
) -> np.ndarray:
    """One plate's values of a parameter that holds those of all."""
    values = parameters.get(f"FORCE_PLATFORM:{name}", [])
    mine = values[number * count : (number + 1) * count]
    if len(mine) < count or not all(isinstance(value, int | float) and np.isfinite(value) for value in mine):
        raise InputError(
            f"{place}: FORCE_PLATFORM:{name} holds {len(values)} values; {count * used} finite numbers are needed"
        )
    return np.array(mine, dtype=float)


def _type_2(signals: np.ndarray, plate: _Plate) -> _Wrench:
    """Force, and moment about an origin below the surface; `plate.origin` leads from there to its middle.

    Some systems write it from the middle to the origin: z of the plate points down, so it must be negative.
    """
    force, origin = signals[:, :3], plate.origin * (-1 if plate.origin[2] > 0 else 1)
    return _at_the_surface(force, signals[:, 3:6] - np.cross(origin, force))


def _type_3(signals: np.ndarray, plate: _Plate) -> _Wrench:
    """Eight forces at four posts (Kistler): x12, x34, y14, y23, z1, z2, z3, z4.

    `plate.origin` holds the posts' distances from the middle and how deep they lie, which some systems write as a
    positive number: the surface is above them, where z of the plate is negative.
    """
    x12, x34, y14, y23, z1, z2, z3, z4 = signals.T
    a, b, depth = plate.origin
    force = np.transpose([x12 + x34, y14 + y23, z1 + z2 + z3 + z4])
    moment = np.transpose(
        [b * (z1 + z2 - z3 - z4), a * (z2 + z3 - z1 - z4), b * (x34 - x12) + a * (y14 - y23)]
    )
    return _at_the_surface(force, moment - np.cross([0, 0, -abs(depth)], force))


def _at_the_surface(force: np.ndarray, moment: np.ndarray) -> _Wrench:
    """Centre of pressure of a force and the moment about the middle of the surface."""
    vertical = np.where(force[:, 2:] == 0, np.nan, force[:, 2:])
    centre = np.transpose([-moment[:, 1], moment[:, 0]]) / vertical
    free = moment[:, 2] - (centre[:, 0] * force[:, 1] - centre[:, 1] * force[:, 0])
    return force, centre, free


_WRENCHES: dict[int, Callable[[np.ndarray, _Plate], _Wrench]] = {
    1: lambda signals, plate: (signals[:, :3], signals[:, 3:5], signals[:, 5]),  # as it states them
    2: _type_2,
    3: _type_3,
    4: _type_2,
}
