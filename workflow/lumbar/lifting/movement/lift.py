"""One lift from its markers to the pendulums of the deposit: the study's, and those of the thesis's choice."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lumbar.base.errors import InputError, LumbarError, Problems
from lumbar.lifting.movement.centre_of_mass import (
    COMS,
    CentreOfMass,
    SegmentTable,
    absent_segments,
    centres_of_mass,
    segment_table,
)
from lumbar.lifting.movement.cleaning import clean, shortest_stretch
from lumbar.lifting.movement.event_detection import find_events
from lumbar.lifting.movement.events import Event, started_by
from lumbar.lifting.movement.gaps import Gap, refuse_open_gaps, why_missing, within
from lumbar.lifting.movement.joint_centres import TrunkPoints, trunk_points
from lumbar.lifting.movement.pendulum_states import (
    PIVOTS,
    THESIS_CHOICE,
    PendulumChoice,
    PendulumStates,
    SamplesMissing,
    heading,
    pendulum_states,
    pivot_trajectory,
    turn,
)
from lumbar.lifting.quality.body import THIGH, landmarks
from lumbar.lifting.quality.findings import MarkerFinding
from lumbar.records.markers import MarkerRecording
from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.subject import SubjectSettings, TrialSettings

NEW_STUDY = "'lumbar new-study'"
"""The command that writes the aliases of a folder of recordings."""


@dataclass(frozen=True)
class AnalysedLift:
    """One analysed lift."""

    name: str
    """E.g. ``"expert_23kg"``."""
    recording: MarkerRecording
    """Gaps filled, filtered, in the axes of the planes."""
    complete: MarkerRecording
    """The whole file, gaps filled, not filtered, in the same axes."""
    gaps: list[Gap]
    events: dict[str, Event]
    table: SegmentTable
    points: TrunkPoints
    """Ends of the segments."""
    centres: dict[str, CentreOfMass]
    pivot: np.ndarray | None
    """Shape (n, 3), or None: metres; None where the recording lacks its markers."""
    heading: float
    """Radians by which the axes were turned."""
    states: dict[tuple[str, str], PendulumStates]
    """By centre of mass and plane."""
    missing: dict[str, str]
    """Centres of mass that have no pendulum, with the reason."""


def analyse_lift(
    recording: MarkerRecording,
    name: str,
    subject: SubjectSettings,
    trial: TrialSettings,
    settings: LiftingSettings,
    filled: Sequence[Gap] = (),
    findings: Sequence[MarkerFinding] = (),
) -> AnalysedLift:
    """Fill gaps, filter, find the events, the centres of mass and the pendulum's states during the deposit.

    What a recording does not hold is left out, with its reason: events in `AnalysedLift.events`, pendulums in
    `AnalysedLift.missing`.

    `recording` is as read. What was filled then (`filled`) goes into the report, what was left out (`findings`) into
    the reasons of what is missing.

    Raises
    ------
    InputError
        Naming the file and what is wrong with it: neither an event nor a centre of mass can be had from it, events set by
        hand contradict it, or with ``gaps.longer: error`` a gap that matters stays open.
    """
    smooth, complete, found = clean(recording, settings)
    smooth, window = within_window(smooth, trial, settings), trial.window_s
    gaps = [*filled, *(gap for gap in found if window is None or within(gap, *window))]
    events = find_events(smooth, settings.events, trial.events)
    table = segment_table(settings.segments, subject.sex)
    points = _points(smooth, subject, settings)
    missing = absent_segments(points, table)
    _refuse_nothing(smooth, events, missing)
    times = [event.time_s for event in events.values() if event.time_s is not None]
    if settings.gaps.longer == "error" and times:
        needed = _needed(points, table.ends, settings.pivot)
        refuse_open_gaps(smooth, gaps, settings.gaps.maximum_s, needed, min(times), max(times))
    angle, without_frame = _frame_angle(smooth, settings.frame, events)
    if angle:
        smooth, complete = _turned(smooth, angle), _turned(complete, angle)
        points = _points(smooth, subject, settings)
    share = settings.box.share
    centres = centres_of_mass(smooth, points, table, subject.mass_kg, trial.box_mass_kg, share, events)
    pivot, without_pivot = _pivot(smooth, points, settings.pivot)
    reasons = filter(None, (no_deposit(events), without_pivot, without_frame))
    states, errors = _pendulums(smooth, centres, pivot, events, settings, "; ".join(reasons))
    for com, error in errors.items():
        missing[com] = str(error)
        if isinstance(error, SamplesMissing):
            needed = _needed(points, table.ends_of(com), settings.pivot)
            ends = _markers_of(points, table.ends_of(com))
            missing[com] += f"; {why_missing(smooth, needed, ends, error.frames, gaps, findings)}"
    return AnalysedLift(
        name, smooth, complete, gaps, events, table, points, centres, pivot, angle, states, missing
    )


def _pendulums(
    recording: MarkerRecording,
    centres: dict[str, CentreOfMass],
    pivot: np.ndarray | None,
    events: dict[str, Event],
    settings: LiftingSettings,
    without: str,
) -> tuple[dict[tuple[str, str], PendulumStates], dict[str, LumbarError]]:
    """States of the deposit by centre of mass and plane, and why a centre has none: `without`, if that is the case for all."""
    states: dict[tuple[str, str], PendulumStates] = {}
    errors: dict[str, LumbarError] = {}
    for com, centre in centres.items():
        position = centre.position_with_box if settings.box.in_position else centre.position
        try:
            if without:
                raise InputError(without)
            start, stop = events["deposit_start"].time_s, events["release"].time_s
            what = f"{recording.source}, {com}"
            planar = pendulum_states(recording.time, position - pivot, start, stop, settings.points, what)
        except LumbarError as error:
            errors[com] = error
        else:
            states.update({(com, plane): values for plane, values in planar.items()})
    return states, errors


@dataclass(frozen=True)
class ThesisPendulums:
    """Pendulums of a lift by the thesis's choice (`THESIS_CHOICE`), if the study's is another."""

    states: dict[tuple[str, str], PendulumStates]
    """By centre of mass and plane."""
    missing: dict[str, str]
    """Centres of mass without a pendulum, with the reason."""

    @property
    def facts(self) -> dict:
        """The choice, mean lengths in m by centre of mass and plane, and what is missing; data for JSON."""
        lengths: dict[str, dict[str, float]] = {}
        for (com, plane), states in self.states.items():
            lengths.setdefault(com, {})[plane] = float(states.length.mean())
        return {**vars(THESIS_CHOICE), "length_m": lengths, "missing": self.missing}


def thesis_pendulums(
    lift: AnalysedLift, subject: SubjectSettings, trial: TrialSettings, settings: LiftingSettings
) -> ThesisPendulums | None:
    """Return the pendulums of the deposit by the thesis's choice, in the axes of the study's planes.

    None if the study's own choice is the thesis's.
    """
    own, points, centres, events = PendulumChoice.of(settings), lift.points, lift.centres, lift.events
    if own == THESIS_CHOICE:
        return None
    if own.segment_ends != THESIS_CHOICE.segment_ends:
        points = _points(
            lift.recording, subject, settings.model_copy(update={"segment_ends": THESIS_CHOICE.segment_ends})
        )
        box = trial.box_mass_kg, settings.box.share
        centres = centres_of_mass(lift.recording, points, lift.table, subject.mass_kg, *box, events)
    pivot, without_pivot = _pivot(lift.recording, points, THESIS_CHOICE.pivot)
    if own.deposit_start != THESIS_CHOICE.deposit_start:
        start = started_by(events["deposit_start"], THESIS_CHOICE.deposit_start)
        events = {**events, "deposit_start": start}
    reason = no_deposit(events) or without_pivot or ""
    states, errors = _pendulums(lift.recording, centres, pivot, events, settings, reason)
    absent = {com: reason for com, reason in lift.missing.items() if com not in lift.centres}
    absent |= absent_segments(points, lift.table) | {com: str(error) for com, error in errors.items()}
    return ThesisPendulums(states, absent)


def _points(recording: MarkerRecording, subject: SubjectSettings, settings: LiftingSettings) -> TrunkPoints:
    return trunk_points(recording, settings.segment_ends, settings.hip_centres, subject.sex)


def within_window(
    smooth: MarkerRecording, trial: TrialSettings, settings: LiftingSettings
) -> MarkerRecording:
    """The trial's window of a filtered recording."""
    if trial.window_s is None:
        return smooth
    start, stop = trial.window_s
    inside = (smooth.time >= start) & (smooth.time <= stop)
    shortest = shortest_stretch(settings.filter.cutoff_Hz, smooth.rate)
    if inside.sum() <= shortest:
        raise InputError(
            f"{smooth.source}: window_s {start:g} to {stop:g} s holds {inside.sum()} frames of the recording, which runs "
            f"from {smooth.time[0]:g} to {smooth.time[-1]:g} s; more than {shortest} are needed"
        )
    return smooth.at(inside)


