"""How far the outputs of two runs agree: the same bytes, the same numbers to so many digits, or not.

Digits are counted relative to the largest number of the same kind: of a column of a CSV file, of a key of a JSON
file, of all numbers in any other text (numbers in the cells and strings of the former two are a kind of their own).
"""

from __future__ import annotations

import io
import json
import math
import re
import zipfile
from collections import defaultdict
from pathlib import Path

import numpy as np
import pandas as pd

SAME_BYTES = math.inf
DIFFERENT = -math.inf
NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w.]*\w)")
SVG_NAME = re.compile(r"\b[a-z][0-9a-f]{10}\b")
"""What Matplotlib calls a shape: a hash of its numbers."""
NOT_RESULTS = ("logs", "benchmarks", "run_environment.json")
"""Times, memory, and which versions were used."""


def compare_folders(one: Path, other: Path) -> dict[str, float]:
    """Return, by file, the digits to which two folders of results agree.

    `SAME_BYTES` for equal files, `DIFFERENT` for files that differ in more than numbers or of which one is missing.
    """
    names = {
        str(path.relative_to(folder))
        for folder in (one, other)
        for path in folder.rglob("*")
        if path.is_file() and path.relative_to(folder).parts[0] not in NOT_RESULTS
    }
    return {
        name: digits((one / name).read_bytes(), (other / name).read_bytes(), Path(name).suffix)
        if (one / name).is_file() and (other / name).is_file()
        else DIFFERENT
        for name in sorted(names)
    }


def digits(one: bytes, other: bytes, suffix: str) -> float:
    """Return the digits to which two files agree (see `compare_folders`)."""
    if one == other:
        return SAME_BYTES
    if suffix == ".fmu":
        return _archive_digits(one, other)
    try:
        kinds = [_numbers(text.decode("utf-8"), suffix) for text in (one, other)]
    except UnicodeDecodeError:
        return DIFFERENT
    (first_text, first), (second_text, second) = kinds
    if first_text != second_text or {key: len(v) for key, v in first.items()} != {
        key: len(v) for key, v in second.items()
    }:
        return DIFFERENT
    # Other bytes can hold the same numbers: a double has 17 digits.
    return min((_column_digits(first[key], second[key]) for key in first), default=DIFFERENT)


def _column_digits(one: list[float], other: list[float]) -> float:
    a, b = np.array(one, dtype=float), np.array(other, dtype=float)
    if not np.array_equal(np.isfinite(a), np.isfinite(b)):
        return DIFFERENT
    a, b = a[np.isfinite(a)], b[np.isfinite(b)]
    moved = np.abs(a - b).max(initial=0.0)
    return 17.0 if moved == 0 else -math.log10(moved / max(np.abs(a).max(), np.abs(b).max()))


def _numbers(text: str, suffix: str) -> tuple[object, dict[str, list[float]]]:
    """Return what is no number, and the numbers by kind."""
    if suffix == ".csv":
        frame = pd.read_csv(io.StringIO(text))
        numeric = [name for name in frame if frame[name].dtype.kind in "fi"]
        rest, numbers = _spoken(frame.drop(columns=numeric).to_csv(index=False))
        return (rest, tuple(frame.columns)), {**{name: frame[name].tolist() for name in numeric}, **numbers}
    if suffix == ".json":
        numbers, rest = defaultdict(list), []
        _walk(json.loads(text), "", numbers, rest)
        return rest, dict(numbers)
    return _spoken(SVG_NAME.sub("shape", text) if suffix == ".svg" else text)


def _spoken(text: str) -> tuple[str, dict[str, list[float]]]:
    """Return a text without its numbers, and the numbers."""
    found = [float(match.replace("−", "-")) for match in NUMBER.findall(text)]
    return NUMBER.sub("#", text), {"text": found}


def _walk(item, key: str, numbers: dict, rest: list) -> None:
    if isinstance(item, dict):
        for name, value in item.items():
            _walk(value, f"{key}/{name}", numbers, rest)
    elif isinstance(item, list):
        for value in item:
            _walk(value, key, numbers, rest)
    elif isinstance(item, (int, float)) and not isinstance(item, bool):
        numbers[key].append(float(item))
    else:
        words, found = _spoken(str(item))
        rest.append((key, words))
        numbers["text"] += found["text"]


def _archive_digits(one: bytes, other: bytes) -> float:
    with zipfile.ZipFile(io.BytesIO(one)) as first, zipfile.ZipFile(io.BytesIO(other)) as second:
        if first.namelist() != second.namelist():
            return DIFFERENT
        return min(
            digits(first.read(name), second.read(name), Path(name).suffix) for name in first.namelist()
        )
