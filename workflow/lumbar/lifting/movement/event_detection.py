"""MarkerFinding the events of a lift: the box leaves its support, the first toe-off, the start of the deposit, the release.

The box is lifted when it rises for good: before, it may slide on its support. The lift ends with the first toe-off. The
deposit starts at the last instant before the box goes down for good. The thesis (section 4.2.3.1) takes a minimum of the
wrists' speed, which can be asked for; while a box is swung over a shelf that is found on the way up. Where there are no
markers on the box, the hands stand for it. An event that a recording does not hold is a result, with its reason.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.yaml_file import shipped_yaml
from lumbar.lifting.movement.carried_object import (
    WRISTS,
    carried_object,
    great_swings,
    greatest_rise,
    last_hand_descent,
    lift_windows,
    speed,
    turning_points,
    wrist_centre,
)
from lumbar.lifting.movement.cleaning import derivative
from lumbar.lifting.movement.events import (
    ABSENT,
    DECLARED,
    DETECTED,
    EVENTS,
    IN_FILE,
    Event,
    SeveralEvents,
    check_order,
    file_event,
    refuse_without,
)
from lumbar.records.markers import MarkerRecording
from lumbar.records.stretches import runs
from lumbar.settings.lifting import EventSettings
from lumbar.settings.subject import DeclaredEvents

_HOW: dict[str, str] = shipped_yaml(Path(__file__).with_suffix(".yaml"))
TOES = ("L_TOE", "R_TOE")
ONSET = 0.1
"""What rises or descends for good has begun to, without doubt, once it has gone this share of the way."""
STANDS_OUT, LEAST_SHARE = 1.5, 0.5
"""A descent of less than `descent_m`, but of this share of it, is a deposit where it is so many times every other."""


class NotFound(Exception):
    """An event that the recording does not hold; the text says why."""


def find_events(
    recording: MarkerRecording,
    settings: EventSettings,
    declared: DeclaredEvents | Literal["file"] | None = None,
) -> dict[str, Event]:
    """Find the events of a lift; those declared by hand, or marked in the file where it is asked for, replace detected ones.

    The recording is filtered; `declared` are those of the trial in the subject's file. Events are returned by the names in
    `EVENTS`; one that the recording does not hold is absent, with its reason.

    Raises
    ------
    InputError
        If declared events are out of order with the others or lie outside the recording; if the file's are to be taken and
        it has none, or several of a kind.
    """
    from_file = settings.taken_from == IN_FILE or declared == IN_FILE
    if from_file:
        refuse_without(recording, settings.labels, EVENTS)
    times = {name: getattr(declared, f"{name}_s", None) for name in EVENTS}
    given = {name: time for name, time in times.items() if time is not None}
    check_order(recording, given)
    search = _Search(recording, settings)
    for name in ("lift_off", "release", "toe_off", "deposit_start"):
        found = search.event(name)
        if name in given:
            how = f"set in the subject's file ({declared.reason or 'no reason given'}); {_detection_says(found)}"
            found = _replaced(found, given[name], DECLARED, how)
        search.found[name] = _with_file(recording, settings, name, found, search, from_file)
    times = {name: search.found[name].time_s for name in EVENTS}
    check_order(recording, {name: time for name, time in times.items() if time is not None})
    events = {name: search.found[name] for name in EVENTS}
    doubt = several_lifts(recording, events, settings)
    if doubt:
        events["release"] = replace(events["release"], how=f"{events['release'].how}; {doubt}")
    return events


def _with_file(
    recording: MarkerRecording,
    settings: EventSettings,
    name: str,
    event: Event,
    search: _Search,
    from_file: bool,
) -> Event:
    """An event with what the file says of it, which replaces a detected one where it is asked for."""
    if name == "toe_off" and not search.anything_is_lifted():
        return event
    try:
        marked = file_event(recording, settings.labels, name, search.begin, search.end)
    except SeveralEvents as several:
        if from_file and event.method != DECLARED:
            raise InputError(f"{recording.source}: {name} in the file: {several}") from several
        return replace(event, file=str(several))
    if marked is None:
        return event
    said = {"file_s": marked.time, "file": marked.full_label}
    if event.method == DECLARED or not from_file:
        return replace(event, **said)
    how = f"marked in the file as {marked.full_label}; {_detection_says(event)}"
    return replace(_replaced(event, marked.time, IN_FILE, how), **said)


def _replaced(found: Event, time: float, method: str, how: str) -> Event:
    """Return a detected event at the time that somebody gives it."""
    kept = {"detected_s": found.time_s, "descent_s": found.descent_s, "thesis_s": found.thesis_s}
    return Event(time, method, how, **kept)


def _detection_says(found: Event) -> str:
    return "detection finds none" if found.time_s is None else f"detection says {found.time_s:.2f} s"


def several_lifts(recording: MarkerRecording, events: dict[str, Event], settings: EventSettings) -> str:
    """Say whether what is lifted rises so often that it may be several lifts, and in which windows; else nothing."""
    _, carried = carried_object(recording)
    start, stop = (events[name].time_s for name in ("lift_off", "release"))
    if start is None or stop is None:
        return ""
    # Hands rise for other reasons too before they hold something and after; a box does not.
    held = (carried == "box") | ((recording.time >= start) & (recording.time <= stop))
    hidden = {name: np.where(held[:, None], part, np.nan) for name, part in recording.positions.items()}
    windows = lift_windows(replace(recording, positions=hidden), settings)
    if len(windows) < 2:
        return ""
    listed = ", ".join(f"[{first:.2f}, {last:.2f}]" for first, last in windows)
    who, when = ("box rises", "") if carried == "box" else ("hands rise", " from lift-off to release")
    return f"the {who} {len(windows)} times{when}: one lift or several, each a trial with window_s {listed}?"


class _Search:
    """Finds events one after the other: each is searched between those found before."""

    def __init__(self, recording: MarkerRecording, settings: EventSettings):
        points, self.what = carried_object(recording)
        self.whole, self.settings, self.found = recording, settings, {}
        self.part = self.points = None
        if points is not None and np.isfinite(points).any():
            seen = runs(np.isfinite(points).all(axis=1))
            self.part = recording.at(max(seen, key=lambda run: run.stop - run.start))
            self.points = carried_object(self.part)[0]

    def event(self, name: str) -> Event:
        """One event by its name in `EVENTS`."""
        try:
            if name in ("toe_off", "deposit_start") and not self.anything_is_lifted():
                raise NotFound("neither a lift-off nor a release")
            if name == "toe_off":
                return _toe_off(self.whole, self.settings, self.begin, self.end)
            if self.part is None:
                raise NotFound("no box markers and no wrist markers: what is lifted is not seen")
            found = getattr(self, f"_{name}")()
        except NotFound as reason:
            return Event(None, ABSENT, "; ".join([str(reason), *self._seen()]))
        words = [] if self.what == "box" else ["hands taken for the box, which has no markers"]
        return replace(found, how="; ".join([*words, *self._seen(), found.how]))

    def _seen(self) -> list[str]:
        """Words for the part in which what is lifted is seen, where that is not all."""
        if self.part is None or len(self.part) == len(self.whole):
            return []
        first, last = self.part.time[[0, -1]]
        are = "is" if self.what == "box" else "are"
        return [
            f"the {self.what} {are} seen without a gap from {first:.2f} to {last:.2f} s, and looked for there alone"
        ]

    def anything_is_lifted(self) -> bool:
        """Whether a lift-off or a release is known."""
        return any(self.found[name].time_s is not None for name in ("lift_off", "release"))

    @property
    def begin(self) -> float:
        """Lift-off, or the start of a recording without one."""
        time = self.found["lift_off"].time_s if "lift_off" in self.found else None
        return float(self.whole.time[0]) if time is None else time

    @property
    def end(self) -> float:
        """Release, or the end of a recording without one."""
        time = self.found["release"].time_s if "release" in self.found else None
        return float(self.whole.time[-1]) if time is None else time

    def _lift_off(self) -> Event:
        """Last instant before the box rises for good; of a box that is only taken down, the first movement."""
        if self.what != "box":
            return self._rise(self._hands()[0])
        moved, height = self._first_movement(), self.points[:, 2]
        if (height[moved:] >= height[moved] + self.settings.rise_m).any():
            return self._rise(moved)
        return Event(
            float(self.part.time[moved]), DETECTED, _HOW["never_rises"].format(settings=self.settings)
        )

    def _hands(self) -> tuple[int, int]:
        rises = great_swings(self.points[:, 2], self.settings.hands_rise_m, 1)
        if not rises:
            most = greatest_rise(self.points[:, 2])
            raise NotFound(_HOW["hands_low"].format(settings=self.settings, most=most))
        return rises[0]

    def _rise(self, moved: int) -> Event:
        """Last instant before what moves from the frame `moved` on rises by `rise_m`, which it does."""
        height, climb = self.points[:, 2], derivative(self.points, self.part.rate)[:, 2]
        high = moved + int(np.flatnonzero(height[moved:] >= height[moved] + self.settings.rise_m)[0])
        still = np.flatnonzero(climb[moved:high] <= self.settings.box_rest_m_s)
        onset = moved + int(still[-1]) if still.size else moved
        before = np.flatnonzero(climb[: onset + 1] <= 0)
        rise = height[high] - height[onset]
        latest = onset + int(np.flatnonzero(height[onset:] >= height[onset] + ONSET * rise)[0])
        slid = self.part.time[onset] - self.part.time[moved]
        how = _HOW["rises"].format(settings=self.settings, moved=self.part.time[moved])
        how += ", sliding at first" if slid > 0.1 else ""
        times = self.part.time[[onset, before[-1] if before.size else 0, latest]]
        return Event(float(times[0]), DETECTED, how, earliest_s=float(times[1]), latest_s=float(times[2]))

    def _first_movement(self) -> int:
        """Index of the last rest of the box before it first moves."""
        threshold, lasting = self.settings.box_speed_m_s, self.settings.box_sustained_s
        moving = speed(self.points, self.part.rate)
        first = _first_run(moving > threshold, max(1, round(lasting * self.part.rate)))
        if first is None:
            kept = _kept(moving, max(1, round(lasting * self.part.rate)))
            raise NotFound(_HOW["box_still"].format(settings=self.settings, kept=kept))
        if first == 0:
            raise NotFound("the box moves from the first frame: its lift-off is not there")
        rest = np.flatnonzero(moving[:first] <= self.settings.box_rest_m_s)
        return int(rest[-1]) + 1 if rest.size else first

    def _release(self) -> Event:
        if self.what != "box":
            return self._hands_release()
        time, threshold = self.part.time, self.settings.box_speed_m_s
        separation, wrists = None, wrist_centre(self.part)
        if wrists is not None:  # they part from the box, where they are seen to grip it
            apart = np.linalg.norm(wrists - self.points, axis=1)
            separation = self._grip_ends(apart, closing=False)
        end = len(time) - 1 if separation is None else separation
        pace = speed(self.points, self.part.rate)
        moving = np.flatnonzero((pace > threshold) & (time >= self.begin) & (np.arange(len(time)) <= end))
        if moving.size == 0:
            raise NotFound(f"the box does not move after {self.begin:.2f} s")
        parted = "" if separation is None else f"; the wrists part from it at {time[separation]:.2f} s"
        if moving[-1] < end:
            # Slow placing goes on below the threshold of movement; it ends at rest, or when the hands leave.
            rest = np.flatnonzero(pace[moving[-1] : end + 1] <= self.settings.box_rest_m_s)
            stop = int(moving[-1] + rest[0]) if rest.size else end
            return Event(
                float(time[stop]), DETECTED, _HOW["rests"].format(settings=self.settings, parted=parted)
            )
        if separation is None:
            raise NotFound(f"the box still moves at the last frame looked at, {time[-1]:.2f} s")
        return Event(float(time[separation]), DETECTED, _HOW["parted"].format(settings=self.settings))

    def _hands_part(self) -> int | None:
        """Index at which the hands leave what they hold together: their distance is no longer that of the grip."""
        if not all(name in self.part for name in WRISTS):
            return None
        apart = np.linalg.norm(self.part["L_WRIST"] - self.part["R_WRIST"], axis=1)
        return self._grip_ends(apart, closing=True)

    def _grip_ends(self, distance: np.ndarray, closing: bool) -> int | None:
        """Index from which a distance is larger than in the grip after the lift-off, or with `closing` smaller; None if never."""
        after = self.part.time >= self.begin
        grip = distance[after & (self.part.time <= self.begin + self.settings.grip_s)]
        if not np.isfinite(grip).any():
            return None
        change = distance - np.nanmedian(grip)
        left = after & ((np.abs(change) if closing else change) > self.settings.separation_m)
        return _first_run(left, max(1, round(self.settings.box_sustained_s * self.part.rate)))

    def _hands_release(self) -> Event:
        """End of the last descent of the hands before they part; of the last great one where it is not seen that they do."""
        if self.found["lift_off"].method == ABSENT:
            self._hands()
        time, hands, settings = self.part.time, self.points, self.settings
        climb, parted = derivative(hands, self.part.rate)[:, 2], self._hands_part()
        first = int(np.searchsorted(time, self.begin))
        held = (
            None
            if parted is None
            else last_hand_descent(hands[first : parted + 1, 2], settings, greatest=False)
        )
        # Hands that part before they have gone down were not holding yet, or never together.
        lowered = held or last_hand_descent(hands[first:, 2], settings, greatest=True)
        if lowered is None:
            most = greatest_rise(-hands[first:, 2])
            raise NotFound(_HOW["hands_high"].format(settings=settings, lift_off=self.begin, most=most))
        top, bottom = (first + index for index in lowered)
        falling = np.flatnonzero(climb[top : bottom + 1] < -settings.box_rest_m_s)
        stop = min(top + int(falling[-1]) + 1, bottom) if falling.size else bottom
        if stop >= len(time) - 1:
            raise NotFound(f"the hands still go down at the last frame looked at, {time[-1]:.2f} s")
        words = {"settings": settings, "way": hands[top, 2] - hands[bottom, 2]}
        if held is None:
            return Event(float(time[stop]), DETECTED, _HOW["hands_last"].format(**words))
        return Event(float(time[stop]), DETECTED, _HOW["hands_part"].format(**words, parted=time[parted]))

    def _deposit_start(self) -> Event:
        """Last instant before what is carried goes down for good, or the wrists' last least speed before that."""
        what, settings, toe_off = self.what, self.settings, self.found["toe_off"].time_s
        start, release = self.begin if toe_off is None else toe_off, self.end
        goes = "goes" if what == "box" else "go"
        searched = np.flatnonzero((self.part.time > start) & (self.part.time <= release))
        if searched.size < 3:
            raise NotFound(
                f"the {what} {'is' if what == 'box' else 'are'} not seen from {start:.2f} to {release:.2f} s"
            )
        height, climb = self.points[searched, 2], derivative(self.points, self.part.rate)[searched, 2]
        time, (last, needed) = self.part.time[searched], _descents(height, settings)
        onset = self._last_stop(height, climb, settings.descent_m)
        if onset is None:
            onset = self._last_stop(height, climb, needed, least=needed)
        if onset is None:
            lower = np.arange(int(1e3 * last), 4, -1) / 1e3
            stops = ((way, self._last_stop(height, climb, way, least=way)) for way in lower)
            told = [_HOW["would_find"].format(way=way, at=time[at]) for way, at in stops if at is not None]
            words = {"what": what, "goes": goes, "way": height.max() - height[-1], "until": time[-1]}
            raise NotFound(_HOW["no_deposit"].format(**words, needed=needed, decides="".join(told[:1])))
        starts = {
            "descent_s": float(time[onset]),
            "thesis_s": self._slowest_wrists(searched, onset),
        }
        if settings.deposit_start == "wrist_minimum":
            words = {
                "what": what,
                "begin": "begins" if what == "box" else "begin",
                "down": starts["descent_s"],
            }
            if starts["thesis_s"] is None:
                raise NotFound(_HOW["no_wrist_minimum"].format(**words, settings=settings))
            return Event(starts["thesis_s"], DETECTED, _HOW["wrist_minimum"].format(**words), **starts)
        left = float(height[onset] - height[-1])
        not_down = np.flatnonzero(climb[: onset + 1] >= 0)
        latest = onset + int(np.flatnonzero(height[onset:] <= height[onset] - ONSET * left)[0])
        how = _HOW["goes_down"].format(what=what, goes=goes, settings=settings, left=left)
        earliest = time[not_down[-1] if not_down.size else 0]
        return Event(
            starts["descent_s"],
            DETECTED,
            how,
            earliest_s=float(earliest),
            latest_s=float(time[latest]),
            **starts,
        )

    def _last_stop(self, height, climb, way: float, least: float = 0.0) -> int | None:
        """Index of the last rest in the last rise or stay from which there is `way`, in metres, to go down.

        Slowing down, or a small rise on the way, is none: a stay lasts, and a rise is a lift of its own. Two speeds tell
        them, so that noise neither cuts a stay nor makes one. A descent may be too slow to be told from a stay by them:
        rests with less than `least` below them, in metres, are none.
        """
        rests = (climb >= -self.settings.box_rest_m_s) & (height - height[-1] >= least)
        stops = []
        for run in runs(climb >= -self.settings.box_speed_m_s):
            lasts = (
                run.stop - run.start >= self.settings.stay_s * self.part.rate or np.ptp(height[run]) >= way
            )
            resting = run.start + np.flatnonzero(rests[run])
            if lasts and resting.size and height[resting[-1]] - height[-1] >= way:
                stops.append(int(resting[-1]))
        return stops[-1] if stops else None

    def _slowest_wrists(self, searched: np.ndarray, onset: int) -> float | None:
        """Time of the last local minimum of the wrists' speed before the descent: the thesis's start of the deposit."""
        from scipy.signal import find_peaks

        wrists = wrist_centre(self.part)
        if wrists is None:
            return None
        slow = speed(wrists, self.part.rate)[searched]
        if not np.isfinite(slow).all():
            return None
        minima, _ = find_peaks(-slow, prominence=self.settings.prominence_m_s)
        minima = minima[minima <= onset]
        return float(self.part.time[searched[minima[-1]]]) if minima.size else None


