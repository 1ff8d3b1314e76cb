"""Events of a lift: their times and origins, the phases between them, the carried object, and marks in the recording's file."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.lifting.movement.cleaning import derivative
from lumbar.records.marker_file import RecordedEvent
from lumbar.records.markers import MarkerRecording
from lumbar.settings.lifting import EventLabels, EventSettings

EVENTS = ("lift_off", "toe_off", "deposit_start", "release")
"""Events in the order in which they happen. Any of them may be absent: a lifter deposits without a step, or not at all."""
NEAREST_S = 5e-4
"""Smallest difference in s that is reported; smaller differences are zero."""
DETECTED, DECLARED, IN_FILE, ABSENT = "detected", "declared", "file", "absent"
WRISTS = ("L_WRIST", "R_WRIST")
GREAT = 0.5
"""Least ratio of a great swing to the greatest swing. Reaching, swinging arms and small corrections also move the hands."""
LOWEST = 0.1
"""Largest share of a rise up to which the object counts as still at its lowest."""


@dataclass(frozen=True)
class Event:
    """One event and its origin."""

    time_s: float | None
    """Time on the recording's clock; None for an event that does not happen or is not known."""
    method: str
    """Origin of the event: {"detected", "declared", "file", "absent"}."""
    how: str
    """Rule of detection with its numbers, or the reason for an absent event, as text."""
    detected_s: float | None = None
    """Detected time of an event that is declared by hand or taken from the file; None if none is detected."""
    earliest_s: float | None = None
    """Earliest time that any threshold gives: the end of rest before the movement; None if the rule has no such bound."""
    latest_s: float | None = None
    """Latest time that any threshold gives: a tenth of the movement is done; None if the rule has no such bound."""
    descent_s: float | None = None
    """Start of the deposit by the rule ``descent``; None if the rule has no result, and for other events."""
    thesis_s: float | None = None
    """Start of the deposit by the thesis's rule ``wrist_minimum``; None if the rule has no result, and for other events."""
    file_s: float | None = None
    """Time in the recording's file; None if the file has no such event, or several."""
    file: str = ""
    """Label of the event in the file, or the labels if there are several."""

    def to_dict(self) -> dict:
        """Return plain data for JSON."""
        return asdict(self)


def phases(time: np.ndarray, events: dict[str, Event]) -> np.ndarray:
    """Return the phase of every sample, shape (n,): before, lift, carry, deposit or after.

    Without a toe-off there is no carry: the lift lasts until the start of the deposit.

    Parameters
    ----------
    time : numpy.ndarray, shape (n,)
        Time of the samples in s.
    events : dict of str to Event
        Events of the lift.
    """
    labels = np.full(len(time), "before", dtype="<U7")
    starts = {"lift": "lift_off", "carry": "toe_off", "deposit": "deposit_start", "after": "release"}
    for label, name in starts.items():
        at = events[name].time_s
        if at is not None:
            labels[time >= at if label != "after" else time > at] = label
    return labels


def frames_with_box(time: np.ndarray, events: dict[str, Event]) -> np.ndarray:
    """Return whether the box is held, shape (n,): from lift-off to release.

    One absent event sets no limit; if both are absent, the box is never held.

    Parameters
    ----------
    time : numpy.ndarray, shape (n,)
        Time of the samples in s.
    events : dict of str to Event
        Events of the lift.
    """
    start, stop = (events[name].time_s for name in ("lift_off", "release"))
    if start is None and stop is None:
        return np.zeros(len(time), dtype=bool)
    return (time >= (time[0] if start is None else start)) & (time <= (time[-1] if stop is None else stop))


def most_visible(recording: MarkerRecording, names: Iterable[str]) -> list[str]:
    """Return the markers that are seen whenever the longest seen marker is; empty without markers."""
    visible = {name: np.isfinite(recording[name]).all(axis=1) for name in names if name in recording}
    if not visible:
        return []
    best = max(visible.values(), key=np.count_nonzero)
    return [name for name, when in visible.items() if when[best].all()]


def mean_of_most_visible(recording: MarkerRecording, names: Iterable[str]) -> np.ndarray | None:
    """Return the mean of the `most_visible` markers, shape (n, 3) in metres; None without markers, NaN while they are not seen.

    A marker that is missing in some frames is not used in any: it would shift the mean when it comes and goes.
    """
    best = most_visible(recording, names)
    return np.mean([recording[name] for name in best], axis=0) if best else None


def box_centre(recording: MarkerRecording) -> np.ndarray | None:
    """Return the centre of the box markers."""
    return mean_of_most_visible(recording, [name for name in recording.positions if name.startswith("BOX_")])


def wrist_centre(recording: MarkerRecording) -> np.ndarray | None:
    """Return the mean of the wrists in the recording."""
    return mean_of_most_visible(recording, WRISTS)


