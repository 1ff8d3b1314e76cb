"""Centres of mass of the trunk's segments, with and without the box in the hands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.movement.carried_object import carried_object
from lumbar.lifting.movement.event import Event
from lumbar.lifting.movement.joint_centres import unit
from lumbar.lifting.movement.segments import COMS, SegmentTable
from lumbar.lifting.movement.trunk_points import TrunkPoints
from lumbar.records.markers import MarkerRecording

SHARES = ("by_mass", "whole")
"""How the box is shared among the centres of mass: in proportion to the segments' masses, so that trunk and
box together keep their mass, or each pendulum carrying the whole box."""


@dataclass(frozen=True)
class CentreOfMass:
    """Trajectory of one centre of mass."""

    name: str
    """One of `lumbar.lifting.movement.segments.COMS`."""
    position: np.ndarray
    """Shape (n, 3): of the segment alone, metres."""
    position_with_box: np.ndarray
    """Shape (n, 3): of the segment with its share of the box while the box is held; that of the segment otherwise."""
    mass_kg: float
    """Of the segment alone."""
    mass_with_box_kg: float
    """With its share of the box."""


def segment_centres(points: TrunkPoints, table: SegmentTable) -> dict[str, np.ndarray]:
    """Centre of mass of each trunk segment.

    It lies on the line from the segment's proximal to its distal end, at the table's share of the distance, or ahead
    of that line by another share.

    Parameters
    ----------
    points : TrunkPoints
        Ends of the segments.

    Returns
    -------
    dict of str to ndarray, shape (n, 3)
        Metres, by segment; NaN where a marker was not seen. Segments of `absent_segments` are left out.
    """
    absent, centres = absent_segments(points, table), {}
    for segment in table.segments:
        if segment.name not in absent:
            proximal, line = points[segment.proximal], points[segment.distal] - points[segment.proximal]
            centres[segment.name] = proximal + segment.com_share * line
            # Where the person's right is not seen, only a centre ahead of its line is not known.
            if segment.forward_share:
                forward = unit(np.cross(-line, points.right)) * np.linalg.norm(line, axis=1, keepdims=True)
                centres[segment.name] += segment.forward_share * forward
    return centres


def absent_segments(points: TrunkPoints, table: SegmentTable) -> dict[str, str]:
    """Segments of a table whose ends a recording lacks, each with what is missing and why."""
    absent = {}
    for segment in table.segments:
        lacking = [
            f"{end} ({points.missing[end]})"
            for end in (segment.proximal, segment.distal)
            if end not in points
        ]
        if lacking:
            absent[segment.name] = (
                f"no {', '.join(lacking)}: name the markers' labels, or a rule for them, in lifting.markers.aliases"
            )
    return absent


def trunk_centre(centres: dict[str, np.ndarray], table: SegmentTable) -> np.ndarray:
    """Common centre of mass of the table's segments, shape (n, 3) in metres.

    Raises
    ------
    InputError
        If a segment is not there.
    """
    lacking = [segment.name for segment in table.segments if segment.name not in centres]
    if lacking:
        raise InputError(f"no centre of mass of {', '.join(lacking)}, and so none of the trunk")
    masses = [segment.mass_share for segment in table.segments]
    return np.average([centres[segment.name] for segment in table.segments], axis=0, weights=masses)


def box_shares(table: SegmentTable, box_mass: float, share: str) -> dict[str, float]:
    """Mass of the box that each centre of mass carries, in kilograms.

    Parameters
    ----------
    box_mass : float
        Kilograms.
    share : {"by_mass", "whole"}
        See `SHARES`.
    """
    if share not in SHARES:
        raise InputError(f"lifting.box.share is {share!r}; allowed: {', '.join(SHARES)}")
    trunk = sum(segment.mass_share for segment in table.segments)
    return {
        segment.name: box_mass * (segment.mass_share / trunk if share == "by_mass" else 1.0)
        for segment in table.segments
    }


def centres_of_mass(
    recording: MarkerRecording,
    points: TrunkPoints,
    table: SegmentTable,
    body_mass: float,
    box_mass: float,
    share: str,
    events: dict[str, Event],
) -> dict[str, CentreOfMass]:
    """Centres of mass of the trunk over the whole recording.

    The box counts as a point mass at the centre of its markers, or of the hands where it has none, carried from
    lift-off to release.

    Parameters
    ----------
    recording : MarkerRecording
        Filtered.
    points : TrunkPoints
        Ends of the segments.
    body_mass, box_mass : float
        Kilograms.
    share : {"by_mass", "whole"}
        How the box is shared among the centres of mass.
    events : dict of str to Event
        `lift_off` and `release` are used.

    Returns
    -------
    dict of str to CentreOfMass
        By `lumbar.lifting.movement.segments.COMS`, as far as the recording has their landmarks. Where neither box nor hands are
        seen while it is held, it is not known where they are with the box: NaN.
    """
    segments = segment_centres(points, table)
    carried = box_shares(table, box_mass, share)
    held = held_frames(recording.time, events)
    box, _ = carried_object(recording)
    if box is None:
        box = np.full((len(recording), 3), np.nan)
    result = {}
    for segment in table.segments:
        if segment.name not in segments:
            continue
        mass, position = segment.mass_share * body_mass, segments[segment.name]
        total = mass + carried[segment.name]
        with_box = position.copy()
        if box_mass > 0:
            with_box[held] = (mass * position[held] + carried[segment.name] * box[held]) / total
        result[segment.name] = CentreOfMass(segment.name, position, with_box, mass, total)
    return {name: result[name] for name in COMS if name in result}


def held_frames(time: np.ndarray, events: dict[str, Event]) -> np.ndarray:
    """Whether the box is held, shape (n,): from lift-off to release, as far as there are such events."""
    start, stop = (events[name].time_s for name in ("lift_off", "release"))
    if start is None and stop is None:
        return np.zeros(len(time), dtype=bool)
    return (time >= (time[0] if start is None else start)) & (time <= (time[-1] if stop is None else stop))
