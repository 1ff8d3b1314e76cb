"""Structure and parameters of a C3D file, checked before its data are read.

Readers that trust the header return a truncated file as a shorter recording, and displaced coordinates if a parameter is
missing. Here header and parameters are decoded as in the C3D user guide (www.c3d.org) and compared with each other and with
the size of the file. A contradiction that may displace coordinates is an error. Deviations of common systems (one frame more
or less, a rounded rate, a parameter without a group) are accepted with a note.
"""

import contextlib
import math
import mmap
import struct
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.marker_file import RATES_HZ

INTEL, DEC, MIPS = 84, 85, 86
BLOCK = 512
"""Size of a block in bytes."""
MAX_COUNT = 65535
"""Largest value that the header and POINT:FRAMES can store; if it occurs, the frame number is stored elsewhere."""
_PROCESSORS = {INTEL: "Intel", DEC: "DEC", MIPS: "MIPS"}
_ITEM_BYTES = {-1: 1, 1: 1, 2: 2, 4: 4}
"""Bytes per value by type of the parameter: characters, bytes, integers, reals."""
_RATE_TOLERANCE = 1e-4
_FRAME_TOLERANCE = 1
"""Allowed difference of the stated numbers of frames: systems count from 0 or 1. The smallest number is read."""
_TEXTS = ("POINT:LABELS", "POINT:UNITS", "POINT:TYPE_GROUPS")
_NUMBERS = {
    *("POINT:USED", "POINT:SCALE", "POINT:RATE", "POINT:FRAMES", "POINT:LONG_FRAMES", "POINT:DATA_START"),
    *("ANALOG:USED", "ANALOG:RATE", "ANALOG:GEN_SCALE", "TRIAL:ACTUAL_START_FIELD", "TRIAL:ACTUAL_END_FIELD"),
    *("EVENT:USED", "FORCE_PLATFORM:USED", "FORCE_PLATFORM:ZERO"),
    *("ROTATION:USED", "ROTATION:DATA_START", "ROTATION:RATIO"),
}
"""Parameters that must be finite numbers; those in `_TEXTS` must be texts."""


def reals(raw: np.ndarray, processor: int) -> np.ndarray:
    """Decode 4-byte reals, in IEEE or DEC form; the DEC form has swapped halves and a value four times as large.

    Parameters
    ----------
    raw : ndarray of uint8, shape (..., 4 n)
        Bytes of n numbers per row.
    processor : int
        Processor that wrote the numbers, see `C3dStructure`.

    Returns
    -------
    ndarray of float, shape (..., n)
    """
    raw = np.ascontiguousarray(raw)
    with np.errstate(invalid="ignore"):  # signalling NaN
        if processor != DEC:
            return raw.view(">f4" if processor == MIPS else "<f4").astype(float)
        halves = raw.view("<u2")
        halves = halves.reshape(*halves.shape[:-1], -1, 2)[..., ::-1]
        return np.ascontiguousarray(halves).view("<f4")[..., 0].astype(float) / 4


def integers(raw: np.ndarray, processor: int) -> np.ndarray:
    """Decode 2-byte integers.

    Parameters
    ----------
    raw : ndarray of uint8, shape (..., 2 n)
        Bytes of n numbers per row.
    processor : int
        Processor that wrote the numbers, see `C3dStructure`.

    Returns
    -------
    ndarray of int, shape (..., n)
    """
    return np.ascontiguousarray(raw).view(">i2" if processor == MIPS else "<i2").astype(int)


def _long_integer(values: list) -> int:
    """Return 32 bits from two 16-bit values, the low one first."""
    low, high = (int(value) % 65536 for value in (*values, 0)[:2])
    return low + 65536 * high