def locate_load(recording: MarkerRecording) -> tuple[np.ndarray | None, str]:
    """Return the positions of the box, or of the hands if it has no markers, and ``"box"`` or ``"hands"``."""
    box = box_centre(recording)
    return (wrist_centre(recording), "hands") if box is None else (box, "box")


def speed(points: np.ndarray, rate: float) -> np.ndarray:
    """Return the speed of filtered positions, shape (n,) in m/s; NaN if a sample is missing."""
    return np.linalg.norm(derivative(points, rate), axis=1)


def turning_points(height: np.ndarray, size: float) -> list[int]:
    """Return the indices of alternate highest and lowest points at least `size` apart; empty without such a movement.

    Parameters
    ----------
    height : numpy.ndarray, shape (n,)
        Heights in m.
    size : float
        Least distance of successive points in m.

    Examples
    --------
    >>> turning_points(np.array([0.0, 1.0, 0.9, 1.2, 0.2, 0.3]), 0.5)
    [0, 3, 4]
    """
    points: list[int] = []
    low = high = direction = 0
    for index, value in enumerate(height):
        low = index if direction <= 0 and value < height[low] else low
        high = index if direction >= 0 and value > height[high] else high
        if direction <= 0 and value - height[low] >= size:
            points.append(low)
            high, direction = index, 1
        elif direction >= 0 and height[high] - value >= size:
            points.append(high)
            low, direction = index, -1
    return [*points, high if direction > 0 else low] if points else []


def great_swings(height: np.ndarray, size: float, sign: int) -> list[tuple[int, int]]:
    """Return the first and last index of every great rise or descent.

    Parameters
    ----------
    height : numpy.ndarray, shape (n,)
        Heights in m.
    size : float
        Least rise or descent in m.
    sign : {1, -1}
        1 for rises, -1 for descents.
    """
    swings = [
        (low, high)
        for low, high in pairwise(turning_points(height, size))
        if sign * (height[high] - height[low]) > 0
    ]
    sizes = [abs(height[last] - height[first]) for first, last in swings]
    return [swing for swing, size in zip(swings, sizes, strict=True) if size >= GREAT * max(sizes)]


def greatest_rise(height: np.ndarray) -> float:
    """Return the greatest rise above an earlier height, metres."""
    return float(np.max(height - np.minimum.accumulate(height)))


def several_lifts(recording: MarkerRecording, events: dict[str, Event], settings: EventSettings) -> str:
    """Return a question with time windows if the object rises often enough for several lifts; else nothing.

    Each great rise of at least `hands_rise_m` has a window; windows meet in the middle of the lowest part between two rises.

    Parameters
    ----------
    recording : MarkerRecording
        Filtered recording.
    events : dict of str to Event
        Events of the lift.
    settings : EventSettings
        Settings with the least rise.
    """
    _, carried = locate_load(recording)
    start, stop = (events[name].time_s for name in ("lift_off", "release"))
    if start is None or stop is None:
        return ""
    # Hands rise for other reasons too before and after they hold something; a box does not.
    is_held = (carried == "box") | ((recording.time >= start) & (recording.time <= stop))
    hidden = {name: np.where(is_held[:, None], part, np.nan) for name, part in recording.positions.items()}
    points, _ = locate_load(recording.replace_positions(hidden))
    known = False if points is None else np.isfinite(points).all(axis=1)
    if not np.any(known):
        return ""
    time, height = recording.time[known], points[known, 2]
    swings, edges = great_swings(height, settings.hands_rise_m, 1), [float(recording.time[0])]
    if len(swings) < 2:
        return ""
    for (_, before), (low, high) in pairwise(swings):
        lowest = height[before:high] <= height[low] + LOWEST * (height[high] - height[low])
        edges.append(float(np.median(time[before:high][lowest])))
    windows = pairwise([*edges, float(recording.time[-1])])
    listed = ", ".join(f"[{first:.2f}, {last:.2f}]" for first, last in windows)
    who, when = ("box rises", "") if carried == "box" else ("hands rise", " from lift-off to release")
    return f"the {who} {len(swings)} times{when}: one lift or several, each a trial with window_s {listed}?"


def check_order(recording: MarkerRecording, times: dict[str, float]) -> None:
    """Raise `InputError` if times are outside the recording or not in the order of `EVENTS`.

    Parameters
    ----------
    recording : MarkerRecording
        Recording of the lift.
    times : dict of str to float
        Time in s by event.

    Raises
    ------
    InputError
        If a time is wrong; the message lists every such time.
    """
    problems = Problems(f"{recording.source}: events")
    start, stop = float(recording.time[0]), float(recording.time[-1])
    for name, time in times.items():
        if not start <= time <= stop:
            problems.add(name, f"{time:g} s", f"the recording runs from {start:g} to {stop:g} s")
    for (earlier, first), (later, second) in pairwise(times.items()):
        if second <= first:
            order = f"{second:g} s is not after {earlier} at {first:g} s"
            problems.add(later, order, "set events in the subject's file")
    problems.raise_if_any()


