"""The parameter section of a C3D file: groups of named values, by the letter of the C3D user guide (www.c3d.org)."""

from __future__ import annotations

import math
import mmap
import struct
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError

INTEL, DEC, MIPS = 84, 85, 86
_ITEM_BYTES = {-1: 1, 1: 1, 2: 2, 4: 4}


def real(raw: bytes, processor: int) -> float:
    """Decode one 4-byte real number."""
    return float(reals(np.frombuffer(raw, np.uint8), processor)[0])


def reals(raw: np.ndarray, processor: int) -> np.ndarray:
    """Decode reals: IEEE in the file's byte order, or DEC's: halves swapped and four times larger.

    Parameters
    ----------
    raw : ndarray of uint8, shape (..., 4 n)

    Returns
    -------
    ndarray of float, shape (..., n)
    """
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
        if body + 3 > end or group == 0 or not _is_name(name):
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


def _is_name(name: bytes) -> bool:
    return all(32 <= byte < 127 for byte in name)


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