@dataclass
class C3dStructure:
    """Content of the header and the parameters of a C3D file."""

    processor: int
    """Processor that wrote the file: 84 Intel, 85 DEC, 86 MIPS (big-endian)."""
    n_points: int
    n_frames: int
    first_frame: int
    n_analog: int
    """Analog samples per frame of points, over all channels."""
    rate: float
    """Frames of points per second."""
    scale: float
    """Scale factor of coordinates in 2-byte integers; negative if coordinates are stored as 4-byte reals."""
    data_start: int
    """First byte of the data."""
    size: int
    """Size of the file in bytes."""
    parameters: dict[str, list]
    """Parameter values by ``GROUP:NAME``: numbers, or stripped strings."""
    notes: list[str]
    """Contradictions in the file that do not affect coordinates."""

    @property
    def word_bytes(self) -> int:
        """Size of one stored number in bytes."""
        return 4 if self.scale < 0 else 2

    @property
    def frame_bytes(self) -> int:
        """Size of one frame in bytes: four numbers per point, then the analog samples."""
        return (4 * self.n_points + self.n_analog) * self.word_bytes

    def fits(self, n_frames: int) -> bool:
        """Return whether data of `n_frames` frames end in the last block of the file.

        Parameters
        ----------
        n_frames : int
            Assumed number of frames.
        """
        return 0 <= self.size - self.data_start - n_frames * self.frame_bytes < BLOCK


def check_structure(path: Path) -> C3dStructure:
    """Read header and parameters of a C3D file and check that they agree with each other and with the file's size.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    InputError
        If the file is contradictory, with every contradiction.
    """
    size = path.stat().st_size
    if size < 2 * BLOCK:
        raise InputError(f"{path}: {size} bytes; a C3D file has a header of 512 bytes, parameters and data")
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        if content[1] != 0x50 or not content[0]:
            raise InputError(f"{path}: not a C3D file (its second byte is {content[1]:#04x}, not 0x50)")
        start = (content[0] - 1) * BLOCK
        if start + BLOCK > size or start < BLOCK:
            raise InputError(f"{path}: the parameter section should start at byte {start} of {size}")
        stated = content[start + 3]
        try:
            return _read_structure(path, content, start, stated)
        except InputError:
            for processor in _PROCESSORS.keys() - {stated}:
                with contextlib.suppress(InputError):
                    structure = _read_structure(path, content, start, processor)
                    if structure.fits(structure.n_frames):
                        name = f"{processor} ({_PROCESSORS[processor]})"
                        structure.notes.append(f"processor type {stated}; {name} fits the file's size")
                        return structure
            raise


def _read_structure(path: Path, content: mmap.mmap, start: int, processor: int) -> C3dStructure:
    """Read and check a file that `processor` wrote; `start` is the first byte of the parameter section."""
    if processor not in _PROCESSORS:
        raise InputError(f"{path}: processor type {processor}; allowed are {_PROCESSORS}")
    order = ">" if processor == MIPS else "<"
    points, analog, first, last, _, _, _, data_block, _ = struct.unpack(order + "9H", content[2:20])
    scale, rate = (
        float(reals(np.frombuffer(content[byte : byte + 4], np.uint8), processor)[0]) for byte in (12, 20)
    )
    data_start, size = (data_block - 1) * BLOCK, len(content)
    end = data_start if start < data_start < size else min(start + content[start + 2] * BLOCK, size)
    notes: list[str] = []
    parameters = _read_parameters(path, content, start + 4, end, processor, notes)
    problems = Problems(str(path))
    for name, values in parameters.items():
        are_texts = [isinstance(value, str) for value in values]
        if name.startswith(_TEXTS) and not all(are_texts):
            problems.add(name, f"{values[:3]}", "text is needed")
        if name in _NUMBERS and (any(are_texts) or not np.isfinite(values).all()):
            problems.add(name, f"{values[:3]}", "finite numbers are needed")
    problems.raise_if_any()
    structure = C3dStructure(
        processor, points, last - first + 1, first, analog, rate, scale, data_start, size, parameters, notes
    )
    _complete_scale_and_rate(structure)
    structure = _choose_fitting_values(structure, start)
    if not start < structure.data_start < size:
        raise InputError(
            f"{path}: data at byte {structure.data_start}, parameters at {start}, end at {size}; it is cut short or corrupt"
        )
    if not structure.n_points and (analog or _rotation_bytes(structure)):
        content_kind = (
            "rotation matrices; export joint centres or markers as points"
            if _rotation_bytes(structure)
            else "analog channels, as a force plate writes them; give the recording of the markers"
        )
        raise InputError(f"{path}: no points, only {content_kind}")
    _check_agreement(path, structure)
    structure.n_frames = _count_frames(path, structure)
    if parameters.get("TRIAL:ACTUAL_START_FIELD"):
        structure.first_frame = _long_integer(parameters["TRIAL:ACTUAL_START_FIELD"])
    _check_analog(path, structure)
    _check_size(path, content, structure)
    return structure


