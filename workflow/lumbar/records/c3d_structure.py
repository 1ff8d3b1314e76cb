"""The structure and the parameters of a C3D file, checked before any library opens it.

C3D libraries trust the header: a file that is cut short comes back as a shorter recording, a missing
parameter shifts every coordinate, and a corrupt parameter section can end the whole process. Here the header
and the parameters are read by the letter of the C3D user guide (www.c3d.org), compared with each other and
with the size of the file. What contradicts itself so that coordinates could be wrong is refused; what sound
systems are known to write (a frame more or less, a rate rounded, a parameter without a group) is read, and
noted.
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
_ITEM_BYTES = {-1: 1, 1: 1, 2: 2, 4: 4}


def real(raw: bytes, processor: int) -> float:
    """Decode one 4-byte real number."""
    return float(reals(np.frombuffer(raw, np.uint8), processor)[0])


def reals(raw: np.ndarray, processor: int) -> np.ndarray:
    """Decode reals, raw of shape (..., 4 n): IEEE in the file's byte order, or DEC's: halves swapped and four times larger."""
    raw = np.ascontiguousarray(raw)
    with np.errstate(invalid="ignore"):  # a NaN may be of the signalling kind
        if processor == MIPS:
            return raw.view(">f4").astype(float)
        if processor == INTEL:
            return raw.view("<f4").astype(float)
        halves = raw.view("<u2")
        halves = halves.reshape(*halves.shape[:-1], -1, 2)[..., ::-1]
        return np.ascontiguousarray(halves).view("<f4")[..., 0].astype(float) / 4


def integers(raw: np.ndarray, processor: int) -> np.ndarray:
    """Decode 2-byte integers, raw of shape (..., 2 n)."""
    return np.ascontiguousarray(raw).view(">i2" if processor == MIPS else "<i2").astype(int)


def long_integer(words: list) -> int:
    """32 bits from two 16-bit words, the low one first."""
    low, high = (int(word) % 65536 for word in (*words, 0)[:2])
    return low + 65536 * high


def read_parameters(
    path: Path, content: bytes | mmap.mmap, position: int, end: int, processor: int, notes: list[str]
) -> dict[str, list]:
    """Read the parameters from `position` on by ``GROUP:NAME``; they may come before their group.

    Numbers come as lists, characters as lists of stripped strings. A parameter that belongs to no group is left
    out, and of one that stands twice with different values both are: `notes` says so.

    Raises
    ------
    InputError
        An entry that runs beyond the section or points into another.
    """
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
            if groups.get(-group, text) != text:
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
    return _by_name(groups, entries, notes)


def _by_name(
    groups: dict[int, str], entries: list[tuple[int, str, list]], notes: list[str]
) -> dict[str, list]:
    orphans = sorted({name for group, name, _ in entries if group not in groups})
    if orphans:
        notes.append(f"the parameters {', '.join(orphans)} belong to no group and were left out")
    parameters: dict[str, list] = {}
    twice = set()
    for group, name, values in entries:
        full = f"{groups.get(group)}:{name}"
        # NaN differs from itself: what stands there, not what it equals, is compared.
        if group in groups and str(parameters.setdefault(full, values)) != str(values):
            twice.add(full)
    for name in sorted(twice):
        notes.append(f"{name} stands twice with different values and was left out")
        del parameters[name]
    return parameters


def _parameter_values(
    path: Path, content: bytes | mmap.mmap, position: int, end: int, processor: int, name: str
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
    count = math.prod(dimensions)
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
        return reals(np.frombuffer(raw, np.uint8), processor).tolist(), stop
    if kind == 2:
        return integers(np.frombuffer(raw, np.uint8), processor).tolist(), stop
    return np.frombuffer(raw, "i1").astype(int).tolist(), stop


BLOCK = 512
_MAGIC = 0x50
_PROCESSORS = {INTEL: "Intel", DEC: "DEC", MIPS: "MIPS"}
SATURATED = 65535
"""Largest frame number that the header and POINT:FRAMES can hold: longer recordings say so elsewhere."""
_RATE_TOLERANCE = 1e-4
_FRAME_TOLERANCE = 1
"""How far statements of the number of frames may differ: systems count from 0 or from 1. The fewest are read."""
_TEXT = ("POINT:LABELS", "POINT:UNITS", "POINT:TYPE_GROUPS")
_NUMBERS = {
    *("POINT:USED", "POINT:SCALE", "POINT:RATE", "POINT:FRAMES", "POINT:LONG_FRAMES", "POINT:DATA_START"),
    *("ANALOG:USED", "ANALOG:RATE", "ANALOG:GEN_SCALE", "TRIAL:ACTUAL_START_FIELD", "TRIAL:ACTUAL_END_FIELD"),
    *("EVENT:USED", "FORCE_PLATFORM:USED", "FORCE_PLATFORM:ZERO"),
}
"""Parameters that are read here, by what must stand in them."""


@dataclass(frozen=True)
class C3dStructure:
    """What a sound C3D file says of itself."""

    processor: int
    """84 Intel, 85 DEC, 86 MIPS (big-endian)."""
    n_points: int
    n_frames: int
    first_frame: int
    n_analog: int
    """Analog samples per frame of points, over all channels."""
    rate: float
    """Frames of points per second."""
    parameters: dict[str, list]
    """By ``GROUP:NAME``; numbers as lists, characters as lists of stripped strings."""
    data_start: int
    """First byte of the data."""
    scale: float
    """Negative: coordinates are stored as 4-byte reals. Positive: as 2-byte integers to be multiplied by it."""
    notes: tuple[str, ...] = ()
    """What the file contradicts itself in without harm to a coordinate."""

    @property
    def word_bytes(self) -> int:
        """Bytes of one stored number."""
        return 4 if self.scale < 0 else 2

    @property
    def frame_bytes(self) -> int:
        """Bytes of one frame: four numbers per point, then the analog samples."""
        return (4 * self.n_points + self.n_analog) * self.word_bytes


def check_structure(path: Path) -> C3dStructure:
    """Read header and parameters of a C3D file and check that they fit each other and the file.

    Raises
    ------
    InputError
        With every contradiction found.
    """
    size = path.stat().st_size
    if size < 2 * BLOCK:
        raise InputError(f"{path}: {size} bytes; a C3D file has a header of 512 bytes, parameters and data")
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        if content[1] != _MAGIC or not content[0]:
            raise InputError(f"{path}: not a C3D file (its second byte is {content[1]:#04x}, not 0x50)")
        start = (content[0] - 1) * BLOCK
        if start + BLOCK > size or start < BLOCK:
            raise InputError(
                f"{path}: the parameter section should start at byte {start}; the file has {size}"
            )
        stated = content[start + 3]
        try:
            return _of_processor(path, content, start, stated)
        except InputError:
            for processor in _PROCESSORS.keys() - {stated}:
                with contextlib.suppress(InputError):
                    found = _of_processor(path, content, start, processor)
                    if _fits(size, found.data_start, found.n_frames * found.frame_bytes):
                        name = _PROCESSORS[processor]
                        note = (
                            f"processor type {stated}; it is {processor} ({name}) that fits the file's size"
                        )
                        return replace(found, notes=(*found.notes, note))
            raise


def _of_processor(path: Path, content: mmap.mmap, start: int, processor: int) -> C3dStructure:
    if processor not in _PROCESSORS:
        known = ", ".join(f"{number} ({name})" for number, name in _PROCESSORS.items())
        raise InputError(f"{path}: processor type {processor}; allowed are {known}")
    order = ">" if processor == MIPS else "<"
    points, analog, first, last, _, _, _, data_block, _ = struct.unpack(order + "9H", content[2:20])
    notes: list[str] = []
    scale, rate = real(content[12:16], processor), real(content[20:24], processor)
    sizes, data_start = (points, last - first + 1, first, analog), (data_block - 1) * BLOCK
    within = start < data_start < len(content)
    end = data_start if within else min(start + content[start + 2] * BLOCK, len(content))
    parameters = read_parameters(path, content, start + 4, end, processor, notes)
    problems = Problems(str(path))
    for name, values in parameters.items():
        needed = "text" if name.startswith(_TEXT) else "finite numbers" if name in _NUMBERS else None
        are_texts = [isinstance(value, str) for value in values]
        if needed == "text" and not all(are_texts):
            problems.add(name, f"{values[:3]}", "text must stand there")
        if needed == "finite numbers" and (any(are_texts) or not np.isfinite(values).all()):
            problems.add(name, f"{values[:3]}", "finite numbers must stand there")
    problems.raise_if_any()
    header = _complete(C3dStructure(processor, *sizes, rate, parameters, data_start, scale), notes)
    header = _settled(header, len(content), start, notes)
    if not start < header.data_start < len(content):
        raise InputError(
            f"{path}: the data should start at byte {header.data_start}, after the parameters at {start} and before "
            f"the end of the file at {len(content)}; the file is cut short or its header is corrupt"
        )
    if not header.n_points and analog:
        raise InputError(
            f"{path}: no points, only analog channels, as a force plate writes them; give the recording of the markers"
        )
    _check_agreement(path, header)
    _check_header(path, header)
    frames, field = _frame_count(path, header, len(content), notes), "TRIAL:ACTUAL_START_FIELD"
    first = long_integer(parameters[field]) if parameters.get(field) else first
    structure = replace(header, n_frames=frames, first_frame=first)
    available = len(content) - header.data_start
    _check_analog(path, available, structure, notes)
    _check_size(path, content, structure, notes)
    return replace(structure, notes=tuple(notes))


def _fits(size: int, start: int, data: int) -> bool:
    """Whether a file ends in the block in which its data do."""
    return 0 <= size - start - data < BLOCK


def _settled(header: C3dStructure, size: int, start: int, notes: list[str]) -> C3dStructure:
    """Where header and parameters differ in what the size of the file decides, take the ones of both that fit it."""
    own = {"POINT:USED": header.n_points, "POINT:DATA_START": header.data_start // BLOCK + 1}
    stated = {name: int((header.parameters.get(name) or [0])[0]) % 65536 for name in own}
    fitting = []
    for points, block in product(*({own[name], stated[name] or own[name]} for name in own)):
        one = replace(header, n_points=points, data_start=(block - 1) * BLOCK)
        data = (frames * one.frame_bytes for frames in _stated_frames(header).values())
        if one.data_start > start and any(_fits(size, one.data_start, many) for many in data):
            fitting.append((one, {"POINT:USED": points, "POINT:DATA_START": block}))
    if len(fitting) != 1:
        return header
    settled, values = fitting[0]
    for name, value in values.items():
        if stated[name] not in (0, own[name]):
            notes.append(f"{name} is {stated[name]}, {own[name]} in the header; {value} fits the file's size")
            header.parameters[name] = [value]
    return settled


def _stated_frames(header: C3dStructure) -> dict[str, int]:
    """Frames of points by every statement in the file that can hold the number."""
    statements, parameters = {}, header.parameters
    last_frame = header.first_frame + header.n_frames - 1
    if last_frame < SATURATED:
        statements["the header"] = header.n_frames
    if parameters.get("POINT:FRAMES"):
        frames = int(parameters["POINT:FRAMES"][0])
        frames = frames if frames > SATURATED else frames % 65536
        if frames != SATURATED and not (frames == 0 and last_frame >= SATURATED):
            statements["POINT:FRAMES"] = frames
    if parameters.get("POINT:LONG_FRAMES"):
        words = parameters["POINT:LONG_FRAMES"]
        statements["POINT:LONG_FRAMES"] = int(words[0]) if len(words) == 1 else long_integer(words)
    first, last = (parameters.get(f"TRIAL:ACTUAL_{end}_FIELD") for end in ("START", "END"))
    if first and last:
        frames = long_integer(last) - long_integer(first) + 1
        statements["TRIAL:ACTUAL_START_FIELD and ACTUAL_END_FIELD"] = frames
    return statements


def _frame_count(path: Path, header: C3dStructure, size: int, notes: list[str]) -> int:
    """Frames of points; all statements must agree but for one frame, or those must that fit the size of the file."""
    statements = _stated_frames(header)
    if not statements:
        raise InputError(
            f"{path}: 65535 frames or more, and neither POINT:LONG_FRAMES nor "
            "TRIAL:ACTUAL_END_FIELD says how many; cut the recording"
        )
    counts = sorted(statements.values())
    found = ", ".join(f"{frames} in {place}" for place, frames in statements.items())
    if counts[-1] - counts[0] > _FRAME_TOLERANCE:
        counts = [count for count in counts if _fits(size, header.data_start, count * header.frame_bytes)]
        if not counts or counts[-1] - counts[0] > _FRAME_TOLERANCE:
            raise InputError(f"{path}: the number of frames is {found}; export the recording again")
    if counts[0] < 1:
        raise InputError(f"{path}: {counts[0]} frames")
    if set(statements.values()) != {counts[0]}:
        notes.append(f"the number of frames is {found}; {counts[0]} were read")
    return counts[0]


def _complete(header: C3dStructure, notes: list[str]) -> C3dStructure:
    """Take rate and scale factor from the header where the parameters lack them, or the other way round."""
    for key, name in (("scale", "POINT:SCALE"), ("rate", "POINT:RATE")):
        stated, own = header.parameters.get(name), getattr(header, key)
        in_header = np.isfinite(own) and own != 0
        if not stated and in_header:
            header.parameters[name] = [own]
            notes.append(f"{name} is missing; the header's {own:g} was taken")
        elif stated and not in_header and stated[0] != 0:
            notes.append(f"the header has no {key}; {name}, {stated[0]:g}, was taken")
            header = replace(header, **{key: stated[0]})
        elif key == "scale" and stated and max(stated[0], own) < 0 and stated[0] != own:
            # Its sign alone counts where coordinates are stored as reals.
            header.parameters[name] = [own]
    return header


def _check_agreement(path: Path, header: C3dStructure) -> None:
    """Compare header and parameters."""
    problems, parameters = Problems(str(path)), header.parameters
    for name in ("USED", "SCALE", "RATE", "LABELS"):
        if not parameters.get(f"POINT:{name}"):
            problems.add(f"POINT:{name}", "missing or empty", "a reader cannot do without it")
    problems.raise_if_any()
    stated = {
        "number of points": (header.n_points, int(parameters["POINT:USED"][0]) % 65536, "POINT:USED"),
        "scale factor": (header.scale, parameters["POINT:SCALE"][0], "POINT:SCALE"),
        "rate": (header.rate, parameters["POINT:RATE"][0], "POINT:RATE"),
    }
    start = int((parameters.get("POINT:DATA_START") or [0])[0]) % 65536
    if start:
        stated["data block"] = (header.data_start // BLOCK + 1, start, "POINT:DATA_START")
    for quantity, (in_header, in_parameters, name) in stated.items():
        if not np.isclose(in_header, in_parameters, rtol=_RATE_TOLERANCE, atol=0):
            problems.add(
                quantity, f"{in_header:g} in the header, {in_parameters:g} in {name}", "they must agree"
            )
    problems.raise_if_any()


def _check_header(path: Path, header: C3dStructure) -> None:
    """Numbers without which no frame can be found."""
    problems = Problems(str(path))
    if (
        not header.n_points or not RATES_HZ[0] <= header.rate <= RATES_HZ[1]
    ):  # of another processor's it is 1e-42
        allowed = f"both must be positive, the rate {RATES_HZ[0]:g} to {RATES_HZ[1]:g} Hz"
        problems.add("header", f"{header.n_points} points at {header.rate:g} Hz", allowed)
    if not np.isfinite(header.scale) or header.scale == 0:
        problems.add("header", f"scale factor {header.scale:g}", "a finite number other than 0 is needed")
    problems.raise_if_any()


def _check_analog(path: Path, available: int, structure: C3dStructure, notes: list[str]) -> None:
    """Analog samples per frame, which shift every coordinate after the first frame if they are wrong."""
    parameters, n_analog = structure.parameters, structure.n_analog
    channels, rate = parameters.get("ANALOG:USED"), parameters.get("ANALOG:RATE")
    if not channels or not rate:
        return
    used, ratio = int(channels[0]) % 65536, rate[0] / structure.rate
    if np.isclose(used * ratio, n_analog, rtol=_RATE_TOLERANCE, atol=0):
        return
    rounded = used and n_analog % used == 0 and abs(ratio - n_analog / used) < 0.5
    # A size that fits to the block, where one word more or less would not, leaves no doubt either.
    spare = available - structure.n_frames * structure.frame_bytes
    fits = 0 <= spare < BLOCK <= structure.n_frames * structure.word_bytes
    found = f"{n_analog} in the header, {used * ratio:g} in ANALOG:USED and ANALOG:RATE"
    if not (rounded or fits):
        raise InputError(f"{path}: analog samples per frame: {found}; they must agree")
    notes.append(f"analog samples per frame: {found}; the header's were taken")


def _check_size(path: Path, content: mmap.mmap, structure: C3dStructure, notes: list[str]) -> None:
    """Every frame must be in the file, and behind the last nothing but what fills the block."""
    size, available = structure.frame_bytes, len(content) - structure.data_start
    if available < structure.n_frames * size:
        raise InputError(
            f"{path}: {structure.n_frames} frames of {size} bytes are announced, but the file holds "
            f"{available // size}; it is cut short: copy or export it again"
        )
    behind = content[structure.data_start + structure.n_frames * size :]
    ends = {frames * size for frames in _stated_frames(structure).values()}
    if available in ends or (len(behind) < BLOCK and not len(content) % BLOCK):
        return
    found = f"{len(behind)} bytes follow the last of {structure.n_frames} frames"
    # A writer's own filling is all alike; so may be, by chance, the last word that an inserted one has pushed out.
    if len(content) % BLOCK and len(set(behind)) > 1:
        raise InputError(
            f"{path}: {found}, and do not fill a block of {BLOCK}: bytes were inserted into the file; copy or export it again"
        )
    notes.append(f"{found} and were not read: if bytes were inserted, coordinates are displaced")
