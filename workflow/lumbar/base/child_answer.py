"""What a child process that parsed a file answers: numbers, texts and known classes, which nothing has to be unpickled for."""

from __future__ import annotations

import json
import struct
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from lumbar.base.files import LARGEST_FILE

LARGEST_TEXT = 20_000_000
LARGEST_ANSWER = LARGEST_TEXT + 2 * LARGEST_FILE
"""Bytes of an answer without and with its arrays."""


def is_whole(answer: bytearray) -> bool:
    """Whether an answer has the sizes that it states."""
    return len(answer) >= 16 and sum(struct.unpack_from("=QQ", answer)) + 16 == len(answer)


def packed(kind: str, value: Any) -> list[bytes | memoryview]:
    """Sizes of the text and of the arrays, the text, and the arrays, each from a multiple of eight on."""
    arrays: list[np.ndarray] = []
    plain = plain_of(value, arrays)
    described, place = [], 0
    for array in arrays:
        described.append([array.dtype.str, array.shape, place])
        place += array.nbytes + -array.nbytes % 8
    text = json.dumps([kind, plain, described]).encode()
    text += b" " * (-len(text) % 8)
    parts: list[bytes | memoryview] = [struct.pack("=QQ", len(text), place), text]
    for array in arrays:
        parts += [memoryview(array.reshape(-1).view(np.uint8)), b"\0" * (-array.nbytes % 8)]
    return parts


def plain_of(value: Any, arrays: list[np.ndarray]) -> Any:
    """Return a value as JSON has it, a list as such and anything else that holds values as a dict of one key."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "biuf":
            raise TypeError(f"an array of {value.dtype}")
        arrays.append(np.asarray(value, order="C"))
        return {"array": len(arrays) - 1}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, range):
        return {"range": [value.start, value.stop]}
    if isinstance(value, tuple):
        return {"tuple": [plain_of(item, arrays) for item in value]}
    if isinstance(value, list):
        return [plain_of(item, arrays) for item in value]
    if isinstance(value, dict):
        return {"dict": [[plain_of(key, arrays), plain_of(item, arrays)] for key, item in value.items()]}
    if is_dataclass(value):
        own = {item.name: plain_of(getattr(value, item.name), arrays) for item in fields(value)}
        return {type(value).__name__: own}
    return value


def unpacked(answer: bytearray, kinds: dict[str, type]) -> tuple[str, Any]:
    """Kind and value of an answer whose sizes are those that it states."""
    size = struct.unpack_from("=Q", answer)[0]
    if size > LARGEST_TEXT:
        return "memory", ""
    kind, plain, described = json.loads(answer[16 : 16 + size])
    arrays = []
    for form, shape, place in described:
        dtype = np.dtype(str(form))
        if dtype.kind not in "biuf":
            raise TypeError(f"an array of {dtype}")
        count = int(np.prod(shape, dtype=int))
        arrays.append(np.frombuffer(answer, dtype, count, 16 + size + int(place)).reshape(shape))

    def made(value: Any) -> Any:
        if isinstance(value, list):
            return [made(item) for item in value]
        if not isinstance(value, dict):
            return value
        [(name, held)] = value.items()
        if name == "array":
            return arrays[held]
        if name == "range":
            return range(*held)
        if name == "tuple":
            return tuple(map(made, held))
        if name == "dict":
            return {made(key): made(item) for key, item in held}
        return kinds[name](**{key: made(item) for key, item in held.items()})

    return kind, made(plain)
