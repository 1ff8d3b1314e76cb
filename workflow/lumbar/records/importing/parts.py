"""The parts of a table that become records: all of it, spans of its clock, or what a column names or numbers alike."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.base.files import as_name
from lumbar.records.importing.raw_table import RawTable
from lumbar.records.importing.roles import Choices, wished
from lumbar.records.record import FEWEST_SAMPLES, samples_between

_MOST_PARTS = 200
_OTHERS = "_.-"
"""What a record's name holds beside letters and digits."""


@dataclass(frozen=True)
class Part:
    """Samples of a table that become one record."""

    name: str
    """Of the record."""
    keep: np.ndarray
    """Shape (samples,): their numbers in the table."""
    why: str = ""
    """What says so; empty for the whole table."""


def record_name(text: str) -> str:
    """Name of a record for any text."""
    return as_name(text, "record", _OTHERS)


def parts_of(table: RawTable, time: np.ndarray, choices: Choices, name: str) -> list[Part]:
    """Part a table as was asked for; `name` is that of the file's record.

    Raises
    ------
    InputError
        With all parts that are empty, share samples or cannot be named.
    """
    samples = len(time)
    if choices.cut:
        parts = _spans(table, time, choices.cut)
    elif choices.cut_by is not None:
        parts = _stretches(table, choices.cut_by, name)
    elif choices.trim is not None:
        keep = samples_between(time, choices.trim, table.source)
        return [
            Part(
                name, keep, f"{samples - keep.size} of {samples} samples lie outside --trim and are left out"
            )
        ]
    else:
        return [Part(name, np.arange(samples))]
    return [
        Part(part.name, part.keep, f"{part.keep.size} of {samples} samples: {part.why}") for part in parts
    ]


def _spans(table: RawTable, time: np.ndarray, cut: tuple[tuple[str, tuple[float, float]], ...]) -> list[Part]:
    problems, parts = Problems(table.source), []
    names = [name for name, _ in cut]
    for name in dict.fromkeys(name for name in names if names.count(name) > 1):
        problems.add("--cut", f"{names.count(name)} parts are named {name!r}")
    for name, (start, stop) in cut:
        option = f"--cut {name}={_edge(start)}:{_edge(stop)}"
        if name != record_name(name):
            problems.add(option, f"{name!r} names no record", "letters, digits, _, . and - are allowed")
        elif not start < stop:
            problems.add(option, "the start must lie before the stop")
        else:
            try:
                parts.append(Part(name, samples_between(time, (start, stop), option), option))
            except InputError as error:
                problems.add("", str(error))
    ordered = sorted((span, name) for name, span in cut if span[0] < span[1])
    for ((_, stop), one), ((start, end), other) in pairwise(ordered):
        if start < stop:
            problems.add("--cut", f"{one} and {other} share {start:g} to {min(stop, end):g} s")
    problems.raise_if_any()
    return parts


def _edge(seconds: float) -> str:
    return f"{seconds:.9g}" if np.isfinite(seconds) else ""


def _stretches(table: RawTable, wish: str, name: str) -> list[Part]:
    """Runs of rows in which a column says one thing; a thing said again later has a number behind its name."""
    column, _ = wished((*table.columns, *table.words), wish, "cut-by")
    said = column.values
    edges = [0, *(np.flatnonzero(said[1:] != said[:-1]) + 1).tolist(), len(said)]
    stretches = [(first, stop) for first, stop in pairwise(edges) if np.isfinite(said[first])]
    if not 0 < len(stretches) <= _MOST_PARTS:
        raise InputError(
            f"{table.source}: --cut-by: {column.label} has {len(stretches)} stretches of one value; 1 to {_MOST_PARTS} become "
            "records"
        )
    problems, parts = Problems(table.source), []
    times: dict[str, int] = {}
    for first, stop in stretches:
        at = int(said[first])
        word = column.spellings[at] if column.spellings else f"{said[first]:g}"
        own = f"{name}_{as_name(word, str(at + 1), _OTHERS)}"
        times[own] = times.get(own, 0) + 1
        own = own if times[own] == 1 else f"{own}_{times[own]}"
        if stop - first < FEWEST_SAMPLES:
            problems.add(own, f"{stop - first} samples", f"at least {FEWEST_SAMPLES} are needed")
        parts.append(Part(own, np.arange(first, stop), f"{column.label} is {word}"))
    problems.raise_if_any()
    return parts