def _refuse_nothing(recording: MarkerRecording, events: dict[str, Event], missing: dict[str, str]) -> None:
    """Raise an error for a recording that holds neither an event of a lift nor a centre of mass."""
    if len(missing) < len(COMS) or any(event.time_s is not None for event in events.values()):
        return
    problems = Problems(f"{recording.source}: neither an event of a lift nor a centre of mass")
    for name, reason in {**missing, "lift_off": events["lift_off"].how}.items():
        problems.add(name, reason)
    unused = recording.unused[:60]
    problems.add(
        "",
        f"markers of the file that no alias names: {', '.join(unused) or 'none'}",
        recognised_unaliased(recording),
    )
    problems.raise_if_any()


def recognised_unaliased(recording: MarkerRecording) -> str:
    """Say what to do about markers whose usual meaning is known and that no alias names; empty where there are none."""
    known = [
        one for one in landmarks(x for x in recording.unused if x not in THIGH) if one in recording.absent
    ]
    return f"{NEW_STUDY} writes aliases for those that are recognised: {', '.join(known)}" if known else ""


def _needed(points: TrunkPoints, ends: Sequence[str], pivot: str) -> list[str]:
    """Markers that some ends of segments and the pivot are computed from."""
    return list(dict.fromkeys([*PIVOTS[pivot], *_markers_of(points, [*ends, *PIVOTS[pivot]])]))


