"""One lift from its markers to the pendulums of the deposit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lumbar.errors import InputError
from lumbar.lifting.centre_of_mass import CentreOfMass, centres_of_mass
from lumbar.lifting.events import EVENTS, TOES, Event, box_centre, find_events, phases, speed, wrist_centre
from lumbar.lifting.filtering import filter_markers
from lumbar.lifting.gaps import Gap, fill_gaps
from lumbar.lifting.pendulum_states import PendulumStates, heading, pendulum_states, pivot_trajectory, turn
from lumbar.lifting.segments import SegmentTable, segment_table
from lumbar.lifting.trunk_points import INNER, TrunkPoints, trunk_points
from lumbar.records.markers import MarkerRecording
from lumbar.settings.plain import plain

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.lifting import LiftingSettings
    from lumbar.settings.subject import SubjectSettings, TrialSettings

FRAMES = ("laboratory", "pelvis")
"""Axes of the planes: those of the laboratory, or turned about the vertical with the hips at the deposit's
start."""


@dataclass(frozen=True)
class AnalysedLift:
    """One analysed lift.

    Attributes
    ----------
    name : str
        E.g. ``"expert_23kg"``.
    recording : MarkerRecording
        Gaps filled, filtered, in the axes of the planes.
    complete : MarkerRecording
        Gaps filled, not filtered, in the same axes.
    gaps : list of Gap
    events : dict of str to Event
    table : SegmentTable
    points : TrunkPoints
        Ends of the segments.
    centres : dict of str to CentreOfMass
    pivot : ndarray, shape (n, 3)
        Metres.
    heading : float
        Radians by which the axes were turned.
    states : dict of (str, str) to PendulumStates
        By centre of mass and plane.
    """

    name: str
    recording: MarkerRecording
    complete: MarkerRecording
    gaps: list[Gap]
    events: dict[str, Event]
    table: SegmentTable
    points: TrunkPoints
    centres: dict[str, CentreOfMass]
    pivot: np.ndarray
    heading: float
    states: dict[tuple[str, str], PendulumStates]


def analyse_lift(
    recording: MarkerRecording,
    name: str,
    subject: SubjectSettings,
    trial: TrialSettings,
    settings: LiftingSettings,
) -> AnalysedLift:
    """Fill gaps, filter, find the events, the centres of mass and the pendulum's states during the deposit.

    Parameters
    ----------
    recording : MarkerRecording
        As read.
    name : str
        Name of the lift.
    subject : SubjectSettings
    trial : TrialSettings
        Of the subject.
    settings : LiftingSettings

    Returns
    -------
    Lift

    Raises
    ------
    InputError, NumericalError
        Naming the file and what is wrong with it.
    """
    complete, gaps = fill_gaps(recording, settings.gaps.maximum_s, settings.gaps.longer)
    smooth = filter_markers(complete, settings.filter.cutoff_Hz, settings.filter.order)
    events = find_events(smooth, settings.events, trial.events)
    start, stop = events["deposit_start"].time_s, events["release"].time_s
    angle = _frame_angle(smooth, settings.frame, start)
    if angle:
        smooth, complete = _turned(smooth, angle), _turned(complete, angle)
    table = segment_table(settings.segments, subject.sex)
    box = settings.box
    points = trunk_points(smooth, settings.segment_ends, settings.hip_centres, subject.sex)
    centres = centres_of_mass(smooth, points, table, subject.mass_kg, trial.box_mass_kg, box.share, events)
    pivot = pivot_trajectory(smooth, points, settings.pivot)
    states = {}
    for com, centre in centres.items():
        position = centre.position_with_box if box.in_position else centre.position
        planar = pendulum_states(
            smooth.time, position - pivot, start, stop, settings.points, f"{recording.source}, {com}"
        )
        states.update({(com, plane): values for plane, values in planar.items()})
    return AnalysedLift(name, smooth, complete, gaps, events, table, points, centres, pivot, angle, states)


def _frame_angle(recording: MarkerRecording, frame: str, time: float) -> float:
    if frame not in FRAMES:
        raise InputError(f"lifting.frame is {frame!r}; allowed: {', '.join(FRAMES)}")
    return heading(recording, time) if frame == "pelvis" else 0.0


def _turned(recording: MarkerRecording, angle: float) -> MarkerRecording:
    from dataclasses import replace

    return replace(
        recording, positions={name: turn(points, angle) for name, points in recording.positions.items()}
    )


def centres_frame(lift: AnalysedLift) -> pd.DataFrame:
    """Trajectories of all centres of mass over the whole recording, one row per sample and centre."""
    import pandas as pd

    phase = phases(lift.recording.time, lift.events)
    frames = []
    for com, centre in lift.centres.items():
        columns = {"com": com, "time_s": lift.recording.time, "phase": phase}
        columns.update(zip(("x_m", "y_m", "z_m"), centre.position.T, strict=True))
        columns.update(
            zip(("x_with_box_m", "y_with_box_m", "z_with_box_m"), centre.position_with_box.T, strict=True)
        )
        columns.update(zip(("pivot_x_m", "pivot_y_m", "pivot_z_m"), lift.pivot.T, strict=True))
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def states_frame(lift: AnalysedLift) -> pd.DataFrame:
    """Pendulum states of the deposit, one row per centre of mass, plane and instant."""
    import pandas as pd

    frames = [
        pd.DataFrame(
            {
                "com": com,
                "plane": plane,
                "time_s": states.time,
                "angle_rad": states.angle,
                "angular_velocity_rad_s": states.angular_velocity,
                "angular_acceleration_rad_s2": states.angular_acceleration,
                "length_m": states.length,
                "length_rate_m_s": states.length_rate,
            }
        )
        for (com, plane), states in lift.states.items()
    ]
    return pd.concat(frames, ignore_index=True)


def gaps_frame(lift: AnalysedLift) -> pd.DataFrame:
    """Gaps of the recording and what became of them."""
    import pandas as pd

    columns = ("marker", "start_s", "length_s", "frames", "outcome")
    rows = [(gap.marker, gap.start_s, gap.length_s, gap.n_frames, gap.outcome) for gap in lift.gaps]
    return pd.DataFrame(rows, columns=columns)


def motion_frame(lift: AnalysedLift) -> pd.DataFrame:
    """Heights and speeds that the events are found from; columns only for what the recording holds."""
    import pandas as pd

    recording = lift.recording
    columns = {"time_s": recording.time}
    for name, points in (("box", box_centre(recording)), ("wrists", wrist_centre(recording))):
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
        "experience": subject.experience,
        "sex": subject.sex,
        "body_mass_kg": subject.mass_kg,
        "box_mass_kg": trial.box_mass_kg,
        "pivot": settings.pivot,
        "frame": settings.frame,
        "heading_rad": lift.heading,
        "angle": "from straight up, to the right (lateral bending) or forward (flexion/extension)",
        "start_s": start,
        "stop_s": stop,
        "duration_s": stop - start,
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
            "points": {name: lift.points.points[name].rule for name in lift.table.ends},
            "off_mm": {name: lift.points.points[name].off_mm for name in lift.table.ends},
        },
        "events": {name: event.method for name, event in lift.events.items()},
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
    said += [f"marker {marker} is derived: {rule}" for marker, rule in sorted(lift.recording.derived.items())]
    said += [
        f"{name} is set by hand: {event.how}"
        for name, event in lift.events.items()
        if event.method == "declared"
    ]
    return said
