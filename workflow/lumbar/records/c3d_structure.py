"""The structure of a C3D file, checked before any library opens it.

C3D libraries trust the header: a file that is cut short comes back as a shorter recording, a missing
parameter shifts every coordinate, and a corrupt parameter section can end the whole process. Here the header
and the parameters are read by the letter of the C3D user guide (www.c3d.org), compared with each other and
with the size of the file. Nothing is mended and nothing is guessed.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumbar.errors import InputError, Problems

BLOCK = 512
_MAGIC = 0x50
INTEL, DEC, MIPS = 84, 85, 86
_PROCESSORS = {INTEL: "Intel", DEC: "DEC", MIPS: "MIPS"}
_ITEM_BYTES = {-1: 1, 1: 1, 2: 2, 4: 4}
SATURATED = 65535
"""Largest frame number that the header and POINT:FRAMES can hold: longer recordings say so elsewhere."""
_RATE_TOLERANCE = 1e-4
_TEXT = ("POINT:LABELS", "POINT:UNITS", "POINT:TYPE_GROUPS")
_NUMBERS = {
    *("POINT:USED", "POINT:SCALE", "POINT:RATE", "POINT:FRAMES", "POINT:LONG_FRAMES", "POINT:DATA_START"),
    *("ANALOG:USED", "ANALOG:RATE", "TRIAL:ACTUAL_START_FIELD", "TRIAL:ACTUAL_END_FIELD"),
}
"""Parameters that are read here, by what must stand in them."""


@dataclass(frozen=True)
class C3dStructure:
    """What a sound C3D file says of itself.

    Attributes
    ----------
    processor : int
        84 Intel, 85 DEC, 86 MIPS (big-endian).
    n_points, n_frames, first_frame : int
    n_analog : int
        Analog samples per frame of points, over all channels.
    rate : float
        Frames of points per second.
    parameters : dict of str to (list or str)
        By ``GROUP:NAME``; numbers as lists, characters as lists of stripped strings.
    data_start : int
        First byte of the data.
    scale : float
        Negative: coordinates are stored as 4-byte reals. Positive: as 2-byte integers to be multiplied by it.
    """

    processor: int
    n_points: int
    n_frames: int
    first_frame: int
    n_analog: int
    rate: float
    parameters: dict[str, list]
    data_start: int
    scale: float

    @property
    def frame_bytes(self) -> int:
        """Bytes of one frame: four words per point, then the analog samples."""
        return (4 * self.n_points + self.n_analog) * (4 if self.scale < 0 else 2)


def check_structure(path: Path) -> C3dStructure:
    """Read header and parameters of a C3D file and check that they fit each other and the file.

    Raises
    ------
    InputError
        With every contradiction found.
    """
    content = path.read_bytes()
    if len(content) < 2 * BLOCK:
        raise InputError(
            f"{path}: {len(content)} bytes; a C3D file has a header of 512 bytes, parameters and data"
        )
    if content[1] != _MAGIC or not content[0]:
        raise InputError(f"{path}: not a C3D file (its second byte is {content[1]:#04x}, not 0x50)")
    start = (content[0] - 1) * BLOCK
    if start + BLOCK > len(content) or start < BLOCK:
        raise InputError(
            f"{path}: the parameter section should start at byte {start}; the file has {len(content)}"
        )
    processor = content[start + 3]
    if processor not in _PROCESSORS:
        known = ", ".join(f"{number} ({name})" for number, name in _PROCESSORS.items())
        raise InputError(f"{path}: processor type {processor}; allowed are {known}")
    order = ">" if processor == MIPS else "<"
    points, analog, first, last, _, _, _, data_block, _ = struct.unpack(order + "9H", content[2:20])
    data_start = (data_block - 1) * BLOCK
    if not start < data_start < len(content):
        raise InputError(
            f"{path}: the data should start at byte {data_start}, after the parameters at {start} and before "
            f"the end of the file at {len(content)}; the file is cut short or its header is corrupt"
        )
    parameters = _read_parameters(path, content, start + 4, data_start, processor)
    header = {
        "n_points": points,
        "n_analog": analog,
        "first": first,
        "last": last,
        "data_block": data_block,
        "scale": _real(content[12:16], processor),
        "rate": _real(content[20:24], processor),
    }
    _check_agreement(path, header, parameters)
    start_field = parameters.get("TRIAL:ACTUAL_START_FIELD")
    structure = C3dStructure(
        processor=processor,
        n_points=points,
        n_frames=_frame_count(path, header, parameters),
        first_frame=_long_integer(start_field) if start_field else first,
        n_analog=analog,
        rate=header["rate"],
        parameters=parameters,
        data_start=data_start,
        scale=header["scale"],
    )
    _check_size(path, len(content) - data_start, structure)
    return structure


def last_frame(path: Path, structure: C3dStructure) -> np.ndarray:
    """Decode the coordinates of the last frame straight from the bytes, shape (n_points, 3)."""
    size = structure.frame_bytes
    with path.open("rb") as stream:
        stream.seek(structure.data_start + (structure.n_frames - 1) * size)
        raw = stream.read(16 * structure.n_points if structure.scale < 0 else 8 * structure.n_points)
    if structure.scale < 0:
        return _reals(raw, structure.processor).reshape(-1, 4)[:, :3]
    integers = np.frombuffer(raw, ">i2" if structure.processor == MIPS else "<i2").reshape(-1, 4)
    return integers[:, :3] * structure.scale


def _real(raw: bytes, processor: int) -> float:
    """Decode one 4-byte real number."""
    return float(_reals(raw, processor)[0])


def _reals(raw: bytes, processor: int) -> np.ndarray:
    """Decode reals: IEEE in the file's byte order, or DEC's: halves swapped and four times larger."""
    if processor == MIPS:
        return np.frombuffer(raw, ">f4").astype(float)
    if processor == INTEL:
        return np.frombuffer(raw, "<f4").astype(float)
    halves = np.frombuffer(raw, "<u2").reshape(-1, 2)[:, ::-1]
    return np.ascontiguousarray(halves).view("<f4").ravel().astype(float) / 4


def _read_parameters(path: Path, content: bytes, position: int, end: int, processor: int) -> dict[str, list]:
    """Parameters by ``GROUP:NAME``; they may come before their group."""
    order = ">" if processor == MIPS else "<"
    groups: dict[int, str] = {}
    entries: list[tuple[int, str, list]] = []
    while position + 2 <= end:
        length, group = struct.unpack("bb", content[position : position + 2])
        length = abs(length)  # a negative length marks a locked entry
        if length == 0:
            break
        body = position + 2 + length
        name = content[position + 2 : body]
        if body + 3 > end or group == 0 or not _is_name(name):
            raise InputError(f"{path}: the parameter section is corrupt at byte {position} (name {name!r})")
        (offset,) = struct.unpack(order + "h", content[body : body + 2])
        text = name.decode("ascii").upper()
        stop = body + 2
        if group < 0:
            if -group in groups:
                raise InputError(
                    f"{path}: the groups {groups[-group]} and {text} have the same number {-group}"
                )
            groups[-group] = text
        else:
            values, stop = _parameter_values(path, content, stop, end, processor, text)
            entries.append((group, text, values))
        stop += 1 + (content[stop] if stop < end else 0)  # the description and its length
        if stop > end:
            raise InputError(
                f"{path}: parameter {text} at byte {position} runs beyond the section's end at {end}"
            )
        if offset == 0:
            break
        if body + offset > end or body + offset < stop:
            raise InputError(
                f"{path}: parameter {text} at byte {position} points to byte {body + offset} for the next; "
                f"its own contents end at {stop} and the section at {end}"
            )
        position = body + offset
    orphans = sorted({name for group, name, _ in entries if group not in groups})
    if orphans:
        raise InputError(
            f"{path}: the parameters {', '.join(orphans)} belong to no group; the section is corrupt"
        )
    return {f"{groups[group]}:{name}": values for group, name, values in entries}


def _is_name(name: bytes) -> bool:
    return all(32 <= byte < 127 for byte in name)


def _parameter_values(
    path: Path, content: bytes, position: int, end: int, processor: int, name: str
) -> tuple[list, int]:
    """Values of a parameter, and the byte after them."""
    if position + 2 > end:
        raise InputError(f"{path}: parameter {name} is cut off at byte {position}")
    kind, n_dimensions = struct.unpack("bB", content[position : position + 2])
    if kind not in _ITEM_BYTES or n_dimensions > 7:
        raise InputError(
            f"{path}: parameter {name} has type {kind} and {n_dimensions} dimensions; it is corrupt"
        )
    dimensions = list(content[position + 2 : position + 2 + n_dimensions])
    start = position + 2 + n_dimensions
    count = int(np.prod(dimensions, dtype=int)) if dimensions else 1
    stop = start + count * _ITEM_BYTES[kind]
    if stop > end:
        raise InputError(
            f"{path}: parameter {name} would end at byte {stop}, beyond the section's end at {end}"
        )
    raw = content[start:stop]
    if kind == -1:
        width = dimensions[0] if dimensions else 1
        rows = [raw[index : index + width] for index in range(0, len(raw), width)] if width else []
        return [row.decode("utf-8", "replace").strip(" \0") for row in rows], stop
    if kind == 4:
        return _reals(raw, processor).tolist(), stop
    integer = {1: "i1", 2: ">i2" if processor == MIPS else "<i2"}[kind]
    return np.frombuffer(raw, integer).astype(int).tolist(), stop


def _long_integer(words: list) -> int:
    """32 bits from two 16-bit words, the low one first."""
    low, high = (int(word) % 65536 for word in (*words, 0)[:2])
    return low + 65536 * high


def _frame_count(path: Path, header: dict, parameters: dict[str, list]) -> int:
    """Frames of points; every statement in the file that can hold the number must agree."""
    statements = {}
    if header["last"] < SATURATED:
        statements["the header"] = header["last"] - header["first"] + 1
    if parameters.get("POINT:FRAMES"):
        frames = int(parameters["POINT:FRAMES"][0]) % 65536
        if frames < SATURATED and not (frames == 0 and header["last"] >= SATURATED):
            statements["POINT:FRAMES"] = frames
    if parameters.get("POINT:LONG_FRAMES"):
        statements["POINT:LONG_FRAMES"] = int(parameters["POINT:LONG_FRAMES"][0])
    first, last = parameters.get("TRIAL:ACTUAL_START_FIELD"), parameters.get("TRIAL:ACTUAL_END_FIELD")
    if first and last:
        statements["TRIAL:ACTUAL_START_FIELD and ACTUAL_END_FIELD"] = (
            _long_integer(last) - _long_integer(first) + 1
        )
    if not statements:
        raise InputError(
            f"{path}: 65535 frames or more, and neither POINT:LONG_FRAMES nor "
            "TRIAL:ACTUAL_END_FIELD says how many; cut the recording"
        )
    if len(set(statements.values())) > 1:
        found = ", ".join(f"{frames} in {place}" for place, frames in statements.items())
        raise InputError(f"{path}: the number of frames is {found}; export the recording again")
    count = next(iter(statements.values()))
    if count < 1:
        raise InputError(f"{path}: {count} frames")
    return count


def _check_agreement(path: Path, header: dict, parameters: dict[str, list]) -> None:
    """Compare header and parameters."""
    problems = Problems(str(path))
    for name in ("USED", "SCALE", "RATE", "LABELS"):
        if not parameters.get(f"POINT:{name}"):
            problems.add(f"POINT:{name}", "missing or empty", "a reader cannot do without it")
    for name, values in parameters.items():
        needed = "text" if name.startswith(_TEXT) else "finite numbers" if name in _NUMBERS else None
        if needed and not all(_is_text(value) == (needed == "text") for value in values):
            problems.add(name, f"{values[:3]}", f"{needed} must stand there")
    problems.raise_if_any()
    stated = {
        "number of points": (header["n_points"], int(parameters["POINT:USED"][0]) % 65536, "POINT:USED"),
        "scale factor": (header["scale"], parameters["POINT:SCALE"][0], "POINT:SCALE"),
        "rate": (header["rate"], parameters["POINT:RATE"][0], "POINT:RATE"),
    }
    if parameters.get("POINT:DATA_START", [0])[0]:
        stated["data block"] = (
            header["data_block"],
            int(parameters["POINT:DATA_START"][0]),
            "POINT:DATA_START",
        )
    channels, rate = parameters.get("ANALOG:USED"), parameters.get("ANALOG:RATE")
    if channels and rate and parameters["POINT:RATE"][0] > 0:
        per_frame = round(int(channels[0]) * rate[0] / parameters["POINT:RATE"][0], 3)
        stated["analog samples per frame"] = (header["n_analog"], per_frame, "ANALOG:USED and ANALOG:RATE")
    for quantity, (in_header, in_parameters, name) in stated.items():
        if not np.isclose(in_header, in_parameters, rtol=_RATE_TOLERANCE, atol=0):
            problems.add(
                quantity, f"{in_header:g} in the header, {in_parameters:g} in {name}", "they must agree"
            )
    if not header["n_points"] or not np.isfinite(header["rate"]) or header["rate"] <= 0:
        problems.add(
            "header", f"{header['n_points']} points at {header['rate']:g} Hz", "both must be positive"
        )
    if not np.isfinite(header["scale"]) or header["scale"] == 0:
        problems.add("header", f"scale factor {header['scale']:g}", "a finite number other than 0 is needed")
    problems.raise_if_any()


def _is_text(value) -> bool | None:
    """Whether a value of a parameter is text; None for a number that is not finite."""
    return True if isinstance(value, str) else False if np.isfinite(value) else None


def _check_size(path: Path, available: int, structure: C3dStructure) -> None:
    """Every frame must be in the file."""
    size = structure.frame_bytes
    if available < structure.n_frames * size:
        raise InputError(
            f"{path}: {structure.n_frames} frames of {size} bytes are announced, but the file holds "
            f"{available // size}; it is cut short: copy or export it again"
        )
