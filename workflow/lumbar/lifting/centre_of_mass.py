"""Centres of mass of the trunk's segments, with and without the box in the hands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.errors import InputError, Problems
from lumbar.lifting.events import Event, box_centre
from lumbar.lifting.joint_centres import unit
from lumbar.lifting.segments import COMS, SegmentTable
from lumbar.lifting.trunk_points import TrunkPoints
from lumbar.records.markers import MarkerRecording

SHARES = ("by_mass", "whole")
"""How the box is shared among the centres of mass: in proportion to the segments' masses, so that trunk and
box together keep their mass, or each pendulum carrying the whole box."""


@dataclass(frozen=True)
class CentreOfMass:
    """Trajectory of one centre of mass.

    Attributes
    ----------
    name : str
        One of `lumbar.lifting.segments.COMS`.
    position : ndarray, shape (n, 3)
        Of the segment alone, metres.
    position_with_box : ndarray, shape (n, 3)
        Of the segment with its share of the box while the box is held; that of the segment otherwise.
    mass_kg : float
        Of the segment alone.
    mass_with_box_kg : float
        With its share of the box.
    """

    name: str
    position: np.ndarray
    position_with_box: np.ndarray
    mass_kg: float
    mass_with_box_kg: float


def segment_centres(points: TrunkPoints, table: SegmentTable, source: str = "") -> dict[str, np.ndarray]:
    """Centre of mass of each trunk segment.

    It lies on the line from the segment's proximal to its distal end, at the table's share of the distance, or ahead
    of that line by another share.

    Parameters
    ----------
    points : TrunkPoints
        Ends of the segments.
    table : SegmentTable
    source : str
        File, for messages.

    Returns
    -------
    dict of str to ndarray, shape (n, 3)
        Metres, by segment; NaN where a marker was not seen.

    Raises
    ------
    InputError
        Naming all ends that the recording lacks.
    """
    problems = Problems(source or "segments")
    for name in table.ends:
        if name not in points:
            problems.add(
                name,
                points.missing.get(name, "not in the recording"),
                f"segment table {table.name} needs it; name its marker's label, or a rule for it, in "
                "lifting.markers.aliases",
            )
    problems.raise_if_any()
    centres = {}
    for segment in table.segments:
        proximal, line = points[segment.proximal], points[segment.distal] - points[segment.proximal]
        forward = unit(np.cross(-line, points.right)) * np.linalg.norm(line, axis=1, keepdims=True)
        centres[segment.name] = proximal + segment.com_share * line + segment.forward_share * forward
    return centres


def trunk_centre(centres: dict[str, np.ndarray], table: SegmentTable) -> np.ndarray:
    """Common centre of mass of the segments, shape (n, 3) in metres."""
    mass = {segment.name: segment.mass_share for segment in table.segments}
    return sum(mass[name] * centres[name] for name in centres) / sum(mass[name] for name in centres)


def box_shares(table: SegmentTable, box_mass: float, share: str) -> dict[str, float]:
    """Mass of the box that each centre of mass carries, in kilograms.

    Parameters
    ----------
    table : SegmentTable
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

    The box counts as a point mass at the centre of its markers, carried from lift-off to release.

    Parameters
    ----------
    recording : MarkerRecording
        Filtered.
    points : TrunkPoints
        Ends of the segments.
    table : SegmentTable
    body_mass, box_mass : float
        Kilograms.
    share : {"by_mass", "whole"}
        How the box is shared among the centres of mass.
    events : dict of str to Event
        `lift_off` and `release` are used.

    Returns
    -------
    dict of str to CentreOfMass
        By `lumbar.lifting.segments.COMS`.
    """
    segments = segment_centres(points, table, recording.source or recording.name)
    carried = box_shares(table, box_mass, share)
    held = (recording.time >= events["lift_off"].time_s) & (recording.time <= events["release"].time_s)
    box = box_centre(recording) if box_mass > 0 else None
    if box_mass > 0 and box is None:
        raise InputError(
            f"{recording.source}: no box markers (BOX_1, ...), so the centre of mass with a box of "
            f"{box_mass:g} kg is "
            "not known; name their labels in lifting.markers.aliases, or set box_mass_kg to 0"
        )
    result = {}
    for segment in table.segments:
        mass, position = segment.mass_share * body_mass, segments[segment.name]
        total = mass + carried[segment.name]
        with_box = position.copy()
        if box is not None:
            with_box[held] = (mass * position[held] + carried[segment.name] * box[held]) / total
        result[segment.name] = CentreOfMass(segment.name, position, with_box, mass, total)
    return {name: result[name] for name in COMS}