def _read_parameters(
    path: Path, content: mmap.mmap, position: int, end: int, processor: int, notes: list[str]
) -> dict[str, list]:
    """Read the parameters from byte `position`; omit parameters without a group and contradictory duplicates, with a note."""
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
        if body + 3 > end or group == 0 or not all(32 <= byte < 127 for byte in name):
            raise InputError(f"{path}: the parameter section is corrupt at byte {position} (name {name!r})")
        (offset,) = struct.unpack(order + "h", content[body : body + 2])
        text = name.decode("ascii").upper()
        stop = body + 2
        if group < 0:
            if groups.setdefault(-group, text) != text:
                raise InputError(f"{path}: the groups {groups[-group]} and {text} have the same number")
        else:
            values, stop = _read_values(path, content, stop, end, processor, text)
            entries.append((group, text, values))
        stop += 1 + (content[stop] if stop < end else 0)  # the description and its length
        if stop > end:
            raise InputError(f"{path}: parameter {text} at byte {position}: its section ends at {end}")
        if offset == 0:
            break
        if body + offset > end or body + offset < stop:
            raise InputError(
                f"{path}: parameter {text} at byte {position} points to byte {body + offset} for the next; "
                f"its own contents end at {stop} and the section at {end}"
            )
        position = body + offset
    return _name_parameters(groups, entries, notes)


def _name_parameters(
    groups: dict[int, str], entries: list[tuple[int, str, list]], notes: list[str]
) -> dict[str, list]:
    if orphans := sorted({name for group, name, _ in entries if group not in groups}):
        notes.append(f"the parameters {', '.join(orphans)} belong to no group and were left out")
    parameters: dict[str, list] = {}
    duplicates = set()
    for group, name, values in entries:
        full = f"{groups.get(group)}:{name}"
        # Compared as text, because NaN differs from itself.
        if group in groups and str(parameters.setdefault(full, values)) != str(values):
            duplicates.add(full)
    for name in sorted(duplicates):
        notes.append(f"{name} is duplicate, with different values, and was left out")
        del parameters[name]
    return parameters


def _read_values(
    path: Path, content: mmap.mmap, position: int, end: int, processor: int, name: str
) -> tuple[list, int]:
    """Return the values of a parameter, and the position of the byte after the values."""
    if position + 2 > end:
        raise InputError(f"{path}: parameter {name} is cut off at byte {position}")
    kind, n_dimensions = struct.unpack("bB", content[position : position + 2])
    if kind not in _ITEM_BYTES or n_dimensions > 7:
        raise InputError(f"{path}: parameter {name} is corrupt: type {kind}, {n_dimensions} dimensions")
    start = position + 2 + n_dimensions
    dimensions = list(content[position + 2 : start])
    stop = start + math.prod(dimensions) * _ITEM_BYTES[kind]
    if stop > end:
        raise InputError(f"{path}: parameter {name} would end at byte {stop}; its section ends at {end}")
    raw = content[start:stop]
    if kind == -1:
        width = dimensions[0] if dimensions else 1
        rows = [raw[index : index + width] for index in range(0, len(raw), width)] if width else []
        return [row.decode("utf-8", "replace").strip(" \0") for row in rows], stop
    if kind == 1:
        return list(struct.unpack(f"{len(raw)}b", raw)), stop
    decode = reals if kind == 4 else integers
    return decode(np.frombuffer(raw, np.uint8), processor).tolist(), stop


def _complete_scale_and_rate(structure: C3dStructure) -> None:
    """Copy scale factor and rate from header to parameters if the parameters lack them, or from parameters to header."""
    parameters, notes = structure.parameters, structure.notes
    for key, name in (("scale", "POINT:SCALE"), ("rate", "POINT:RATE")):
        stated, in_header = parameters.get(name), getattr(structure, key)
        is_known = np.isfinite(in_header) and in_header != 0
        if not stated and is_known:
            parameters[name] = [in_header]
            notes.append(f"{name} is missing; the header's {in_header:g} was taken")
        elif stated and not is_known and stated[0] != 0:
            notes.append(f"the header has no {key}; {name}, {stated[0]:g}, was taken")
            setattr(structure, key, stated[0])
        elif key == "scale" and stated and max(stated[0], in_header) < 0:
            parameters[name] = [in_header]  # only its sign matters if coordinates are stored as reals


