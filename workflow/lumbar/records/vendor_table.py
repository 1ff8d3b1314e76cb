"""Tables of markers as Vicon Nexus, Motive and Qualisys Track Manager (TSV) write them, by their published layouts."""

from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

from lumbar.base.errors import InputError

Rows = list[tuple[int, list[str]]]
"""Line and cells of every row that is not empty."""
_UNITS = {"Meters": "m", "Centimeters": "cm", "Millimeters": "mm"}


@dataclass(frozen=True)
class VendorTable:
    """An export as a plain table."""

    header: list[str]
    """One name per column, as ``C7_x``; empty where a column is no coordinate of a marker."""
    rows: Rows
    unit: str
    rate: float | None
    """Frames per second; None where a column has the times."""


def vendor_table(path: Path, rows: Rows) -> VendorTable | None:
    """Read an export, known by its first cell; None of another table.

    Raises
    ------
    InputError
        Where what follows is not the vendor's layout, or not as many frames as it says.
    """
    vendor, read = _VENDORS.get(rows[0][1][0], ("", None)) if rows else ("", None)
    try:
        return read and read(rows)
    except (ArithmeticError, LookupError, ValueError, StopIteration) as error:
        said = f"begins as an export of {vendor}, and is none further on ({type(error).__name__}: {error})"
        raise InputError(f"{path}: {said}; export it again") from error


def joined_names(markers: list[str], axes: list[str]) -> list[str]:
    """Names as ``C7_x`` of two lines, of which the first has each marker once."""
    names, marker = [], ""
    for column, axis in enumerate(axes):
        marker = (markers[column] if column < len(markers) else "") or marker
        names.append(f"{marker}_{axis}" if axis.lower() in ("x", "y", "z") else axis or marker)
    return names


def _nexus(rows: Rows) -> VendorTable:
    """Rate, markers, axes, units, then frames up to the next section."""
    begins = next(place for place, (_, cells) in enumerate(rows) if cells[0] == "Trajectories")
    (_, (rate, *_)), (_, markers), (_, axes), (_, units), *frames = rows[begins + 1 :]
    header = ["time_s", *(name if name[-2:-1] == "_" else "" for name in joined_names(markers, axes)[1:])]
    own = list(takewhile(lambda row: row[1][0].isdigit() and len(row[1]) > 1, frames))
    frames = [
        (line, [f"{(int(cells[0]) - 1) / float(rate):.9g}", *cells[1:]])
        for line, cells in _trimmed(own, len(header))
    ]
    return VendorTable(header, frames, next(filter(None, units), ""), None)


def _motive(rows: Rows) -> VendorTable:
    """Facts in pairs, lines that say what each column is, then frames; bones and rigid bodies are left out."""
    facts = dict(zip(rows[0][1][::2], rows[0][1][1::2], strict=False))
    begins = next(place for place, (_, cells) in enumerate(rows) if cells[0] == "Frame")
    told = {cells[1]: cells for _, cells in rows[1:begins]}
    columns = zip(told["Type"], told["Name"], rows[begins - 1][1], rows[begins][1], strict=True)
    header = [f"{item[1]}_{item[3]}" if item[::2] == ("Marker", "Position") else "" for item in columns]
    header[1] = "time_s"
    frames = _trimmed(rows[begins + 1 :], len(header), facts["Total Exported Frames"])
    return VendorTable(header, frames, _UNITS[facts["Length Units"]], None)


def _qualisys(rows: Rows) -> VendorTable:
    """Facts by name, perhaps a line of names, then frames in millimetres, with their numbers and times or without."""
    facts = {cells[0]: cells[1:] for _, cells in rows if cells[0][:1].isalpha()}
    labels = [label for label in facts["MARKER_NAMES"] if label]
    frames = [row for row in rows if not row[1][0][:1].isalpha()]
    numbered = len(frames[0][1]) - 3 * len(labels) >= 2
    header = ["", "time_s"] * numbered + [f"{label}_{axis}" for label in labels for axis in "xyz"]
    rate = None if numbered else float(facts["FREQUENCY"][0])
    return VendorTable(header, _trimmed(frames, len(header), facts["NO_OF_FRAMES"][0]), "mm", rate)


def _trimmed(rows: Rows, width: int, announced: str = "") -> Rows:
    """Rows without empty cells beyond the columns."""
    if not rows or (announced and int(announced) != len(rows)):
        raise ValueError(f"{announced or 'some'} frames are announced, {len(rows)} are there")
    return [(line, [*cells[:width], *filter(None, cells[width:])]) for line, cells in rows]


_VENDORS = dict.fromkeys(("Devices", "Trajectories"), ("Vicon Nexus", _nexus)) | {
    "Format Version": ("Motive", _motive),
    "NO_OF_FRAMES": ("Qualisys Track Manager", _qualisys),
}
