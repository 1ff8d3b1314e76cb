"""Events of a lift: the box leaves its support, the first toe-off, the start of the deposit, the release.

The box is lifted when it rises for good: before, it may slide on its support. The lift ends with the first toe-off. The
deposit starts at the last instant before the box goes down for good. The thesis (section 4.2.3.1) takes a minimum of the
wrists' speed; while a box is swung over a shelf that is found on the way up, so its time stands beside the other.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from lumbar.errors import InputError, Problems
from lumbar.lifting.filtering import derivative
from lumbar.lifting.gaps import runs
from lumbar.records.markers import MarkerRecording

if TYPE_CHECKING:
    from lumbar.settings.lifting import EventSettings
    from lumbar.settings.subject import DeclaredEvents

EVENTS = ("lift_off", "toe_off", "deposit_start", "release")
"""In the order in which they happen. There may be no toe-off: the lifter deposits without a step."""
WRISTS = ("L_WRIST", "R_WRIST")
TOES = ("L_TOE", "R_TOE")
ONSET = 0.1
"""What rises or descends for good has begun to, without doubt, once it has gone this share of the way."""


@dataclass(frozen=True)
class Event:
    """One event and how it was found.

    Attributes
    ----------
    time_s : float or None
        On the recording's clock; None for a toe-off that does not happen.
    method : {"detected", "declared", "absent"}
    how : str
        The rule and the numbers behind it, for the reader.
    detected_s : float or None
        What detection says where the event is declared by hand; None where it finds nothing.
    earliest_s, latest_s : float or None
        Between these the event has happened whatever the threshold: the last instant of no movement in its direction, and a
        tenth of the way done; None where the rule knows no such instants.
    thesis_s : float or None
        What the thesis's own rule finds; None where it has no other, or finds nothing.
    """

    time_s: float | None
    method: str
    how: str
    detected_s: float | None = None
    earliest_s: float | None = None
    latest_s: float | None = None
    thesis_s: float | None = None

    def as_dict(self) -> dict:
        """Plain data for JSON."""
        return asdict(self)


def speed(points: np.ndarray, rate: float) -> np.ndarray:
    """Speed of filtered positions, shape (n,) in m/s; NaN where a sample is missing."""
    return np.linalg.norm(derivative(points, rate), axis=1)


def box_centre(recording: MarkerRecording) -> np.ndarray | None:
    """Centre of the box markers that were seen throughout, shape (n, 3) in metres; None without box markers.

    A marker that is missing for a while is left out altogether: it would shift the centre when it comes and
    goes.

    Raises
    ------
    InputError
        If there are box markers, but none was seen throughout.
    """
    names = [name for name in recording.positions if name.startswith("BOX_")]
    complete = [recording[name] for name in names if np.isfinite(recording[name]).all()]
    if names and not complete:
        raise InputError(
            f"{recording.source}: every box marker ({', '.join(names)}) has gaps longer than "
            "lifting.gaps.maximum_s; "
            "raise it, or leave out of lifting.markers.aliases what cannot be used"
        )
    return np.mean(complete, axis=0) if complete else None


def wrist_centre(recording: MarkerRecording) -> np.ndarray | None:
    """Mean of the wrists in the recording, shape (n, 3) in metres; None without wrists."""
    present = [recording[name] for name in WRISTS if name in recording]
    return np.mean(present, axis=0) if present else None


def find_events(
    recording: MarkerRecording, settings: EventSettings, declared: DeclaredEvents | None = None
) -> dict[str, Event]:
    """Find the events of a lift; those declared by hand replace detected ones.

    Parameters
    ----------
    recording : MarkerRecording
        Filtered.
    settings : EventSettings
        Thresholds.
    declared : DeclaredEvents, optional
        Of the trial in the subject's file.

    Returns
    -------
    dict of str to Event
        By the names in `EVENTS`.

    Raises
    ------
    InputError
        If an event can neither be detected nor is declared, or if events are out of order.
    """
    times = {name: getattr(declared, f"{name}_s", None) for name in EVENTS}
    given = {name: time for name, time in times.items() if time is not None}
    _check_order(recording, given)
    found: dict[str, Event] = {}
    finders = {
        "lift_off": lambda: _lift_off(recording, settings),
        "release": lambda: _release(recording, settings, found["lift_off"].time_s),
        "toe_off": lambda: _toe_off(recording, settings, found["lift_off"].time_s, found["release"].time_s),
        "deposit_start": lambda: _deposit_start(
            recording, settings, found["toe_off"].time_s or found["lift_off"].time_s, found["release"].time_s
        ),
    }
    for name, finder in finders.items():
        found[name] = _declared(given[name], declared.reason, finder) if name in given else finder()
    _check_order(recording, {name: found[name].time_s for name in EVENTS if found[name].time_s is not None})
    return {name: found[name] for name in EVENTS}


def _declared(time: float, reason: str | None, finder) -> Event:
    try:
        detected = finder().time_s
    except InputError:
        detected = None
    says = "detection finds none" if detected is None else f"detection says {detected:.2f} s"
    return Event(
        time, "declared", f"set in the subject's file ({reason or 'no reason given'}); {says}", detected
    )


def _check_order(recording: MarkerRecording, times: dict[str, float]) -> None:
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


def _first_run(flags: np.ndarray, samples: int) -> int | None:
    """Index at which `flags` first stays true for at least `samples` samples."""
    return next((run.start for run in runs(flags) if run.stop - run.start >= samples), None)


def _needed(recording: MarkerRecording, points: np.ndarray | None, what: str, event: str) -> np.ndarray:
    if points is None:
        raise InputError(
            f"{recording.source}: no {what} markers, so {event} cannot be detected; set {event}_s in the "
            "subject's file"
        )
    return points


def _lift_off(recording: MarkerRecording, settings: EventSettings) -> Event:
    """Last instant before the box rises for good; of a box that is only taken down, the first movement."""
    box = _needed(recording, box_centre(recording), "box", "lift_off")
    moved = _first_movement(recording, box, settings)
    height, climb = box[:, 2], derivative(box, recording.rate)[:, 2]
    lifted = np.flatnonzero(height[moved:] >= height[moved] + settings.rise_m)
    if not lifted.size:
        how = (
            f"last rest of the box (slower than {settings.box_rest_m_s:g} m/s) before it first moves faster than "
            f"{settings.box_speed_m_s:g} m/s for at least {settings.box_sustained_s:g} s; it never rises by {settings.rise_m:g} m"
        )
        return Event(float(recording.time[moved]), "detected", how)
    high = moved + int(lifted[0])
    still = np.flatnonzero(climb[moved:high] <= settings.box_rest_m_s)
    onset = moved + int(still[-1]) if still.size else moved
    before = np.flatnonzero(climb[: onset + 1] <= 0)
    rise = height[high] - height[onset]
    latest = onset + int(np.flatnonzero(height[onset:] >= height[onset] + ONSET * rise)[0])
    slid = recording.time[onset] - recording.time[moved]
    how = (
        f"last instant at which the box rises no faster than {settings.box_rest_m_s:g} m/s before it is {settings.rise_m:g} m "
        f"higher; it moves from {recording.time[moved]:.2f} s on"
        + (", sliding at first" if slid > 0.1 else "")
    )
    times = recording.time[[onset, before[-1] if before.size else 0, latest]]
    return Event(float(times[0]), "detected", how, earliest_s=float(times[1]), latest_s=float(times[2]))


def _first_movement(recording: MarkerRecording, box: np.ndarray, settings: EventSettings) -> int:
    """Index of the last rest of the box before it first moves."""
    threshold, lasting = settings.box_speed_m_s, settings.box_sustained_s
    moving = speed(box, recording.rate)
    first = _first_run(moving > threshold, max(1, round(lasting * recording.rate)))
    advice = "set lift_off_s in the subject's file"
    if first is None:
        raise InputError(
            f"{recording.source}: the box never moves faster than {threshold:g} m/s for {lasting:g} s; "
            + advice
        )
    if first == 0:
        raise InputError(
            f"{recording.source}: the box moves from the first frame, its lift-off is not there; {advice}"
        )
    rest = np.flatnonzero(moving[:first] <= settings.box_rest_m_s)
    return int(rest[-1]) + 1 if rest.size else first


def _release(recording: MarkerRecording, settings: EventSettings, lift_off: float) -> Event:
    time, threshold = recording.time, settings.box_speed_m_s
    box = _needed(recording, box_centre(recording), "box", "release")
    separation = _separation(recording, box, settings, lift_off)
    end = len(time) - 1 if separation is None else separation
    pace = speed(box, recording.rate)
    moving = np.flatnonzero((pace > threshold) & (time >= lift_off) & (np.arange(len(time)) <= end))
    if moving.size == 0:
        raise InputError(f"{recording.source}: the box does not move after {lift_off:g} s; check lift_off_s")
    parted = "" if separation is None else f"; the wrists part from it at {time[separation]:.2f} s"
    if moving[-1] < end:
        # Slow placing goes on below the threshold of movement; it ends at rest, or when the hands leave.
        rest = np.flatnonzero(pace[moving[-1] : end + 1] <= settings.box_rest_m_s)
        stop = int(moving[-1] + rest[0]) if rest.size else end
        how = f"the box comes to rest (slower than {settings.box_rest_m_s:g} m/s){parted}"
        return Event(float(time[stop]), "detected", how)
    if separation is None:
        raise InputError(
            f"{recording.source}: the box still moves when the recording ends; set release_s in the "
            "subject's file"
        )
    return Event(
        float(time[separation]),
        "detected",
        f"the wrists part from the moving box by more than {settings.separation_m:g} m",
    )


def _separation(
    recording: MarkerRecording, box: np.ndarray, settings: EventSettings, lift_off: float
) -> int | None:
    """Index at which the wrists leave the box; None without wrists or if they stay."""
    wrists = wrist_centre(recording)
    if wrists is None:
        return None
    distance = np.linalg.norm(wrists - box, axis=1)
    after = recording.time >= lift_off
    grip = distance[after & (recording.time <= lift_off + settings.grip_s)]
    if not np.isfinite(grip).any():
        raise InputError(
            f"{recording.source}: the wrists are not seen within {settings.grip_s:g} s of the lift-off, "
            "so it is not known when they leave the box; set release_s in the subject's file"
        )
    held = np.nanmedian(grip)
    apart = after & (distance > held + settings.separation_m)
    return _first_run(apart, max(1, round(settings.box_sustained_s * recording.rate)))


def _toe_off(recording: MarkerRecording, settings: EventSettings, lift_off: float, release: float) -> Event:
    toes = [name for name in TOES if name in recording]
    if not toes:
        return Event(None, "absent", "no toe markers: the end of the lift is not known")
    threshold, lasting = settings.toe_speed_m_s, settings.toe_sustained_s
    searched = (recording.time > lift_off) & (recording.time < release)
    # 65 ms are 13 frames at 200 Hz, whatever the rounding of the product.
    samples = max(1, int(np.ceil(lasting * recording.rate - 1e-9)))
    starts, unseen = {}, []
    for name in toes:
        foot = speed(recording[name], recording.rate)
        first = _first_run((foot > threshold) & searched, samples)
        if first is not None:
            starts[name] = float(recording.time[first])
        if np.isnan(foot[searched]).any():
            unseen.append(name)
    rule = f"toe faster than {threshold:g} m/s for at least {lasting:g} s between lift-off and release"
    gaps = f"; not seen all the time: {', '.join(unseen)}" if unseen else ""
    if not starts:
        return Event(None, "absent", f"no toe-off: no {rule} ({', '.join(toes)}){gaps}")
    first_toe = min(starts, key=starts.__getitem__)
    return Event(starts[first_toe], "detected", f"{first_toe} first: {rule}{gaps}")


def _deposit_start(
    recording: MarkerRecording, settings: EventSettings, start: float, release: float
) -> Event:
    """Last instant before the box goes down for good; the wrists where there is no box."""
    box = box_centre(recording)
    what, goes = ("box", "goes") if box is not None else ("wrists", "go")
    carried = wrist_centre(recording) if box is None else box
    carried = _needed(recording, carried, "box or wrist", "deposit_start")
    advice = "set deposit_start_s in the subject's file"
    searched = np.flatnonzero((recording.time > start) & (recording.time <= release))
    if searched.size < 3:
        raise InputError(
            f"{recording.source}: no time between {start:g} s and the release at {release:g} s; {advice}"
        )
    height, climb = carried[searched, 2], derivative(carried, recording.rate)[searched, 2]
    if not np.isfinite(climb).all():
        raise InputError(
            f"{recording.source}: {what} not seen all the time between {start:g} and {release:g} s; {advice}"
        )
    descent = float(height.max() - height[-1])
    if descent < settings.descent_m:
        raise InputError(
            f"{recording.source}: the {what} {goes} down by {descent:.3f} m before the release at "
            f"{release:.2f} s, a deposit needs {settings.descent_m:g} m (lifting.events.descent_m); " + advice
        )
    onset = _last_stop(height, climb, settings, recording.rate)
    if onset is None:
        raise InputError(
            f"{recording.source}: the {what} {goes} down all the time from {start:.2f} to {release:.2f} s; {advice}"
        )
    left = float(height[onset] - height[-1])
    not_down = np.flatnonzero(climb[: onset + 1] >= 0)
    latest = onset + int(np.flatnonzero(height[onset:] <= height[onset] - ONSET * left)[0])
    how = (
        f"last instant at which the {what} {goes} down no faster than {settings.box_rest_m_s:g} m/s before the last "
        f"{left:.2f} m to the release"
    )
    time = recording.time[searched]
    return Event(
        float(time[onset]),
        "detected",
        how,
        earliest_s=float(time[not_down[-1] if not_down.size else 0]),
        latest_s=float(time[latest]),
        thesis_s=_slowest_wrists(recording, settings, searched, onset),
    )


def _last_stop(height: np.ndarray, climb: np.ndarray, settings: EventSettings, rate: float) -> int | None:
    """Index of the last rest in the last rise or stay from which there is a deposit's way to go down.

    Slowing down, or a small rise on the way, is none: a stay lasts, and a rise is a lift of its own. Two speeds tell
    them, so that noise neither cuts a stay nor makes one.
    """
    rests = climb >= -settings.box_rest_m_s
    stops = []
    for run in runs(climb >= -settings.box_speed_m_s):
        lasts = run.stop - run.start >= settings.stay_s * rate or np.ptp(height[run]) >= settings.descent_m
        resting = run.start + np.flatnonzero(rests[run])
        if lasts and resting.size and height[resting[-1]] - height[-1] >= settings.descent_m:
            stops.append(int(resting[-1]))
    return stops[-1] if stops else None


def _slowest_wrists(
    recording: MarkerRecording, settings: EventSettings, searched: np.ndarray, onset: int
) -> float | None:
    """Time of the last local minimum of the wrists' speed before the descent: the thesis's start of the deposit."""
    from scipy.signal import find_peaks

    wrists = wrist_centre(recording)
    if wrists is None:
        return None
    slow = speed(wrists, recording.rate)[searched]
    if not np.isfinite(slow).all():
        return None
    minima, _ = find_peaks(-slow, prominence=settings.prominence_m_s)
    minima = minima[minima <= onset]
    return float(recording.time[searched[minima[-1]]]) if minima.size else None


def phases(time: np.ndarray, events: dict[str, Event]) -> np.ndarray:
    """Phase of every sample: before, lift, carry, deposit or after.

    Without a toe-off the lift lasts until the start of the deposit and there is no carry.

    Parameters
    ----------
    time : ndarray, shape (n,)
    events : dict of str to Event

    Returns
    -------
    ndarray of str, shape (n,)
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