class SeveralEventsError(Exception):
    """Several marks that may be the event; the text lists them."""


def marks_of(recording: MarkerRecording, labels: EventLabels, name: str) -> list[RecordedEvent]:
    """Return the events of the file within the recorded time that have a label of one event of a lift."""
    wanted = {re.sub(r"[\W_]+", "", label.lower()) for label in getattr(labels, name)}
    return [mark for mark in _marks_within(recording) if re.sub(r"[\W_]+", "", mark.label.lower()) in wanted]


def file_event(
    recording: MarkerRecording, labels: EventLabels, name: str, start: float, stop: float
) -> RecordedEvent | None:
    """Return the mark in the file for an event of a lift; None if the file has no such mark.

    Parameters
    ----------
    recording : MarkerRecording
        Recording with the file's events.
    labels : EventLabels
        Labels that mean each event.
    name : str
        One of `EVENTS`. For ``"toe_off"`` the first step between `start` and `stop` is returned; any other event may be marked
        only a single time.
    start, stop : float
        Start of the lift in s; end of the lift in s.

    Raises
    ------
    SeveralEventsError
        If the event is marked several times.
    """
    marks = marks_of(recording, labels, name)
    if name == "toe_off":
        return next((mark for mark in marks if start < mark.time < stop), None)
    if len(marks) > 1:
        times = ", ".join(f"{mark.full_label} at {mark.time:.2f} s" for mark in marks)
        raise SeveralEventsError(
            f"{times}: it is not known which one is meant (window_s of the trial selects one)"
        )
    return marks[0] if marks else None


def require_file_events(recording: MarkerRecording, labels: EventLabels) -> None:
    """Raise `InputError` if the file's events are selected and the file has no event of a lift."""
    if any(marks_of(recording, labels, name) for name in EVENTS):
        return
    within = _marks_within(recording)
    content = f"holds {', '.join(sorted({repr(mark.label) for mark in within}))}" if within else "holds none"
    outside = len(recording.events) - len(within)
    content += f", and {outside} outside {_span(recording)}" if outside else ""
    raise InputError(
        f"{recording.source}: the file's events are selected, but it {content}; set lifting.events.labels to the labels that "
        "mean lift_off, toe_off, deposit_start and release; or select those detected (lifting.events.taken_from, the trial's "
        "events)"
    )


def compare_with_file(
    recording: MarkerRecording, events: Mapping[str, Event], labels: EventLabels
) -> list[str]:
    """Return sentences on the differences between the file's and the detected events, and on labels without a meaning."""
    lines = []
    for name, event in events.items():
        in_file = f"events of the file: {name} {event.file_s or 0.0:.3f} s ({event.file})"
        detected = event.detected_s if event.method in (DECLARED, IN_FILE) else event.time_s
        if event.file_s is None:
            lines += [f"events of the file: {name}: {event.file}"] if event.file else []
        elif detected is None:
            lines.append(f"{in_file}; none detected")
        else:
            late = detected - event.file_s
            shift = f"{abs(late):.3f} s {'later' if late > 0 else 'earlier'}"
            shift = "the same" if abs(late) < NEAREST_S else shift
            lines.append(f"{in_file}; detected at {detected:.3f} s, {shift}")
    # Marks that are compared with no event, by the reason.
    meant = {name: marks_of(recording, labels, name) for name in events}
    within = _marks_within(recording)
    ignored = {
        "with labels that mean no event of a lift by lifting.events.labels": [
            mark for mark in within if not any(mark in marks for marks in meant.values())
        ],
        "that are not compared, because they are not between a lift-off and a release": [
            mark for name, marks in meant.items() for mark in marks if not events[name].file
        ],
        f"outside {_span(recording)}, not used": [mark for mark in recording.events if mark not in within],
    }
    for reason, marks in ignored.items():
        times: dict[str, list[str]] = {}
        for mark in marks:
            times.setdefault(mark.full_label, []).append(f"{mark.time:.2f}")
        listed = "; ".join(f"{label} at {', '.join(at)} s" for label, at in times.items())
        lines += [f"events of the file {reason}: {listed}"] if marks else []
    return lines


def _marks_within(recording: MarkerRecording) -> list[RecordedEvent]:
    """Return the marks of the file in the recorded time, with a frame's tolerance."""
    first, last = recording.time[0] - 1 / recording.rate, recording.time[-1] + 1 / recording.rate
    return [mark for mark in recording.events if first <= mark.time <= last]


def _span(recording: MarkerRecording) -> str:
    return f"{recording.time[0]:.2f} to {recording.time[-1]:.2f} s"
