"""Marker recordings: C3D, TRC, CSV and BVH files as positions in metres with standard names.

Axes are those of chapter 4 of the thesis: x lateral (to the right), y forward, z up; right-handed. The layout is
`lumbar.settings.layout.MarkerLayout`; `lumbar.records.marker_aliases` explains its aliases. Standard names are C7, T12, L5 (the
spine at L4/L5), MANUBRIUM, XIPHOID, SACRUM; SHOULDER, HIP (greater trochanter), WRIST, ANKLE, HEEL and TOE with the prefix L_ or
R_; BOX_1, BOX_2 and so on for markers on the box.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.files import require_file
from lumbar.records.child_process import read_in_child
from lumbar.records.marker_file import UNLABELLED, MarkerFile, RecordedEvent
from lumbar.records.unpacking import ending_of, read_readable, stem_of
from lumbar.settings.layout import MarkerLayout

Screen = Callable[[dict[str, np.ndarray], np.ndarray, float], tuple[dict[str, np.ndarray], dict[str, str]]]
Repair = Callable[[dict[str, np.ndarray], np.ndarray], dict[str, np.ndarray]]
METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_UNIT_NAMES = {unit: unit for unit in METRES} | dict.fromkeys(("meter", "meters", "metres"), "m")
_UNIT_NAMES["millimeters"] = "mm"
SPREAD_M = (0.02, 50.0)
"""Plausible extent of all markers in metres; a wrong unit leads to an extent outside."""
MAX_DISTANCE_M = 1e5
"""Largest distance of a marker from the origin; only corrupt data are farther away, in any unit."""


@dataclass(frozen=True, repr=False)
class MarkerRecording:
    """Marker trajectories of one subject."""

    name: str
    time: np.ndarray
    """Time of the frames, shape (n_frames,): seconds on the recording's clock, evenly spaced."""
    rate: float
    """Frames per second."""
    positions: dict[str, np.ndarray]
    """Positions by marker, shape (n_frames, 3): metres; columns x (right), y (forward), z (up). NaN if a marker was not seen."""
    source: str = ""
    """The file, for messages."""
    dropped: dict[str, str] = field(default_factory=dict)
    """Omitted labels of the file, with the reason (angles, forces, computed points, never seen, duplicate label)."""
    derived: dict[str, str] = field(default_factory=dict)
    """Markers that are computed from others, with the rule."""
    absent: dict[str, str] = field(default_factory=dict)
    """Optional aliases that are not in the file, with the reason."""
    unused: tuple[str, ...] = ()
    """Markers of the file without an alias."""
    events: tuple[RecordedEvent, ...] = ()
    """Events in the file (C3D), in the order of time."""
    notes: tuple[str, ...] = ()
    """Contradictions in the file that do not affect coordinates."""
    subjects: tuple[str, ...] = ()
    """Prefixes, as in ``Subject:C7``, that were removed from the file's labels."""
    joints: bool = False
    """True if the points are joint centres instead of markers on the skin."""

    def __getitem__(self, marker: str) -> np.ndarray:
        """Return the positions of one marker, shape (n_frames, 3), in metres."""
        if marker not in self.positions:
            reason = self.absent.get(marker, "no alias of that name")
            raise InputError(f"{self.source or self.name}: no marker {marker} ({reason})")
        return self.positions[marker]

    def select_frames(self, frames: slice | np.ndarray) -> "MarkerRecording":
        """Return the recording of some frames.

        Parameters
        ----------
        frames : slice or ndarray
            Numbers of the frames, or a mask of shape (n_frames,).
        """
        positions = {name: points[frames] for name, points in self.positions.items()}
        return replace(self, time=self.time[frames], positions=positions)

    def replace_positions(self, positions: dict[str, np.ndarray]) -> "MarkerRecording":
        """Return the recording with other positions of its markers.

        Parameters
        ----------
        positions : dict of str to numpy.ndarray, shape (n_frames, 3)
            Positions in m by marker.
        """
        return replace(self, positions=positions)

    def __contains__(self, marker: str) -> bool:
        return marker in self.positions

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        return f"<MarkerRecording {self.name}: {len(self)} frames at {self.rate:g} Hz, {len(self.positions)} markers>"


