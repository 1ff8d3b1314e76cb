"""Records cut from one session: each begins in the state in which the ones before it left the tissue."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record

_MOVED_ON = 0.5
"""Of the time scale of a record, in which the tool goes where the next one begins, where the clock tells of no pause."""
_STEPS = 1.5
"""Largest steps of the records: a longer one between two of them is no step but a move that was not recorded."""
_LONGEST_PAUSE = 10.0
"""Durations of the whole session's records, beyond which a pause between two is a mistake of the clocks."""


def with_past(records: Sequence[Record]) -> dict[str, tuple[Record, int]]:
    """Every record with all that came before it in the session, and the sample at which its own part begins, by name.

    A pause between two records is taken from their clocks, where each begins after the one before it ended; else they follow
    one another at once. What was not recorded of the motion is filled in: the tool goes smoothly from where it was to where
    the next record begins, in the pause, or in 0.5 s where it is elsewhere all of a sudden. The force is filled in too, to
    be left out of every error.

    The records are in the order of the session, with the same channels.

    Raises
    ------
    InputError
        If they are not sampled alike, or a pause is longer than ten times all records together.
    """
    _check_alike(records)
    found: dict[str, tuple[Record, int]] = {}
    past: Record | None = None
    step = max(float(np.abs(np.diff(record["input"])).max()) for record in records)
    longest = _LONGEST_PAUSE * sum(record.duration for record in records)
    clocked = all(after.time[0] > before.time[-1] for before, after in pairwise(records))
    for index, record in enumerate(records):
        begins = 0
        if past is None:
            past = replace(record, time=np.arange(len(record)) * records[0].sampling_time)
        else:
            pause = float(record.time[0] - records[index - 1].time[-1]) if clocked else 0.0
            past, begins = _append(past, record, pause, step, longest)
        found[record.name] = (
            replace(past, name=record.name, source=record.source, period=record.period),
            begins,
        )
    return found


def in_session(
    records: Sequence[Record], simulate: Callable[[Record], np.ndarray]
) -> Callable[[Record], np.ndarray]:
    """A simulation of records that knows what came before each of them in the session."""
    known = with_past(records)

    def simulated(record: Record) -> np.ndarray:
        joined, begins = known[record.name]
        return simulate(joined)[begins:]

    return simulated


def check_sampled_alike(records: Sequence[Record], together: str) -> None:
    """Refuse records with different sampling times; `together` says what they are."""
    first = records[0]
    for record in records[1:]:
        if not np.isclose(record.sampling_time, first.sampling_time, rtol=1e-6):
            raise InputError(
                f"{record.source or record.name}: sampled every {record.sampling_time:g} s, {first.name} every "
                f"{first.sampling_time:g} s; {together} must be sampled alike: give a rate (tissue.rate_Hz)"
            )


def _check_alike(records: Sequence[Record]) -> None:
    check_sampled_alike(records, "records of one session")
    first = records[0]
    for record in records[1:]:
        if set(record.channels) != set(first.channels):
            raise InputError(
                f"{record.source or record.name}: has the channels {', '.join(record.channels)}, {first.name} "
                f"{', '.join(first.channels)}; records of one session need the same ones"
            )


def _append(past: Record, record: Record, pause: float, step: float, longest: float) -> tuple[Record, int]:
    """What came before and a record, with what was not recorded in between; and where the record begins."""
    if pause > longest:
        raise InputError(
            f"{record.source or record.name}: begins {pause:g} s after the record before it ended, which is more than "
            f"{_LONGEST_PAUSE:g} times all records together; records of one session follow one another: correct the times, or "
            "leave session out"
        )
    between = max(round(pause / past.sampling_time) - 1, 0)
    if not between and abs(record["input"][0] - past["input"][-1]) > _STEPS * step:
        between = round(_MOVED_ON * past.time_scale / past.sampling_time)
    share = np.arange(1, between + 1) / (between + 1)
    way = share**2 * (3 - 2 * share)
    channels = {}
    for role, channel in past.channels.items():
        before, after = channel.values, record[role]
        filled = before[-1] + way * (after[0] - before[-1])
        channels[role] = replace(channel, values=np.concatenate([before, filled, after]))
    begins = len(past) + between
    time = np.arange(begins + len(record)) * past.sampling_time
    return replace(past, time=time, channels=channels, filled=()), begins
