"""Content of a marker file with its own labels, unit and axes, and the distinction of measured and computed points.

Plug-in Gait and similar models store joint angles, forces, moments and powers, segment axes and the centre of mass as points.
They are identified by lists in the file (`POINT:TYPE_GROUPS` of the C3D user guide), or by the endings of labels.
"""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.yaml_file import shipped_yaml
from lumbar.records.number_table import Dialect, Row, read_numbers
from lumbar.records.record import CLOCK_TOLERANCE, LARGEST

RATES_HZ = (1e-3, 1e6)
"""Allowed frame rates."""


class NoMarkersError(InputError):
    """A table without markers."""


@dataclass(frozen=True)
class RecordedEvent:
    """An event that was marked in the recording by hand or by a program."""

    label: str
    """Label in the file, e.g. ``"Foot Off"``."""
    context: str
    """Side, e.g. ``"Left"``; empty if not stated."""
    time: float
    """Time in seconds on the recording's clock."""

    @property
    def full_label(self) -> str:
        """Label with the side, e.g. ``"Left Foot Off"``."""
        return f"{self.context} {self.label}".strip()


@dataclass(frozen=True)
class MarkerFile:
    """Trajectories with the labels, unit and axes of the file."""

    source: str
    """Path of the file, for messages."""
    time: np.ndarray
    """Time of the frames, shape (n_frames,): seconds on the recording's clock; the first frame need not be at 0."""
    rate: float
    """Frames per second."""
    unit: str
    """Unit of length in the file; empty if it states none."""
    positions: dict[str, np.ndarray] = field(default_factory=dict)
    """Measured markers by label, shape (n_frames, 3); NaN in all three coordinates if a marker was not seen."""
    model_points: dict[str, np.ndarray] = field(default_factory=dict)
    """Computed points by label, shape (n_frames, 3): centre of mass, segment axes; only aliases use these points."""
    dropped: dict[str, str] = field(default_factory=dict)
    """Labels that are not measured markers, also those of `model_points`, with the reason."""
    events: tuple[RecordedEvent, ...] = ()
    """Events in the order of time."""
    notes: tuple[str, ...] = ()
    """Contradictions in the file that do not affect coordinates."""
    joints: bool = False
    """True if the points are joint centres instead of markers on the skin."""

    @property
    def subjects(self) -> tuple[str, ...]:
        """Subject prefixes of the labels, as in ``Subject:C7``."""
        labels = (*self.positions, *self.dropped)
        return tuple(sorted({label.partition(":")[0] for label in labels if ":" in label}))


def mark_missing(points: np.ndarray) -> np.ndarray:
    """Set all coordinates of missing samples to NaN and return the points.

    A sample is missing if a coordinate is not finite, or if all three are exactly zero: systems write the origin for an
    unseen marker, and a measured marker is never exactly there.

    Parameters
    ----------
    points : ndarray, shape (..., 3)
        Coordinates in any unit; floats are changed in place.
    """
    points = np.asarray(points, dtype=float)
    missing = ~np.isfinite(points).all(axis=-1) | (points == 0).all(axis=-1)
    points[missing] = np.nan
    return points


_NON_POSITION_LABELS = (
    (re.compile(r"Angles?(\W.*)?$"), "joint angle, not a position"),
    (re.compile(r"(Force|GRF)s?(\W.*)?$"), "force, not a position"),
    (re.compile(r"Moments?(\W.*)?$"), "moment, not a position"),
    (re.compile(r"Powers?(\W.*)?$"), "power, not a position"),
)
_COMPUTED = [
    (
        re.compile(group["labels"], re.IGNORECASE),
        re.compile(group.get("with", ".*"), re.IGNORECASE),
        group["reason"],
    )
    for group in shipped_yaml(Path(__file__).with_name("computed_points.yaml"))["points"]
]
"""Labels of computed points, labels of which the file must have one, and the reason to leave them out."""
_CENTRE_OF_MASS = re.compile(r"^(Cent(re|er)OfMass(Floor)?|CoM|COM)$")
UNLABELLED = "trajectory without a label"
"""Reason why a trajectory is dropped."""
_UNLABELLED = re.compile(r"^(\*\d*|[CU]_\d+|uname\*?\d*|Unlabell?ed.*)$", re.IGNORECASE)
_SEGMENT_AXES = "OALP"
"""Last letters of the labels of a segment's origin and the ends of its three axes in Plug-in Gait."""