def _first_run(flags: np.ndarray, samples: int) -> int | None:
    """Index at which `flags` first stays true for at least `samples` samples."""
    return next((run.start for run in runs(flags) if run.stop - run.start >= samples), None)


def _kept(values: np.ndarray, samples: int) -> float:
    """Largest value that is kept for so many samples; 0 where none is."""
    if len(values) < samples:
        return 0.0
    least = np.lib.stride_tricks.sliding_window_view(values, samples).min(axis=1)
    return float(np.nanmax(least, initial=0.0))


def _toe_off(recording: MarkerRecording, settings: EventSettings, lift_off: float, release: float) -> Event:
    toes = [name for name in TOES if name in recording]
    if not toes:
        return Event(None, ABSENT, "no toe markers: the end of the lift is not known")
    threshold, lasting = settings.toe_speed_m_s, settings.toe_sustained_s
    searched = (recording.time > lift_off) & (recording.time < release)
    # 65 ms are 13 frames at 200 Hz, whatever the rounding of the product.
    samples = max(1, int(np.ceil(lasting * recording.rate - 1e-9)))
    starts, unseen, fastest = {}, [], 0.0
    for name in toes:
        foot = speed(recording[name], recording.rate)
        fastest = max(fastest, _kept(foot[searched], samples))
        first = _first_run((foot > threshold) & searched, samples)
        if first is not None:
            starts[name] = float(recording.time[first])
        if np.isnan(foot[searched]).any():
            unseen.append(name)
    words = {"settings": settings, "toes": ", ".join(toes), "fastest": fastest}
    gaps = f"; not seen all the time: {', '.join(unseen)}" if unseen else ""
    rule = _HOW["toe_off"].format(**words)
    if not starts:
        return Event(None, ABSENT, f"{_HOW['no_toe_off'].format(**words, rule=rule)}{gaps}")
    first_toe = min(starts, key=starts.__getitem__)
    return Event(starts[first_toe], DETECTED, f"{first_toe} first: {rule}{gaps}")


def _descents(height: np.ndarray, settings: EventSettings) -> tuple[float, float]:
    """The last descent, and that which is a deposit: `descent_m`, or less where what is carried hardly goes down otherwise."""
    least = LEAST_SHARE * settings.descent_m
    falls = [high - low for high, low in pairwise(height[turning_points(height, least / 2)]) if high > low]
    others = STANDS_OUT * max(falls[:-1], default=0.0)
    return (falls or [0.0])[-1], float(np.clip(others, least, settings.descent_m))