def _markers_of(points: TrunkPoints, ends: Sequence[str]) -> list[str]:
    used = [points.points[name] for name in ends if name in points]
    return list(dict.fromkeys(marker for end in used for marker in end.markers))


def no_deposit(events: dict[str, Event]) -> str | None:
    """Why there is no deposit to take pendulums from; None where there is one."""
    lacking = [
        f"{name}: {events[name].how}" for name in ("deposit_start", "release") if events[name].time_s is None
    ]
    return f"the deposit is not known: {'; '.join(lacking)}" if lacking else None


def _pivot(
    recording: MarkerRecording, points: TrunkPoints, pivot: str
) -> tuple[np.ndarray | None, str | None]:
    """The pivot's trajectory, or why there is none."""
    try:
        return pivot_trajectory(recording, points, pivot), None
    except InputError as error:
        return None, str(error)


def _frame_angle(
    recording: MarkerRecording, frame: str, events: dict[str, Event]
) -> tuple[float, str | None]:
    """Angle by which the axes are turned about the vertical, and why it is not known where it is not.

    The axes of the planes are those of the laboratory, or turned with the hips at the deposit's start.
    """
    time = events["deposit_start"].time_s
    if frame == "laboratory" or time is None:
        return 0.0, None
    try:
        return heading(recording, time), None
    except InputError as error:
        return 0.0, str(error)


def _turned(recording: MarkerRecording, angle: float) -> MarkerRecording:
    return replace(
        recording, positions={name: turn(points, angle) for name, points in recording.positions.items()}
    )