def split_points(
    file: MarkerFile, labels: list[str], points: np.ndarray, listed: dict[str, str] | None = None
) -> MarkerFile:
    """Sort the points of a file into measured markers, computed points and others, which are dropped.

    Parameters
    ----------
    file : MarkerFile
        The file without its points.
    labels : list of str
        Label of each point.
    points : ndarray, shape (n_frames, n_points, 3)
        NaN for missing samples.
    listed : dict of str to str, optional
        Labels that the file lists as angles, forces, … with the reason.
    """
    listed = listed or {}
    points = np.ascontiguousarray(points.swapaxes(0, 1))  # each trajectory contiguous
    counts = Counter(labels)
    # Origin and ends of the three axes of a segment of Plug-in Gait.
    stems = [label[:-1] for label in labels if label[-1:] == "O"]
    segments = [{stem + letter for letter in _SEGMENT_AXES} for stem in stems]
    axes = set().union(*(names for names in segments if names <= counts.keys()))
    computed = dict.fromkeys(axes, "computed segment axis")
    names = [label.rpartition(":")[2] for label in labels]
    for pattern, needed, source in _COMPUTED:
        if any(needed.fullmatch(name) for name in names):
            computed |= {
                label: source for label, name in zip(labels, names, strict=True) if pattern.fullmatch(name)
            }
    positions, model_points, dropped = {}, {}, {}
    for index, label in enumerate(labels):
        name = label.rpartition(":")[2]
        values = points[index]
        if label in listed:
            dropped[label] = listed[label]
        elif not label or _UNLABELLED.match(name):
            dropped[label or f"point {index + 1}"] = UNLABELLED
        elif counts[label] > 1:
            dropped[label] = f"label used for {counts[label]} points"
        elif reason := next((reason for ending, reason in _NON_POSITION_LABELS if ending.search(name)), None):
            dropped[label] = reason
        elif label in computed or _CENTRE_OF_MASS.match(name):
            dropped[label] = computed.get(label, "computed centre of mass")
            model_points[label] = values
        elif np.isnan(values).all():
            dropped[label] = "never seen"
        else:
            positions[label] = values
    return replace(file, positions=positions, model_points=model_points, dropped=dropped)


def read_frames(
    rows: Iterable[Row], width: int, source: str, dialect: Dialect, may_be_missing: bool = True
) -> np.ndarray:
    """Return the numbers of frames, shape (n_frames, width).

    Parameters
    ----------
    rows : iterable of Row
        Rows of the table, one per frame.
    width : int
        Cells of a row.
    source : str
        The file, for messages.
    dialect : Dialect
        Form of the rows.
    may_be_missing : bool
        Whether an empty cell is NaN; otherwise it is an error.

    Raises
    ------
    InputError
        If a row has another width, or a cell has no number or an implausible number; with the lines.
    """
    columns = {f"column {position + 1}": position for position in range(width)}
    table = read_numbers(rows, columns, source, dialect, width, columns if may_be_missing else ())
    is_allowed = (np.abs(table.values) <= LARGEST) | (may_be_missing & np.isnan(table.values))
    if not is_allowed.all():
        row, column = np.argwhere(~is_allowed)[0]
        raise InputError(
            f"{source}: line {table.lines[row]}: {table.values[row, column]:g} in column {column + 1}; finite numbers up to "
            f"{LARGEST:g} are needed"
        )
    return table.values


def check_even(source: str, printed: np.ndarray, even: np.ndarray, rate: float, blur: float = 0.0) -> None:
    """Raise if printed times differ from an even clock.

    Parameters
    ----------
    source : str
        The file, for messages.
    printed, even : ndarray, shape (n_frames,)
        Printed times and times of the even clock, in seconds.
    rate : float
        Frames per second.
    blur : float
        Allowed difference in seconds in addition to `CLOCK_TOLERANCE` of a frame.

    Raises
    ------
    InputError
        If a time differs, with the frame that differs most.
    """
    difference = np.abs(printed - even)
    worst = int(difference.argmax())
    if difference[worst] > CLOCK_TOLERANCE / rate + blur:
        raise InputError(
            f"{source}: frame {worst + 1} is at {printed[worst]:g} s; at {rate:g} Hz it would be at {even[worst]:g} s: the "
            "clock is not even, the rate is another, or frames are missing"
        )


def clock_from_times(
    source: str, printed: np.ndarray, declared: float | None = None
) -> tuple[np.ndarray, float]:
    """Return the times of an even clock in seconds, shape (n_frames,), and its rate, from printed times.

    Parameters
    ----------
    source : str
        The file, for messages.
    printed : ndarray, shape (n_frames,)
        Printed times in seconds.
    declared : float, optional
        Rate of the settings, ``markers.rate_Hz``, which must agree.

    Raises
    ------
    InputError
        If a frame has no time, time does not increase, the declared rate differs, or the clock is not even.
    """
    if not np.isfinite(printed).all():
        raise InputError(f"{source}: frame {int((~np.isfinite(printed)).argmax()) + 1} has no time")
    span = printed[-1] - printed[0]
    if not span > 0:
        raise InputError(f"{source}: time runs from {printed[0]:g} to {printed[-1]:g} s; it must increase")
    frames = np.arange(len(printed))
    rate = (len(printed) - 1) / span
    whole = round(rate)
    # A whole rate is detected even if the times are printed with few digits.
    if whole and np.abs(printed - printed[0] - frames / whole).max() * whole <= CLOCK_TOLERANCE:
        rate = float(whole)
    if declared is not None and not np.isclose(declared, rate, rtol=1e-2):
        raise InputError(
            f"{source}: times run at {rate:g} Hz, but markers.rate_Hz is {declared:g}; set it to null"
        )
    even = printed[0] + frames / rate
    check_even(source, printed, even, rate)
    return even, rate