def read_markers(
    path: str | os.PathLike,
    layout: MarkerLayout | None = None,
    name: str | None = None,
    minimum_frames: int = 2,
    screen: Screen | None = None,
    repair: Repair | None = None,
) -> MarkerRecording:
    """Read a C3D, TRC, CSV or BVH file.

    Parameters
    ----------
    path : path
        A file with the ending ``.c3d``, ``.trc``, ``.csv`` or ``.bvh``, also gzipped (``.gz``).
    layout : MarkerLayout, optional
        Unit, axes and aliases. Without aliases every marker keeps its label.
    name : str, optional
        Name of the recording; default the file's name.
    minimum_frames : int
        1 accepts a static pose of one frame; a trajectory needs at least 2.
    screen : callable, optional
        Takes the measured markers by label (metres, standard axes), the time and the rate; returns the markers with NaN for
        samples that must not be used, and the omitted labels with the reason, see `lumbar.lifting.quality.screening`.
    repair : callable, optional
        Takes the screened markers by label and the time; returns repaired ones, from which rules derive further points.

    Raises
    ------
    InputError
        If the file is broken, truncated or contradictory, or a unit, prefix, marker or axis does not fit.
    """
    from lumbar.records.marker_aliases import KEEP, resolve_aliases, select_subject
    from lumbar.records.marker_axes import check_axes, rotation_to_standard

    layout = layout or MarkerLayout()
    path = Path(path)
    labelled = _read_file(path, layout)
    file = select_subject(labelled, layout.subject_prefix)
    time, rate, events, dropped = file.time, file.rate, file.events, file.dropped
    if layout.rate_Hz is not None:
        rate = layout.rate_Hz
        time = time * file.rate / rate
        events = tuple(RecordedEvent(one.label, one.context, one.time * file.rate / rate) for one in events)
    if len(time) < minimum_frames:
        raise InputError(
            f"{path}: {len(time)} frame{'s' if len(time) != 1 else ''}; "
            f"a trajectory needs at least {minimum_frames}"
        )
    unit = layout.scale * _metres_per_unit(file.source, file.unit, layout.unit)
    rotation = rotation_to_standard(layout.up, layout.forward)
    # Axes are swapped and inverted in place: a matrix product is ten times slower, and a copy doubles the memory.
    order, factors = np.abs(rotation).argmax(axis=1), unit * rotation.sum(axis=1)
    points, model_points = dict(file.positions), file.model_points
    for values in (*points.values(), *model_points.values()):
        values[:] = values[:, order] * factors
    if screen is not None:
        points, omitted = screen(points, time, rate)
        points = {label: values for label, values in points.items() if not np.isnan(values).all()}
        dropped = dropped | omitted
    if not points and set(dropped.values()) == {UNLABELLED}:
        raise InputError(
            f"{file.source}: no trajectory has a name ({', '.join(islice(dropped, 3))}, … are unlabelled); label them in the "
            "capture software and export again"
        )
    if not points:
        raise InputError(f"{file.source}: no marker was seen; left out: {', '.join(dropped) or 'none'}")
    _check_spread(points, file, layout.scale)
    if repair is not None:
        points = repair(points, time)
    resolved = resolve_aliases(layout.aliases, points, model_points, dropped, file.source, layout.required)
    if layout.check_axes:
        check_axes(resolved.positions, layout, file.source)
    return MarkerRecording(
        name=name or stem_of(path),
        time=time,
        rate=rate,
        source=file.source,
        dropped=dropped,
        events=events,
        notes=file.notes,
        **vars(resolved),
        subjects=() if layout.subject_prefix == KEEP else labelled.subjects,
        joints=file.joints if layout.points == "file" else layout.points == "joint_centres",
    )


def _read_file(path: Path, layout: MarkerLayout) -> MarkerFile:
    require_file(path)
    ending = ending_of(path)
    read: Callable[..., MarkerFile]
    if ending == ".c3d":
        from lumbar.records.c3d_file import c3d_content, c3d_markers

        return c3d_markers(read_in_child(c3d_content, path), str(path))
    if ending == ".trc":
        from lumbar.records.text_markers import read_trc as read
    elif ending in (".csv", ".tsv"):
        from lumbar.records.marker_table import read_marker_table as read
    elif ending == ".bvh":
        from lumbar.records.text_markers import read_bvh as read
    else:
        raise InputError(
            f"{path}: markers are read from .c3d, .trc, .csv and .bvh files, also with .gz, not "
            f"{ending or 'a file without suffix'!r}"
        )
    options = (layout.rate_Hz,) if ending in (".csv", ".tsv") else ()
    return replace(read_readable(path, read, *options), source=str(path))


def _metres_per_unit(source: str, unit: str, declared: str) -> float:
    """Return the factor from a file's unit of length to metres; raise if no unit is known, or the two differ.

    `unit` is empty if the file states none; `declared` is ``"file"`` or one of `METRES`.
    """
    stated = _UNIT_NAMES.get(unit.strip().lower())
    if declared == "file" and stated is None:
        problem = f"states the unit {unit!r}" if unit.strip() else "states no unit"
        raise InputError(f"{source}: the file {problem}; set markers.unit to {', '.join(METRES)}")
    if declared != "file" and stated not in (None, declared):
        raise InputError(
            f"{source}: the file states {unit!r} but markers.unit is {declared!r}; set markers.unit to file"
        )
    return METRES[declared if declared != "file" else str(stated)]


def _check_spread(points: dict[str, np.ndarray], file: MarkerFile, scale: float) -> None:
    """Raise if the extent of the markers is implausible, because of a wrong unit or corrupt data."""
    for label, values in points.items():
        is_far = (np.abs(values) > MAX_DISTANCE_M).any(axis=1)
        if is_far.any():
            raise InputError(
                f"{file.source}: {label} is {np.nanmax(np.abs(values)):.3g} m away, first in frame {is_far.argmax() + 1}, more "
                f"than {MAX_DISTANCE_M:g} m: bytes were inserted, lost or changed; copy or export it again"
            )
    if len(points) < 2:
        return
    centres = np.array([np.nanmedian(values, axis=0) for values in points.values()])
    spread = float(np.ptp(centres, axis=0).max())
    if not SPREAD_M[0] <= spread <= SPREAD_M[1]:
        remedy = "the file states no unit: set markers.unit"
        if file.unit.strip():
            times = 1e-3 if spread > SPREAD_M[1] else 1e3
            remedy = f"its unit {file.unit!r} is not that of its numbers: set markers.scale, e.g. to {times * scale:g}"
        raise InputError(
            f"{file.source}: the markers extend over {spread:.3g} m, outside {SPREAD_M[0]:g} to {SPREAD_M[1]:g} m; {remedy}"
        )