def _choose_fitting_values(structure: C3dStructure, start: int) -> C3dStructure:
    """Choose the number of points and the data block, from the header or the parameters, that fit the file's size."""
    in_header = {"POINT:USED": structure.n_points, "POINT:DATA_START": structure.data_start // BLOCK + 1}
    stated = {name: int((structure.parameters.get(name) or [0])[0]) % 65536 for name in in_header}
    candidates = [
        replace(structure, n_points=points, data_start=(block - 1) * BLOCK)
        for points, block in product(*({value, stated[name] or value} for name, value in in_header.items()))
    ]
    counts = _stated_frames(structure).values()
    fitting = [item for item in candidates if item.data_start > start and any(map(item.fits, counts))]
    if len(fitting) != 1:
        return structure
    values = fitting[0].n_points, fitting[0].data_start // BLOCK + 1
    for (name, header), value in zip(in_header.items(), values, strict=True):
        if stated[name] not in (0, header):
            structure.notes.append(
                f"{name} is {stated[name]}, {header} in the header; {value} fits the file's size"
            )
            structure.parameters[name] = [value]
    return fitting[0]


def _stated_frames(structure: C3dStructure) -> dict[str, int]:
    """Return the stated number of frames by place in the file, without places that cannot represent this number."""
    statements, parameters = {}, structure.parameters
    last_frame = structure.first_frame + structure.n_frames - 1
    if last_frame < MAX_COUNT:
        statements["the header"] = structure.n_frames
    if parameters.get("POINT:FRAMES"):
        frames = int(parameters["POINT:FRAMES"][0])
        frames = frames if frames > MAX_COUNT else frames % 65536
        if frames != MAX_COUNT and not (frames == 0 and last_frame >= MAX_COUNT):
            statements["POINT:FRAMES"] = frames
    if long := parameters.get("POINT:LONG_FRAMES"):
        statements["POINT:LONG_FRAMES"] = int(long[0]) if len(long) == 1 else _long_integer(long)
    first, last = (parameters.get(f"TRIAL:ACTUAL_{end}_FIELD") for end in ("START", "END"))
    if first and last:
        frames = _long_integer(last) - _long_integer(first) + 1
        statements["TRIAL:ACTUAL_START_FIELD and ACTUAL_END_FIELD"] = frames
    return statements


def _check_agreement(path: Path, structure: C3dStructure) -> None:
    """Raise if header and parameters disagree, or have implausible values."""
    problems, parameters = Problems(str(path)), structure.parameters
    required = (f"POINT:{name}" for name in ("USED", "SCALE", "RATE", "LABELS"))
    if missing := [name for name in required if not parameters.get(name)]:
        raise InputError(f"{path}: {', '.join(missing)}: missing or empty; export the recording again")
    stated = {
        "number of points": (structure.n_points, int(parameters["POINT:USED"][0]) % 65536, "POINT:USED"),
        "scale factor": (structure.scale, parameters["POINT:SCALE"][0], "POINT:SCALE"),
        "rate": (structure.rate, parameters["POINT:RATE"][0], "POINT:RATE"),
    }
    if start := int((parameters.get("POINT:DATA_START") or [0])[0]) % 65536:
        stated["data block"] = (structure.data_start // BLOCK + 1, start, "POINT:DATA_START")
    for quantity, (in_header, in_parameters, name) in stated.items():
        if not np.isclose(in_header, in_parameters, rtol=_RATE_TOLERANCE, atol=0):
            problems.add(quantity, f"{in_header:g} in the header, {in_parameters:g} in {name}")
    problems.raise_if_any()
    low, high = RATES_HZ  # in another processor's format the rate is about 1e-42
    if not structure.n_points or not low <= structure.rate <= high:
        problem = f"{structure.n_points} points at {structure.rate:g} Hz"
        raise InputError(f"{path}: {problem}; both must be positive, the rate {low:g} to {high:g} Hz")
    if not np.isfinite(structure.scale) or structure.scale == 0:
        raise InputError(f"{path}: scale factor {structure.scale:g}; it must be finite and not 0")


def _count_frames(path: Path, structure: C3dStructure) -> int:
    """Return the number of frames; all stated numbers, or all that fit the file's size, must agree within one frame."""
    statements = _stated_frames(structure)
    if not statements:
        raise InputError(
            f"{path}: 65535 frames or more, and neither POINT:LONG_FRAMES nor "
            "TRIAL:ACTUAL_END_FIELD says how many; cut the recording"
        )
    counts = sorted(statements.values())
    listed = ", ".join(f"{frames} in {place}" for place, frames in statements.items())
    if counts[-1] - counts[0] > _FRAME_TOLERANCE:
        counts = [count for count in counts if structure.fits(count)]
        if not counts or counts[-1] - counts[0] > _FRAME_TOLERANCE:
            raise InputError(f"{path}: the number of frames is {listed}; export the recording again")
    if counts[0] < 1:
        raise InputError(f"{path}: {counts[0]} frames")
    if set(statements.values()) != {counts[0]}:
        structure.notes.append(f"the number of frames is {listed}; {counts[0]} were read")
    return counts[0]


def _check_analog(path: Path, structure: C3dStructure) -> None:
    """Check the analog samples per frame; a wrong number displaces every coordinate after the first frame."""
    parameters, n_analog = structure.parameters, structure.n_analog
    channels, rate = parameters.get("ANALOG:USED"), parameters.get("ANALOG:RATE")
    if not channels or not rate:
        return
    used, ratio = int(channels[0]) % 65536, rate[0] / structure.rate
    if np.isclose(used * ratio, n_analog, rtol=_RATE_TOLERANCE, atol=0):
        return
    is_rounded = used and n_analog % used == 0 and abs(ratio - n_analog / used) < 0.5
    # The number is also certain if the data fit the file's size, and would not with one number more or less per frame.
    is_certain = structure.fits(structure.n_frames) and structure.n_frames * structure.word_bytes >= BLOCK
    problem = f"{n_analog} in the header, {used * ratio:g} in ANALOG:USED and ANALOG:RATE"
    if not (is_rounded or is_certain):
        raise InputError(f"{path}: analog samples per frame: {problem}; they must agree")
    structure.notes.append(f"analog samples per frame: {problem}; the header's were taken")


def _check_size(path: Path, content: mmap.mmap, structure: C3dStructure) -> None:
    """Check that the file contains all frames, followed by at most the padding of the last block."""
    frame_bytes, available = structure.frame_bytes, structure.size - structure.data_start
    other = replace(structure, scale=-structure.scale)
    if other.fits(structure.n_frames) and not structure.fits(structure.n_frames):
        raise InputError(
            f"{path}: scale factor {structure.scale:g} means {8 * structure.word_bytes}-bit numbers, but the file's size fits "
            f"{8 * other.word_bytes}-bit numbers; export the recording again"
        )
    if available < structure.n_frames * frame_bytes:
        raise InputError(
            f"{path}: {structure.n_frames} frames of {frame_bytes} bytes are announced, but the file holds "
            f"{available // frame_bytes}; it is cut short: copy or export it again"
        )
    rest = content[structure.data_start + structure.n_frames * frame_bytes :]
    is_padded = len(rest) < BLOCK and not structure.size % BLOCK
    if is_padded or available in {frames * frame_bytes for frames in _stated_frames(structure).values()}:
        return
    if rotations := _rotation_bytes(structure):
        # Padding of the points' last block and of the file's last block.
        start = (int(structure.parameters["ROTATION:DATA_START"][0]) - 1) * BLOCK
        padding = start - (structure.size - len(rest)), structure.size - start - rotations
        if all(0 <= size < BLOCK for size in padding):
            structure.notes.append("rotation matrices after the points were not read")
            return
    problem = f"{len(rest)} bytes follow the last of {structure.n_frames} frames"
    # A writer pads with equal bytes; by chance, so may be the last number, pushed out by an inserted one.
    if structure.size % BLOCK and len(set(rest)) > 1:
        raise InputError(
            f"{path}: {problem}, and do not fill a block of {BLOCK}: bytes were inserted into the file; copy or export it again"
        )
    structure.notes.append(f"{problem} and were not read: if bytes were inserted, coordinates are displaced")


def _rotation_bytes(structure: C3dStructure) -> int:
    """Return the size of the rotation matrices that follow the points: 16 elements and a reliability each, as 4-byte reals."""
    used, start, ratio = (
        int((structure.parameters.get(f"ROTATION:{name}") or [default])[0]) % 65536
        for name, default in (("USED", 0), ("DATA_START", 0), ("RATIO", 1))
    )
    return used * ratio * structure.n_frames * 17 * 4 if start else 0
