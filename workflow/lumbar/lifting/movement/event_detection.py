"""Detection of the events of a lift: lift-off of the box, first toe-off, start of the deposit, release.

Lift-off is the start of the final rise of the box, which may slide on its support before. The lift ends with the first toe-off.
The deposit starts at the last instant before the final descent of the box. The thesis (section 4.2.3.1) takes a minimum of the
wrists' speed, which a setting selects; if a box is swung over a shelf, that minimum is during the rise. Without markers on the
box the hands replace it. An event that a recording does not show is reported as absent, with the reason.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.movement import events as lift_events
from lumbar.lifting.movement.cleaning import derivative
from lumbar.lifting.movement.events import ABSENT, DECLARED, DETECTED, EVENTS, IN_FILE, Event, speed
from lumbar.records.markers import MarkerRecording
from lumbar.records.sampling import runs
from lumbar.settings.lifting import DeclaredEvents, EventSettings

TOES = ("L_TOE", "R_TOE")
ONSET_SHARE = 0.1
"""Share of a final rise or descent after which the movement has certainly begun."""
MIN_DESCENT_RATIO, MIN_DESCENT_SHARE = 1.5, 0.5
"""Least ratio to every other descent, and least share of `descent_m`, at which a smaller descent is a deposit."""
MIN_SLIDE_S = 0.1
"""Shortest sliding before the rise that is reported."""


class NoEventError(Exception):
    """An event that the recording does not show; the text is the reason."""


def find_events(
    recording: MarkerRecording,
    settings: EventSettings,
    declared: DeclaredEvents | Literal["file"] | None = None,
) -> dict[str, Event]:
    """Find the events of a lift; declared events, or marks in the file if selected, replace detected events.

    An event that the recording does not have is marked as absent, with its reason.

    Parameters
    ----------
    recording : MarkerRecording
        Filtered recording.
    settings : EventSettings
        Thresholds of the detection, labels and origin of the events.
    declared : DeclaredEvents or "file", optional
        Events of the trial in the subject's file.

    Raises
    ------
    InputError
        If declared events are outside the recording or not in the order of `EVENTS`; if the file's events are selected and the
        file has no such event or several.
    """
    from_file = settings.taken_from == IN_FILE or declared == IN_FILE
    if from_file:
        lift_events.require_file_events(recording, settings.labels)
    times = {name: getattr(declared, f"{name}_s", None) for name in EVENTS}
    given = {name: time for name, time in times.items() if time is not None}
    lift_events.check_order(recording, given)
    search = _EventSearch(recording, settings)
    for name in ("lift_off", "release", "toe_off", "deposit_start"):
        event, mark, listed = search.detect(name), None, ""
        if name != "toe_off" or search.has_lift:
            try:
                mark = lift_events.file_event(recording, settings.labels, name, search.begin, search.end)
                listed = mark.full_label if mark else ""
            except lift_events.SeveralEventsError as several:
                if from_file and name not in given:
                    raise InputError(f"{recording.source}: {name} in the file: {several}") from several
                listed = str(several)
        # An event set by hand precedes that of the file, and this the detected one if it is selected.
        time, method, how, replaced = event.time_s, event.method, event.how, {}
        if name in given:
            time, method = given[name], DECLARED
            how = f"set in the subject's file ({declared.reason or 'no reason given'})"
        elif mark and from_file:
            time, method, how = mark.time, IN_FILE, f"marked in the file as {mark.full_label}"
        if method in (DECLARED, IN_FILE):
            how += "; no event detected" if event.time_s is None else f"; detected at {event.time_s:.2f} s"
            replaced = {"detected_s": event.time_s, "earliest_s": None, "latest_s": None}
        final = {"time_s": time, "method": method, "how": how, "file_s": mark.time if mark else None}
        search.add(name, replace(event, **replaced, **final, file=listed))
    events = {name: search.found[name] for name in EVENTS}
    lift_events.check_order(
        recording, {name: event.time_s for name, event in events.items() if event.time_s is not None}
    )
    question = lift_events.several_lifts(recording, events, settings)
    if question:
        events["release"] = replace(events["release"], how=f"{events['release'].how}; {question}")
    return events


class _EventSearch:
    """Searches the events one after the other, each between the events already known."""

    def __init__(self, recording: MarkerRecording, settings: EventSettings):
        points, self.what = lift_events.locate_load(recording)
        self.be, self.go = ("is", "goes") if self.what == "box" else ("are", "go")
        self.whole, self.settings = recording, settings
        self.found: dict[str, Event] = {}
        self.begin, self.end, self.has_lift = float(recording.time[0]), float(recording.time[-1]), False
        # The longest part of the recording in which the carried object is always seen, and its positions there.
        self.part = self.points = None
        if points is not None and np.isfinite(points).any():
            visible = runs(np.isfinite(points).all(axis=1))
            self.part = recording.select_frames(max(visible, key=lambda run: run.stop - run.start))
            self.points = lift_events.locate_load(self.part)[0]

    def detect(self, name: str) -> Event:
        """Return one event by its name in `EVENTS`."""
        limits = []
        if self.part is not None and len(self.part) < len(self.whole):
            first, last = self.part.time[[0, -1]]
            limits = [
                f"searched only from {first:.2f} to {last:.2f} s, where the {self.what} {self.be} always seen"
            ]
        try:
            if name in ("toe_off", "deposit_start") and not self.has_lift:
                raise NoEventError("neither a lift-off nor a release")
            if name == "toe_off":
                return self._toe_off()
            if self.part is None:
                raise NoEventError("no box markers and no wrist markers: the carried object is not seen")
            event = {
                "lift_off": self._lift_off,
                "release": self._box_release if self.what == "box" else self._hands_release,
                "deposit_start": self._deposit_start,
            }[name]()
        except NoEventError as reason:
            return Event(None, ABSENT, "; ".join([str(reason), *limits]))
        hands = [] if self.what == "box" else ["hands instead of the box, which has no markers"]
        return replace(event, how="; ".join([*hands, *limits, event.how]))

    def add(self, name: str, event: Event) -> None:
        """Store a known event: lift-off and release limit the search for the other events."""
        self.found[name] = event
        if name in ("lift_off", "release") and event.time_s is not None:
            self.has_lift = True
            setattr(self, "begin" if name == "lift_off" else "end", event.time_s)

    def _lift_off(self) -> Event:
        """Return the last instant before the object's final rise; for a box that is only taken down, its first movement."""
        settings, time, height = self.settings, self.part.time, self.points[:, 2]
        moved = self._first_movement() if self.what == "box" else self._first_hand_rise()
        risen = np.flatnonzero(height[moved:] >= height[moved] + settings.rise_m)
        if self.what == "box" and not risen.size:
            how = (
                f"last rest of the box (slower than {settings.box_rest_m_s:g} m/s) before it first moves faster than "
                f"{settings.box_speed_m_s:g} m/s for at least {settings.box_sustained_s:g} s; it never rises by "
                f"{settings.rise_m:g} m"
            )
            return Event(float(time[moved]), DETECTED, how)
        # Onset: the last rest before the object is higher by `rise_m`.
        climb = derivative(self.points, self.part.rate)[:, 2]
        high = moved + int(risen[0])
        onset = moved + _last_true(climb[moved:high] <= settings.box_rest_m_s, 0)
        # Bounds that depend on no threshold: the last instant without a rise, and a tenth of the rise.
        earliest = _last_true(climb[: onset + 1] <= 0, 0)
        tenth = height[onset] + ONSET_SHARE * (height[high] - height[onset])
        latest = onset + int(np.flatnonzero(height[onset:] >= tenth)[0])
        how = (
            f"last instant at which it rises no faster than {settings.box_rest_m_s:g} m/s before it is {settings.rise_m:g} m "
            f"higher; it moves from {time[moved]:.2f} s"
        )
        how += ", sliding at first" if time[onset] - time[moved] > MIN_SLIDE_S else ""
        bounds = {"earliest_s": float(time[earliest]), "latest_s": float(time[latest])}
        return Event(float(time[onset]), DETECTED, how, **bounds)

    def _first_hand_rise(self) -> int:
        """Return the first index of the first great rise of the hands."""
        least = self.settings.hands_rise_m
        rises = lift_events.great_swings(self.points[:, 2], least, 1)
        if not rises:
            raise NoEventError(
                f"the hands never rise by {least:g} m (lifting.events.hands_rise_m), only by "
                f"{lift_events.greatest_rise(self.points[:, 2]):.3f} m at most"
            )
        return rises[0][0]

    def _first_movement(self) -> int:
        """Return the index of the last rest of the box before it first moves."""
        threshold, lasting = self.settings.box_speed_m_s, self.settings.box_sustained_s
        pace, samples = speed(self.points, self.part.rate), max(1, round(lasting * self.part.rate))
        first = _first_run(pace > threshold, samples)
        if first is None:
            raise NoEventError(
                f"the box never moves faster than {threshold:g} m/s for {lasting:g} s (lifting.events.box_speed_m_s), only than "
                f"{_largest_sustained(pace, samples):.3f} m/s"
            )
        if first == 0:
            raise NoEventError("the box moves from the first frame: its lift-off was not recorded")
        return _last_true(pace[:first] <= self.settings.box_rest_m_s, first - 1) + 1

    def _box_release(self) -> Event:
        """Return the end of the box's movement, or the instant at which the wrists part from it."""
        time, settings = self.part.time, self.settings
        # The wrists part from the box, if they are seen to grip it.
        separation, wrists = None, lift_events.wrist_centre(self.part)
        if wrists is not None:
            separation = self._grip_ends(np.linalg.norm(wrists - self.points, axis=1), closing=False)
        end = len(time) - 1 if separation is None else separation
        pace = speed(self.points, self.part.rate)
        is_moving = (pace > settings.box_speed_m_s) & (time >= self.begin) & (np.arange(len(time)) <= end)
        moving = np.flatnonzero(is_moving)
        if moving.size == 0:
            raise NoEventError(f"the box does not move after {self.begin:.2f} s")
        if moving[-1] < end:
            # Slow placing continues below the threshold of movement; it ends at rest, or when the hands leave.
            rest = np.flatnonzero(pace[moving[-1] : end + 1] <= settings.box_rest_m_s)
            stop = int(moving[-1] + rest[0]) if rest.size else end
            how = f"the box comes to rest (slower than {settings.box_rest_m_s:g} m/s)"
            how += "" if separation is None else f"; the wrists part from it at {time[separation]:.2f} s"
            return Event(float(time[stop]), DETECTED, how)
        if separation is None:
            raise NoEventError(f"the box still moves at the last searched frame, {time[-1]:.2f} s")
        how = f"the wrists part from the moving box by more than {settings.separation_m:g} m"
        return Event(float(time[separation]), DETECTED, how)

    def _hands_release(self) -> Event:
        """Return the end of the hands' last descent before they part, or of their last great descent if they do not part."""
        if self.found["lift_off"].method == ABSENT:
            self._first_hand_rise()
        time, hands, settings = self.part.time, self.points, self.settings
        parted = None
        if all(name in self.part for name in lift_events.WRISTS):
            apart = np.linalg.norm(self.part["L_WRIST"] - self.part["R_WRIST"], axis=1)
            parted = self._grip_ends(apart, closing=True)
        first, last_fall = int(np.searchsorted(time, self.begin)), None
        if parted is not None:
            points = lift_events.turning_points(hands[first : parted + 1, 2], settings.descent_m)
            falls = [
                pair for pair in pairwise(points) if hands[first + pair[1], 2] < hands[first + pair[0], 2]
            ]
            last_fall = falls[-1] if falls else None
        # Hands that part before they have gone down were not holding yet, or never together: only great descents count.
        great = lift_events.great_swings(hands[first:, 2], settings.descent_m, -1)
        if last_fall is None and not great:
            raise NoEventError(
                f"no deposit: the hands do not go down by {settings.descent_m:g} m (lifting.events.descent_m) after "
                f"{self.begin:.2f} s, only by {lift_events.greatest_rise(-hands[first:, 2]):.3f} m at most"
            )
        top, bottom = (first + index for index in last_fall or great[-1])
        climb = derivative(hands, self.part.rate)[:, 2]
        last = _last_true(climb[top : bottom + 1] < -settings.box_rest_m_s, bottom - top)
        stop = min(top + last + 1, bottom)
        if stop >= len(time) - 1:
            raise NoEventError(f"the hands still go down at the last searched frame, {time[-1]:.2f} s")
        how = (
            f"the hands stop going down (slower than {settings.box_rest_m_s:g} m/s) after "
            f"{hands[top, 2] - hands[bottom, 2]:.2f} m; "
        )
        if last_fall is None:
            how += "the last great descent: it is not seen whether they hold anything"
        else:
            how += f"they part, or close, by more than {settings.separation_m:g} m at {time[parted]:.2f} s"
        return Event(float(time[stop]), DETECTED, how)

    def _grip_ends(self, distance: np.ndarray, closing: bool) -> int | None:
        """Return the first index with a distance larger than in the grip (with `closing`, also smaller); None if never."""
        after = self.part.time >= self.begin
        grip = distance[after & (self.part.time <= self.begin + self.settings.grip_s)]
        if not np.isfinite(grip).any():
            return None
        change = distance - np.nanmedian(grip)
        is_open = after & ((np.abs(change) if closing else change) > self.settings.separation_m)
        return _first_run(is_open, max(1, round(self.settings.box_sustained_s * self.part.rate)))

    def _deposit_start(self) -> Event:
        """Return the last instant before the object's final descent, or the wrists' last minimum of speed before it."""
        what, settings, toe_off = self.what, self.settings, self.found["toe_off"].time_s
        start, release = self.begin if toe_off is None else toe_off, self.end
        searched = np.flatnonzero((self.part.time > start) & (self.part.time <= release))
        if searched.size < 3:
            raise NoEventError(f"the {what} {self.be} not seen from {start:.2f} to {release:.2f} s")
        time, height = self.part.time[searched], self.points[searched, 2]
        climb = derivative(self.points, self.part.rate)[searched, 2]
        onset = self._descent_onset(time, height, climb)
        starts = {"descent_s": float(time[onset]), "thesis_s": self._slowest_wrists(searched, onset)}
        if settings.deposit_start == "wrist_minimum":
            before = f"before the {what} {self.go} down at {starts['descent_s']:.2f} s"
            if starts["thesis_s"] is None:
                raise NoEventError(
                    f"the wrists' speed is not known or has no minimum {settings.prominence_m_s:g} m/s deep "
                    f"(lifting.events.prominence_m_s) {before}"
                )
            how = f"last local minimum of the wrists' speed {before}"
            return Event(starts["thesis_s"], DETECTED, how, **starts)
        # Bounds that depend on no threshold: the last instant without a descent, and a tenth of the descent.
        left = float(height[onset] - height[-1])
        earliest = _last_true(climb[: onset + 1] >= 0, 0)
        latest = onset + int(np.flatnonzero(height[onset:] <= height[onset] - ONSET_SHARE * left)[0])
        how = (
            f"last instant at which the {what} {self.go} down no faster than {settings.box_rest_m_s:g} m/s before the last "
            f"{left:.2f} m to the release"
        )
        bounds = {"earliest_s": float(time[earliest]), "latest_s": float(time[latest])}
        return Event(starts["descent_s"], DETECTED, how, **bounds, **starts)

    def _descent_onset(self, time: np.ndarray, height: np.ndarray, climb: np.ndarray) -> int:
        """Return the index at which the object's final descent begins.

        A deposit is a descent of `descent_m`, or a smaller descent if all others are much smaller.
        """
        least = MIN_DESCENT_SHARE * self.settings.descent_m
        ends = height[lift_events.turning_points(height, least / 2)]
        falls = [high - low for high, low in pairwise(ends) if high > low] or [0.0]
        others = MIN_DESCENT_RATIO * max(falls[:-1], default=0.0)
        needed = float(np.clip(others, least, self.settings.descent_m))
        onset = self._last_stop(height, climb, self.settings.descent_m)
        if onset is None:
            onset = self._last_stop(height, climb, needed, least=needed)
        if onset is not None:
            return onset
        # The largest smaller setting that would find a deposit.
        lower = np.arange(int(1e3 * falls[-1]), 4, -1) / 1e3
        stops = ((fall, self._last_stop(height, climb, fall, least=fall)) for fall in lower)
        hints = (f"; {fall:g} would give one from {time[at]:.2f} s" for fall, at in stops if at is not None)
        raise NoEventError(
            f"no deposit: the {self.what} {self.go} down by {height.max() - height[-1]:.3f} m before {time[-1]:.2f} s; a "
            f"deposit needs {needed:.2g} m here from the last rest or rise (lifting.events.descent_m{next(hints, '')})"
        )

    def _last_stop(
        self, height: np.ndarray, climb: np.ndarray, fall: float, least: float = 0.0
    ) -> int | None:
        """Return the index of the last rest in the last rise or stay that is at least `fall` metres above the end of the descent.

        Slowing down, or a small rise during the descent, does not count: a stay lasts, and a rise is as large as a lift. Two
        thresholds of speed separate them, so that noise neither splits a stay nor creates one. A descent may be too slow for
        these thresholds: rests with less than `least` metres below them do not count.
        """
        rests = (climb >= -self.settings.box_rest_m_s) & (height - height[-1] >= least)
        stops = []
        for run in runs(climb >= -self.settings.box_speed_m_s):
            lasting = run.stop - run.start >= self.settings.stay_s * self.part.rate
            resting = run.start + np.flatnonzero(rests[run])
            if (lasting or np.ptp(height[run]) >= fall) and resting.size:
                stops.append(int(resting[-1]))
        return next((stop for stop in reversed(stops) if height[stop] - height[-1] >= fall), None)

    def _slowest_wrists(self, searched: np.ndarray, onset: int) -> float | None:
        """Return the time of the last local minimum of the wrists' speed before the descent, as in the thesis."""
        from scipy.signal import find_peaks

        wrists = lift_events.wrist_centre(self.part)
        pace = None if wrists is None else speed(wrists, self.part.rate)[searched]
        if pace is None or not np.isfinite(pace).all():
            return None
        minima, _ = find_peaks(-pace, prominence=self.settings.prominence_m_s)
        minima = minima[minima <= onset]
        return float(self.part.time[searched[minima[-1]]]) if minima.size else None

    def _toe_off(self) -> Event:
        """Return the first step between lift-off and release."""
        recording, settings = self.whole, self.settings
        toes = [name for name in TOES if name in recording]
        if not toes:
            return Event(None, ABSENT, "no toe markers: the end of the lift is not known")
        searched = (recording.time > self.begin) & (recording.time < self.end)
        # 65 ms are 13 frames at 200 Hz, whatever the rounding of the product.
        samples = max(1, int(np.ceil(settings.toe_sustained_s * recording.rate - 1e-9)))
        starts, hidden, fastest = {}, [], 0.0
        for name in toes:
            foot = speed(recording[name], recording.rate)
            fastest = max(fastest, _largest_sustained(foot[searched], samples))
            first = _first_run((foot > settings.toe_speed_m_s) & searched, samples)
            if first is not None:
                starts[name] = float(recording.time[first])
            if np.isnan(foot[searched]).any():
                hidden.append(name)
        gaps = f"; not always seen: {', '.join(hidden)}" if hidden else ""
        rule = (
            f"toe faster than {settings.toe_speed_m_s:g} m/s for at least {settings.toe_sustained_s:g} s between lift-off and "
            "release"
        )
        if not starts:
            how = f"no toe-off: no {rule} ({', '.join(toes)}), only than {fastest:.2f} m/s (lifting.events.toe_speed_m_s)"
            return Event(None, ABSENT, how + gaps)
        first_toe = min(starts, key=starts.__getitem__)
        return Event(starts[first_toe], DETECTED, f"{first_toe} first: {rule}{gaps}")


def _first_run(flags: np.ndarray, samples: int) -> int | None:
    """Return the index at which `flags` first stays true for at least `samples` samples."""
    return next((run.start for run in runs(flags) if run.stop - run.start >= samples), None)


def _last_true(flags: np.ndarray, default: int) -> int:
    """Return the last index at which `flags` is true, or the default."""
    return int(max(np.flatnonzero(flags), default=default))


def _largest_sustained(values: np.ndarray, samples: int) -> float:
    """Return the largest value that is reached for `samples` samples in a row; 0 if there is none."""
    if len(values) < samples:
        return 0.0
    least = np.lib.stride_tricks.sliding_window_view(values, samples).min(axis=1)
    return float(np.nanmax(least, initial=0.0))
