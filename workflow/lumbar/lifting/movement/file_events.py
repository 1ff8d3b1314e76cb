"""Events that somebody marked in the recording's own file: which of them are events of a lift, and how far from ours."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

from lumbar.base.errors import InputError
from lumbar.records.marker_file import RecordedEvent
from lumbar.records.markers import MarkerRecording

if TYPE_CHECKING:
    from lumbar.lifting.movement.event import Event
    from lumbar.settings.lifting import EventLabels

NEAREST_S = 5e-4
"""Differences below this are none."""


class SeveralEvents(Exception):
    """Marks of which any may be the one meant; the text says which."""


def marked(recording: MarkerRecording, labels: EventLabels, name: str) -> list[RecordedEvent]:
    """Events of the file, within the recording, whose label is one of those that stand for an event of a lift."""
    wanted = set(map(_folded, getattr(labels, name)))
    return [event for event in _within(recording) if _folded(event.label) in wanted]


def file_event(
    recording: MarkerRecording, labels: EventLabels, name: str, start: float, stop: float
) -> RecordedEvent | None:
    """Return the event of the file that stands for one of a lift; None where there is none.

    Parameters
    ----------
    labels : EventLabels
        Labels in the file that stand for each event.
    name : str
        E.g. ``"toe_off"``: of steps the first between `start` and `stop` is meant, in seconds; any other event stands once.

    Raises
    ------
    SeveralEvents
        The event stands more than once.
    """
    found = marked(recording, labels, name)
    if name == "toe_off":
        return next((event for event in found if start < event.time < stop), None)
    if len(found) > 1:
        times = ", ".join(f"{described(event)} at {event.time:.2f} s" for event in found)
        raise SeveralEvents(f"{times}: which one is meant is not known (window_s of the trial takes one out)")
    return found[0] if found else None


def refuse_without(recording: MarkerRecording, labels: EventLabels, names: tuple[str, ...]) -> None:
    """Raise `InputError` where the file's events are to be taken, and it has none of a lift."""
    if any(marked(recording, labels, name) for name in names):
        return
    within = _within(recording)
    found = f"holds {', '.join(sorted({repr(event.label) for event in within}))}" if within else "holds none"
    outside = len(recording.events) - len(within)
    found += f", and {outside} outside {_span(recording)}" if outside else ""
    raise InputError(
        f"{recording.source}: its own events are to be taken, but it {found}; lifting.events.labels says which labels mean "
        "lift_off, toe_off, deposit_start and release; or take those detected (lifting.events.taken_from, the trial's events)"
    )


def comparison(recording: MarkerRecording, events: Mapping[str, Event], labels: EventLabels) -> list[str]:
    """Say in sentences how far the file's events lie from those detected, and which of its labels mean none of a lift."""
    lines = [f"events of the file: {line}" for name in events if (line := _compared(name, events[name]))]
    meant = {name: marked(recording, labels, name) for name in events}
    within = _within(recording)
    unnamed = [event for event in within if not any(event in found for found in meant.values())]
    unused = [event for name, found in meant.items() for event in found if not events[name].file]
    for found, why in (
        (unnamed, "whose labels mean none of a lift by lifting.events.labels"),
        (unused, "that are not compared, for they do not lie between a lift-off and a release"),
    ):
        lines += [f"events of the file {why}: {_listed(found)}"] if found else []
    outside = [event for event in recording.events if event not in within]
    lines += (
        [f"events of the file outside {_span(recording)}, not used: {_listed(outside)}"] if outside else []
    )
    return lines


def _listed(events: list[RecordedEvent]) -> str:
    times: dict[str, list[str]] = {}
    for event in events:
        times.setdefault(described(event), []).append(f"{event.time:.2f}")
    return "; ".join(f"{label} at {', '.join(at)} s" for label, at in times.items())


def described(event: RecordedEvent) -> str:
    """Label of an event with its side, as the file has them."""
    return f"{event.context} {event.label}".strip()


def _compared(name: str, event: Event) -> str:
    if event.file_s is None:
        return f"{name}: {event.file}" if event.file else ""
    found = event.detected_s if event.method in ("declared", "file") else event.time_s
    said = f"{name} {event.file_s:.3f} s ({event.file})"
    if found is None:
        return f"{said}; detection finds none"
    late = found - event.file_s
    where = "the same" if abs(late) < NEAREST_S else f"{abs(late):.3f} s {'later' if late > 0 else 'earlier'}"
    return f"{said}; detection says {found:.3f} s, {where}"


def _within(recording: MarkerRecording) -> list[RecordedEvent]:
    first, last = recording.time[0], recording.time[-1]
    frame = 1 / recording.rate
    return [event for event in recording.events if first - frame <= event.time <= last + frame]


def _span(recording: MarkerRecording) -> str:
    return f"{recording.time[0]:.2f} to {recording.time[-1]:.2f} s"


def _folded(label: str) -> str:
    return re.sub(r"[\W_]+", "", label.lower())
