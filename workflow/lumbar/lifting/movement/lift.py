"""One lift from its markers to the pendulums of the deposit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import InputError, LumbarError, Problems
from lumbar.lifting.movement.carried_object import (
    WRISTS,
    best_seen,
    box_centre,
    carried_object,
    speed,
    wrist_centre,
)
from lumbar.lifting.movement.centre_of_mass import CentreOfMass, absent_segments, centres_of_mass
from lumbar.lifting.movement.cleaning import clean, shortest_stretch
from lumbar.lifting.movement.event import DECLARED, EVENTS, IN_FILE, Event
from lumbar.lifting.movement.events import TOES, find_events, phases
from lumbar.lifting.movement.gaps import Gap, refuse_open_gaps
from lumbar.lifting.movement.missing_samples import why_missing
from lumbar.lifting.movement.pendulum_states import (
    PIVOTS,
    PendulumStates,
    SamplesMissing,
    heading,
    pendulum_states,
    pivot_trajectory,
    turn,
)
from lumbar.lifting.movement.segments import COMS, SegmentTable, segment_table
from lumbar.lifting.movement.trunk_points import INNER, TrunkPoints, trunk_points
from lumbar.lifting.quality.landmarks import landmarks
from lumbar.records.markers import MarkerRecording
from lumbar.settings.plain import plain

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.lifting.quality.sheet import Finding
    from lumbar.settings.lifting import LiftingSettings
    from lumbar.settings.subject import SubjectSettings, TrialSettings

NEW_STUDY = "'lumbar new-study'"
"""The command that writes the aliases of a folder of recordings."""
FRAMES = ("laboratory", "pelvis")
"""Axes of the planes: those of the laboratory, or turned about the vertical with the hips at the deposit's
start."""


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
    findings: Sequence[Finding] = (),
) -> AnalysedLift:
    """Fill gaps, filter, find the events, the centres of mass and the pendulum's states during the deposit.

    What a recording does not hold is left out, with its reason: events in `AnalysedLift.events`, pendulums in
    `AnalysedLift.missing`.

    Parameters
    ----------
    recording : MarkerRecording
        As read.
    name : str
        Name of the lift.
    trial : TrialSettings
        Of the subject.
    filled : sequence of Gap
        What was filled when the recording was read, for the report.
    findings : sequence of Finding
        What was left out when the recording was read, for the reasons of what is missing.

    Raises
    ------
    InputError
        Naming the file and what is wrong with it: neither an event nor a centre of mass can be had from it, events set by
        hand contradict it, or with ``gaps.longer: error`` a gap that matters stays open.
    """
    cleaned = clean(recording, settings)
    smooth, complete = _within_window(cleaned.smooth, trial, settings), cleaned.complete
    gaps = [*filled, *_gaps_within_window(cleaned.gaps, trial)]
    events = find_events(smooth, settings.events, trial.events)
    table = segment_table(settings.segments, subject.sex)
    points = _points(smooth, subject, settings)
    missing = absent_segments(points, table)
    _refuse_nothing(smooth, events, missing)
    if settings.gaps.longer == "error":
        _refuse_gaps(smooth, gaps, points, table, settings, events)
    angle, without_frame = _frame_angle(smooth, settings.frame, events)
    if angle:
        smooth, complete = _turned(smooth, angle), _turned(complete, angle)
        points = _points(smooth, subject, settings)
    box = settings.box
    centres = centres_of_mass(smooth, points, table, subject.mass_kg, trial.box_mass_kg, box.share, events)
    pivot, without_pivot = _pivot(smooth, points, settings.pivot)
    states, reasons = {}, [no_deposit(events), without_pivot, without_frame]
    for com, centre in centres.items():
        position = centre.position_with_box if box.in_position else centre.position
        try:
            if any(reasons):
                raise InputError("; ".join(filter(None, reasons)))
            start, stop = events["deposit_start"].time_s, events["release"].time_s
            planar = pendulum_states(
                smooth.time, position - pivot, start, stop, settings.points, f"{recording.source}, {com}"
            )
        except SamplesMissing as error:
            needed = _needed(points, table.ends_of(com), settings.pivot)
            ends = _markers_of(points, table.ends_of(com))
            missing[com] = f"{error}; {why_missing(smooth, needed, ends, error.frames, gaps, findings)}"
        except LumbarError as error:
            missing[com] = str(error)
        else:
            states.update({(com, plane): values for plane, values in planar.items()})
    return AnalysedLift(
        name, smooth, complete, gaps, events, table, points, centres, pivot, angle, states, missing
    )


def _points(recording: MarkerRecording, subject: SubjectSettings, settings: LiftingSettings) -> TrunkPoints:
    return trunk_points(recording, settings.segment_ends, settings.hip_centres, subject.sex)


def _within_window(
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
    positions = {name: points[inside] for name, points in smooth.positions.items()}
    return replace(smooth, time=smooth.time[inside], positions=positions)


def _gaps_within_window(gaps: list[Gap], trial: TrialSettings) -> list[Gap]:
    if trial.window_s is None:
        return gaps
    start, stop = trial.window_s
    return [gap for gap in gaps if gap.start_s <= stop and gap.start_s + gap.length_s > start]


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
    known = [name for name in landmarks(recording.unused) if name not in recording]
    return f"{NEW_STUDY} writes aliases for those that are recognised: {', '.join(known)}" if known else ""


def _refuse_gaps(
    recording: MarkerRecording,
    gaps: list[Gap],
    points: TrunkPoints,
    table: SegmentTable,
    settings: LiftingSettings,
    events: dict[str, Event],
) -> None:
    times = [event.time_s for event in events.values() if event.time_s is not None]
    needed = _needed(points, table.ends, settings.pivot)
    if times:
        refuse_open_gaps(recording, gaps, settings.gaps.maximum_s, needed, min(times), max(times))


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
    """Angle by which the axes are turned, and why it is not known where it is not."""
    if frame not in FRAMES:
        raise InputError(f"lifting.frame is {frame!r}; allowed: {', '.join(FRAMES)}")
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


CENTRES_COLUMNS = (
    *("com", "time_s", "phase", "x_m", "y_m", "z_m", "x_with_box_m", "y_with_box_m", "z_with_box_m"),
    *("pivot_x_m", "pivot_y_m", "pivot_z_m"),
)
STATES_COLUMNS = (
    *("com", "plane", "time_s", "angle_rad", "angular_velocity_rad_s", "angular_acceleration_rad_s2"),
    *("length_m", "length_rate_m_s"),
)


def centres_frame(lift: AnalysedLift) -> pd.DataFrame:
    """Trajectories of all centres of mass over the whole recording, one row per sample and centre."""
    import pandas as pd

    phase = phases(lift.recording.time, lift.events)
    nowhere = np.full((len(lift.recording), 3), np.nan)
    pivot = nowhere if lift.pivot is None else lift.pivot
    frames = [pd.DataFrame(columns=list(CENTRES_COLUMNS))]
    for com, centre in lift.centres.items():
        values = [*centre.position.T, *centre.position_with_box.T, *pivot.T]
        columns = [com, lift.recording.time, phase, *values]
        frames.append(pd.DataFrame(dict(zip(CENTRES_COLUMNS, columns, strict=True))))
    return pd.concat(frames[1:] or frames, ignore_index=True)


def states_frame(lift: AnalysedLift) -> pd.DataFrame:
    """Pendulum states of the deposit, one row per centre of mass, plane and instant."""
    return planar_frame(lift.states)


def planar_frame(pendulums: dict[tuple[str, str], PendulumStates]) -> pd.DataFrame:
    """Pendulum states by centre of mass and plane as rows of `STATES_COLUMNS`."""
    import pandas as pd

    frames = [pd.DataFrame(columns=list(STATES_COLUMNS))]
    for (com, plane), states in pendulums.items():
        values = (states.time, states.angle, states.angular_velocity, states.angular_acceleration)
        columns = [com, plane, *values, states.length, states.length_rate]
        frames.append(pd.DataFrame(dict(zip(STATES_COLUMNS, columns, strict=True))))
    return pd.concat(frames[1:] or frames, ignore_index=True)


def gaps_frame(lift: AnalysedLift) -> pd.DataFrame:
    """Gaps of the recording and what became of them."""
    import pandas as pd

    columns = ("marker", "start_s", "length_s", "frames", "outcome", "method")
    rows = [
        (gap.marker, gap.start_s, gap.length_s, gap.n_frames, gap.outcome, gap.method) for gap in lift.gaps
    ]
    return pd.DataFrame(rows, columns=columns)


def motion_frame(lift: AnalysedLift) -> pd.DataFrame:
    """Heights and speeds that the events are found from; columns only for what the recording holds."""
    import pandas as pd

    recording = lift.recording
    columns = {"time_s": recording.time}
    hands = best_seen(recording, WRISTS)
    wrists = hands[0].lower() if len(hands) == 1 else "wrists"
    for name, points in (("box", box_centre(recording)), (wrists, wrist_centre(recording))):
        if points is not None:
            columns[f"{name}_height_m"] = points[:, 2]
            columns[f"{name}_speed_m_s"] = speed(points, recording.rate)
    for name in TOES:
        if name in recording:
            columns[f"{name.lower()}_speed_m_s"] = speed(recording[name], recording.rate)
    return pd.DataFrame(columns)


def landmarks_frame(lift: AnalysedLift) -> pd.DataFrame:
    """Markers, centres of mass and pivot at every event: what a stick figure is drawn from."""
    import pandas as pd

    rows = []
    for event in EVENTS:
        time = lift.events[event].time_s
        if time is None:
            continue
        at = int(np.abs(lift.recording.time - time).argmin())
        points = dict(lift.recording.positions)
        points.update({f"COM_{com}": centre.position for com, centre in lift.centres.items()})
        if lift.pivot is not None:
            points["PIVOT"] = lift.pivot
        points.update({name: point.position for name, point in lift.points.points.items()})
        rows += [
            (event, float(lift.recording.time[at]), name, *positions[at])
            for name, positions in points.items()
            if np.isfinite(positions[at]).all()
        ]
    return pd.DataFrame(rows, columns=["event", "time_s", "point", "x_m", "y_m", "z_m"])


def summary(
    lift: AnalysedLift, subject: SubjectSettings, trial: TrialSettings, settings: LiftingSettings
) -> dict:
    """Say what the pendulums are made of: masses, mean lengths, pivot, rules, assumptions; data for JSON."""
    start, stop = lift.events["deposit_start"].time_s, lift.events["release"].time_s
    lengths: dict[str, dict[str, float]] = {com: {} for com in lift.centres}
    for (com, plane), states in lift.states.items():
        lengths[com][plane] = float(states.length.mean())
    return {
        "schema": "lumbar.pendulum/1",
        "lift": lift.name,
        "subject": subject.name,
        # A study's lifts have none: its tables label people, so that another label calls for no lift again.
        **({"experience": subject.experience} if subject.experience else {}),
        "sex": subject.sex,
        "body_mass_kg": subject.mass_kg,
        "box_mass_kg": trial.box_mass_kg,
        "pivot": settings.pivot,
        "frame": settings.frame,
        "heading_rad": lift.heading,
        "angle": "from straight up, to the right (lateral bending) or forward (flexion/extension)",
        "start_s": start,
        "stop_s": stop,
        "duration_s": None if start is None or stop is None else stop - start,
        "points": settings.points,
        "filter_cutoff_Hz": settings.filter.cutoff_Hz,
        "mass_kg": {
            com: {"without_box": centre.mass_kg, "with_box": centre.mass_with_box_kg}
            for com, centre in lift.centres.items()
        },
        "length_m": lengths,
        "box": plain(settings.box),
        "segments": {
            "table": lift.table.name,
            "source": lift.table.source,
            "ends": {segment.name: [segment.proximal, segment.distal] for segment in lift.table.segments},
            "points": {
                name: lift.points.points[name].rule for name in lift.table.ends if name in lift.points
            },
            "off_mm": {
                name: lift.points.points[name].off_mm for name in lift.table.ends if name in lift.points
            },
        },
        "events": {name: event.method for name, event in lift.events.items()},
        "missing": lift.missing,
        "assumptions": assumptions(lift, subject, trial, settings),
    }


def _shown(value) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def assumptions(
    lift: AnalysedLift, subject: SubjectSettings, trial: TrialSettings, settings: LiftingSettings
) -> list[str]:
    """Say in sentences what behind the result was not measured."""
    values = {**plain(subject), **plain(trial)}
    said = [
        f"{key} = {_shown(values[key])} is assumed" if key in values else f"{key} is assumed"
        for key in subject.assumed
    ]
    if settings.segment_ends == INNER:
        said += lift.points.on_skin(lift.table.ends)
    if carried_object(lift.recording)[1] == "hands":
        said.append(
            "the box has no markers: the hands stand for it, in its events and in the centres of mass with it; whether they "
            "hold anything is not known"
        )
    said += [f"marker {marker} is derived: {rule}" for marker, rule in sorted(lift.recording.derived.items())]
    said += [
        f"{name} is {words}: {event.how}"
        for name, event in lift.events.items()
        if (words := {DECLARED: "set by hand", IN_FILE: "the file's own"}.get(event.method))
    ]
    return said
