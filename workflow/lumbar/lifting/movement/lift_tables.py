"""Results of an analysed lift as tables and facts: body, centres of mass, pendulums, gaps and motion.

Points of the body (joints, feet, hands, load and centres of mass) move over the whole recording, in the axes of the planes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.movement import events as lift_events
from lumbar.lifting.movement.centre_of_mass import COMS, head_centre, segment_centres, whole_body_centre
from lumbar.lifting.movement.event_detection import TOES
from lumbar.lifting.movement.joint_centres import INNER, MID_HIP, SIDES, limb_joints
from lumbar.lifting.movement.pendulum_states import PendulumChoice

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.lifting.movement.lift_analysis import AnalysedLift
    from lumbar.lifting.movement.pendulum_states import PendulumStates
    from lumbar.settings.lifting import LiftingSettings, SubjectSettings, TrialSettings

LIMBS = tuple(
    f"{side}_{name}"
    for side in "LR"
    for name in ("SHOULDER", "ELBOW", "WRIST", "KNEE", "ANKLE", "HEEL", "TOE")
)
TRUNK = ("C7T1", "T12L1", "L4L5", "L5S1", MID_HIP)
WHOLE_BODY, HEAD, LOAD = "WHOLE_BODY", "HEAD", "LOAD"
DECIMALS = 7
"""Decimals of lengths in m in the file: rounding changes accelerations by less than 0.01 m/s² at 200 frames per second."""
CENTRES_COLUMNS = (
    *("com", "time_s", "phase", "x_m", "y_m", "z_m", "x_with_box_m", "y_with_box_m", "z_with_box_m"),
    *("pivot_x_m", "pivot_y_m", "pivot_z_m"),
)
_STATES = {
    "time": "time_s",
    "angle": "angle_rad",
    "angular_velocity": "angular_velocity_rad_s",
    "angular_acceleration": "angular_acceleration_rad_s2",
    "length": "length_m",
    "length_rate": "length_rate_m_s",
}
STATES_COLUMNS = ("com", "plane", *_STATES.values())


def body_frame(lift: AnalysedLift) -> tuple[pd.DataFrame, dict[str, str]]:
    """Return the trajectories of the body's points over the whole recording, and the missing points with their reasons.

    Parameters
    ----------
    lift : AnalysedLift
        Analysed lift.

    Returns
    -------
    frame : pandas.DataFrame
        ``time_s``, ``phase``, ``load_held`` (0 or 1), ``RIGHT_x`` … (unit vector to the subject's right), and for every point
        ``<POINT>_x_m``, ``_y_m``, ``_z_m``: x to the right, y forward, z up; empty if a marker is not seen. Points are
        joints and markers of `LIMBS`, hips, joint centres of `TRUNK`, the centres of mass of its segments (``THORAX_COM`` …), of
        ``HEAD`` and ``WHOLE_BODY`` without the load, and the ``LOAD`` in the hands.
    missing : dict of str to str
        Reason by missing point.
    """
    import pandas as pd

    recording, points = lift.recording, lift.points
    segments = segment_centres(points, lift.table)
    located = {name: recording[name] for name in LIMBS if name in recording}
    located |= limb_joints(recording) | points.hips
    located |= {name: points[name] for name in TRUNK if name in points}
    located |= {com_of(name): values for name, values in segments.items()}
    missing = {name: f"no marker {name}" for name in LIMBS if name not in recording}
    missing |= {f"{side}_HIP": points.missing[MID_HIP] for side in SIDES if MID_HIP in points.missing}
    missing |= {name: points.missing[name] for name in TRUNK if name not in points}
    missing |= {com_of(name): lift.missing[name] for name in COMS if name not in segments}
    rule = recording.derived.get("T12", "")
    if rule and not rule.startswith("mean of "):  # a mean has markers on both sides
        missing["T12"] = "a rule places T12, which has no marker"
    ends = [name for name in ("C7T1", MID_HIP) if name not in points]
    if ends:
        missing[HEAD] = f"no {', '.join(ends)}"
    else:
        located[HEAD] = head_centre(recording, points)
    try:
        located[WHOLE_BODY] = whole_body_centre(recording, points, lift.table)
    except InputError as error:
        missing[WHOLE_BODY] = str(error)
    load, _ = lift_events.locate_load(recording)
    if load is None:
        missing[LOAD] = "no markers on the box and none on the wrists"
    else:
        located[LOAD] = load
    rounded = dict(zip(("RIGHT_x", "RIGHT_y", "RIGHT_z"), points.right.T, strict=True))
    for name, values in located.items():
        rounded |= {f"{name}_{axis}_m": part for axis, part in zip("xyz", values.T, strict=True)}
    exact = pd.DataFrame(
        {
            "time_s": recording.time,
            "phase": lift_events.phases(recording.time, lift.events),
            "load_held": lift_events.frames_with_box(recording.time, lift.events).astype(int),
        }
    )
    return pd.concat([exact, pd.DataFrame(rounded).round(DECIMALS)], axis=1), missing


def com_of(segment: str) -> str:
    """Return the name of the point that is a trunk segment's centre of mass."""
    return f"{segment.upper()}_COM"


def points_of(frame: pd.DataFrame) -> dict[str, np.ndarray]:
    """Return the points of a `body_frame` by name, each of shape (n, 3) in metres."""
    names = [column.removesuffix("_x_m") for column in frame.columns if column.endswith("_x_m")]
    return {name: frame[[f"{name}_{axis}_m" for axis in "xyz"]].to_numpy(dtype=float) for name in names}


def centres_frame(lift: AnalysedLift) -> pd.DataFrame:
    """Return the trajectories of all centres of mass over the whole recording, one row per sample and centre."""
    phase = lift_events.phases(lift.recording.time, lift.events)
    pivot = np.full((len(lift.recording), 3), np.nan) if lift.pivot is None else lift.pivot
    parts = [
        (com, lift.recording.time, phase, *centre.position.T, *centre.position_with_box.T, *pivot.T)
        for com, centre in lift.centres.items()
    ]
    return _stack(CENTRES_COLUMNS, parts)


def states_frame(pendulums: dict[tuple[str, str], PendulumStates]) -> pd.DataFrame:
    """Return the pendulum states of the deposit, one row per centre of mass, plane and instant.

    Parameters
    ----------
    pendulums : dict of (str, str) to PendulumStates
        States by centre of mass and plane.
    """
    parts = [(*which, *(getattr(states, name) for name in _STATES)) for which, states in pendulums.items()]
    return _stack(STATES_COLUMNS, parts)


def _stack(columns: Sequence[str], parts: Sequence[tuple]) -> pd.DataFrame:
    """Return the parts as one table; an empty table with these columns if there are no parts."""
    import pandas as pd

    frames = [pd.DataFrame(dict(zip(columns, part, strict=True))) for part in parts]
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame(columns=list(columns))


def gaps_frame(lift: AnalysedLift) -> pd.DataFrame:
    """Return the gaps of the recording with their outcomes."""
    import pandas as pd

    fields = ("marker", "start_s", "length_s", "n_frames", "outcome", "method")
    rows = [[getattr(gap, name) for name in fields] for gap in lift.gaps]
    return pd.DataFrame(rows, columns=["frames" if name == "n_frames" else name for name in fields])


def motion_frame(lift: AnalysedLift) -> pd.DataFrame:
    """Return the heights and speeds from which events are detected, as far as the recording has them."""
    import pandas as pd

    recording = lift.recording
    columns = {"time_s": recording.time}
    hands = lift_events.most_visible(recording, lift_events.WRISTS)
    wrists = hands[0].lower() if len(hands) == 1 else "wrists"
    for name, points in (
        ("box", lift_events.box_centre(recording)),
        (wrists, lift_events.wrist_centre(recording)),
    ):
        if points is not None:
            columns[f"{name}_height_m"] = points[:, 2]
            columns[f"{name}_speed_m_s"] = lift_events.speed(points, recording.rate)
    for name in TOES:
        if name in recording:
            columns[f"{name.lower()}_speed_m_s"] = lift_events.speed(recording[name], recording.rate)
    return pd.DataFrame(columns)


def landmarks_frame(lift: AnalysedLift) -> pd.DataFrame:
    """Return markers, centres of mass and pivot at every event, for a stick figure."""
    import pandas as pd

    points = lift.recording.positions | {
        f"COM_{com}": centre.position for com, centre in lift.centres.items()
    }
    points |= {} if lift.pivot is None else {"PIVOT": lift.pivot}
    points |= {name: point.position for name, point in lift.points.points.items()}
    rows = []
    for event in lift_events.EVENTS:
        time = lift.events[event].time_s
        if time is not None:
            at = int(np.abs(lift.recording.time - time).argmin())
            rows += [
                (event, float(lift.recording.time[at]), name, *positions[at])
                for name, positions in points.items()
                if np.isfinite(positions[at]).all()
            ]
    return pd.DataFrame(rows, columns=["event", "time_s", "point", "x_m", "y_m", "z_m"])


def summary(
    lift: AnalysedLift, subject: SubjectSettings, trial: TrialSettings, settings: LiftingSettings
) -> dict:
    """Return masses, mean lengths, pivot, rules and assumptions of the pendulums; data for JSON."""
    start, stop = lift.events["deposit_start"].time_s, lift.events["release"].time_s
    lengths: dict[str, dict[str, float]] = {com: {} for com in lift.centres}
    for (com, plane), states in lift.states.items():
        lengths[com][plane] = float(states.length.mean())
    ends = {name: lift.points.points[name] for name in lift.table.ends if name in lift.points}
    return {
        "schema": "lumbar.pendulum/1",
        "lift": lift.recording.name,
        "subject": subject.name,
        # Absent from a study's lifts: its tables label the subjects, so that another label needs no new analysis.
        **({"experience": subject.experience} if subject.experience else {}),
        "sex": subject.sex,
        "body_mass_kg": subject.mass_kg,
        "box_mass_kg": trial.box_mass_kg,
        **vars(PendulumChoice.from_settings(settings)),
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
        "box": settings.box.model_dump(mode="json"),
        "load_seen_by": lift_events.locate_load(lift.recording)[1],
        "segments": {
            "table": lift.table.name,
            "source": lift.table.source,
            "ends": {segment.name: [segment.proximal, segment.distal] for segment in lift.table.segments},
            "points": {name: point.rule for name, point in ends.items()},
            "off_mm": {name: point.off_mm for name, point in ends.items()},
        },
        "events": {name: event.method for name, event in lift.events.items()},
        "missing": lift.missing,
        "assumptions": assumptions(lift, subject, trial, settings),
    }


def assumptions(
    lift: AnalysedLift, subject: SubjectSettings, trial: TrialSettings, settings: LiftingSettings
) -> list[str]:
    """Return sentences on inputs that were assumed, not measured."""
    values = {**vars(subject), **vars(trial)}
    lines = []
    for key in subject.assumed:
        value = values.get(key)
        shown = f"{value:g}" if isinstance(value, float) else value
        lines.append(f"{key} = {shown} is assumed" if key in values else f"{key} is assumed")
    if settings.segment_ends == INNER:
        lines += lift.points.list_skin_rules(lift.table.ends)
    if lift_events.locate_load(lift.recording)[1] == "hands":
        lines.append(
            "the box has no markers: the hands replace it, in its events and in the centres of mass with it; it is not known "
            "whether they hold anything"
        )
    lines += [
        f"marker {marker} is derived: {rule}" for marker, rule in sorted(lift.recording.derived.items())
    ]
    origins = {lift_events.DECLARED: "set by hand", lift_events.IN_FILE: "taken from the file"}
    lines += [
        f"{name} is {origins[event.method]}: {event.how}"
        for name, event in lift.events.items()
        if event.method in origins
    ]
    return lines
