"""Events of a lift: when each is and how that was found, the phases between them, and marks in the recording's own file."""

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.lifting.movement.carried_object import carried_object
from lumbar.records.marker_file import RecordedEvent
from lumbar.records.markers import MarkerRecording
from lumbar.settings.lifting import EventLabels

EVENTS = ("lift_off", "toe_off", "deposit_start", "release")
"""In the order in which they happen. Any of them may be absent: a lifter deposits without a step, or not at all."""
NEAREST_S = 5e-4
"""Differences below this are none."""
DETECTED, DECLARED, IN_FILE, ABSENT = "detected", "declared", "file", "absent"


@dataclass(frozen=True)
class Event:
    """One event and how it was found."""

    time_s: float | None
    """On the recording's clock; None for an event that does not happen or cannot be told."""
    method: str
    """{"detected", "declared", "file", "absent"}."""
    how: str
    """The rule and the numbers behind it, or why there is no such event, for the reader."""
    detected_s: float | None = None
    """What detection says where the event is declared by hand or taken from the file; None where it finds nothing."""
    earliest_s: float | None = None
    latest_s: float | None = None
    """`earliest_s`, `latest_s`: between these the event has happened whatever the threshold: the last instant of no
    movement in its direction, and a tenth of the way done; None where the rule knows no such instants."""
    descent_s: float | None = None
    thesis_s: float | None = None
    """`descent_s`, `thesis_s`: starts of the deposit by either rule of ``events.deposit_start``, the second the thesis's;
    None where it finds nothing, and of other events."""
    file_s: float | None = None
    """What the recording's own file says; None where it says nothing, or several things."""
    file: str = ""
    """The file's label, or which ones it has."""

    def as_dict(self) -> dict:
        """Plain data for JSON."""
        return asdict(self)


def started_by(event: Event, rule: str) -> Event:
    """Return the start of the deposit by one rule of ``events.deposit_start``, from that by the other."""
    time = {"descent": event.descent_s, "wrist_minimum": event.thesis_s}[rule]
    return Event(
        time, ABSENT if time is None else DETECTED, f"by deposit_start: {rule}; otherwise {event.how}"
    )


def phases(time: np.ndarray, events: dict[str, Event]) -> np.ndarray:
    """Phase of every sample: before, lift, carry, deposit or after.

    Without a toe-off the lift lasts until the start of the deposit and there is no carry. Times and phases have shape (n,).
    """
    labels = np.full(len(time), "before", dtype="<U7")
    for label, name in (
        ("lift", "lift_off"),
        ("carry", "toe_off"),
        ("deposit", "deposit_start"),
        ("after", "release"),
    ):
        at = events[name].time_s
        if at is not None:
            labels[time >= at if label != "after" else time > at] = label
    return labels


def held_frames(time: np.ndarray, events: dict[str, Event]) -> np.ndarray:
    """Whether the box is held, shape (n,): from lift-off to release, as far as there are such events."""
    start, stop = (events[name].time_s for name in ("lift_off", "release"))
    if start is None and stop is None:
        return np.zeros(len(time), dtype=bool)
    return (time >= (time[0] if start is None else start)) & (time <= (time[-1] if stop is None else stop))


def event_sources(recording: MarkerRecording, events: dict[str, Event]) -> dict[str, str]:
    """What each event was found in: box, hands or toes; set by hand; marked in the file; or absent."""
    _, carried = carried_object(recording)
    words = {DECLARED: "set by hand", IN_FILE: "marked in the file", ABSENT: ABSENT}
    return {
        name: words.get(event.method, "toes" if name == "toe_off" else carried)
        for name, event in events.items()
    }


def check_order(recording: MarkerRecording, times: dict[str, float]) -> None:
    """Raise `InputError` for times, by event, that lie outside the recording or are not in the order of `EVENTS`."""
    problems = Problems(f"{recording.source}: events")
    start, stop = float(recording.time[0]), float(recording.time[-1])
    for name, time in times.items():
        if not start <= time <= stop:
            problems.add(name, f"{time:g} s", f"the recording runs from {start:g} to {stop:g} s")
    pairs = list(times.items())
    for (earlier, first), (later, second) in pairwise(pairs):
        if second <= first:
            problems.add(
                later,
                f"{second:g} s is not after {earlier} at {first:g} s",
                "set events in the subject's file",
            )
    problems.raise_if_any()


class SeveralEvents(Exception):
    """Marks of which any may be the one meant; the text says which."""


def marks_of(recording: MarkerRecording, labels: EventLabels, name: str) -> list[RecordedEvent]:
    """Events of the file, within the recording, whose label is one of those that stand for an event of a lift."""
    wanted = set(map(_folded, getattr(labels, name)))
    return [event for event in _within(recording) if _folded(event.label) in wanted]


def file_event(
    recording: MarkerRecording, labels: EventLabels, name: str, start: float, stop: float
) -> RecordedEvent | None:
    """Return the event of the file that stands for one of a lift; None where there is none.

    `labels` in the file stand for each event. Of steps (`name` ``"toe_off"``) the first between `start` and `stop` is
    meant, in seconds; any other event stands once.

    Raises
    ------
    SeveralEvents
        The event stands more than once.
    """
    found = marks_of(recording, labels, name)
    if name == "toe_off":
        return next((event for event in found if start < event.time < stop), None)
    if len(found) > 1:
        times = ", ".join(f"{event.full_label} at {event.time:.2f} s" for event in found)
        raise SeveralEvents(f"{times}: which one is meant is not known (window_s of the trial takes one out)")
    return found[0] if found else None


def refuse_without(recording: MarkerRecording, labels: EventLabels, names: tuple[str, ...]) -> None:
    """Raise `InputError` where the file's events are to be taken, and it has none of a lift."""
    if any(marks_of(recording, labels, name) for name in names):
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
    meant = {name: marks_of(recording, labels, name) for name in events}
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
        times.setdefault(event.full_label, []).append(f"{event.time:.2f}")
    return "; ".join(f"{label} at {', '.join(at)} s" for label, at in times.items())


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
