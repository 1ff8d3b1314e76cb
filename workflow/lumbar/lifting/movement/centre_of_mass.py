"""Trunk segments, their published parameters, and centres of mass: of segments, with and without the box, and of the body."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise, product
from math import hypot, nan
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.yaml_file import shipped_yaml
from lumbar.lifting.movement.carried_object import carried_object
from lumbar.lifting.movement.events import Event, held_frames
from lumbar.lifting.movement.joint_centres import MID_HIP, SIDES, TrunkPoints, limb_joints, unit
from lumbar.records.markers import MarkerRecording

COMS = ("thorax", "abdomen", "pelvis")
"""The three centres of mass of the trunk, from top to bottom (thesis, Figure 4.2)."""
HEAD_BEYOND = 0.35
"""The ear canal, centre of head and neck, lies beyond C7/T1 by this share of the line from the hips to C7/T1."""


class LimbSegment(NamedTuple):
    """A segment of one side, or of the middle, in Winter's Table 4.1."""

    mass: float
    """Share of the body's."""
    centre: float
    """From the upper end, share of the segment's length."""
    gyration: float = nan
    """Radius about the centre, across the segment, share of its length; NaN where nothing needs it."""


TRUNK_SHARE = 0.497
"""Mass of the trunk, share of the body's."""
HEAD = LimbSegment(0.081, 1.0, 0.495)
"""Head and neck, from C7/T1 to the ear canal."""
THIGH = LimbSegment(0.100, 0.433, 0.323)
_SHANK_AND_FOOT, _WHOLE_LEG = LimbSegment(0.061, 0.606), LimbSegment(0.161, 0.447)
WHOLE_ARM = LimbSegment(0.050, 0.530, 0.368)
ARM = (
    ("SHOULDER", "ELBOW", LimbSegment(0.028, 0.436, 0.322)),
    ("ELBOW", "WRIST", LimbSegment(0.022, 0.682, 0.468)),
)
LEG = ((MID_HIP, "KNEE", THIGH), ("KNEE", "ANKLE", _SHANK_AND_FOOT))
STRAIGHT_ARM, STRAIGHT_LEG = ("SHOULDER", "WRIST", WHOLE_ARM), (MID_HIP, "ANKLE", _WHOLE_LEG)
"""Segments of each side (Winter, 2009, Table 4.1); straight ones where no marker shows the joint between."""


@dataclass(frozen=True)
class Segment:
    """One trunk segment between two of its ends."""

    name: str
    """One of `COMS`."""
    proximal: str
    distal: str
    """`proximal`, `distal`: its upper and lower end, by the names of `lumbar.lifting.movement.joint_centres.SKIN_MARKERS`.
    """
    mass_share: float
    """Mass as a share of body mass."""
    com_share: float
    """Distance of the centre of mass from the proximal end, as a share of the distance between the ends."""
    forward_share: float = 0.0
    """How far the centre of mass lies ahead of the line between the ends, as a share of the same distance."""


@dataclass(frozen=True)
class SegmentTable:
    """A published set of segment parameters."""

    name: str
    segments: tuple[Segment, ...]
    """In the order of `COMS`."""
    source: str
    """Publication, with what had to be adapted."""

    @property
    def ends(self) -> tuple[str, ...]:
        """Ends of the segments, from top to bottom."""
        return tuple(
            dict.fromkeys(end for segment in self.segments for end in (segment.proximal, segment.distal))
        )

    def ends_of(self, name: str) -> tuple[str, str]:
        """Upper and lower end of one segment."""
        return next((segment.proximal, segment.distal) for segment in self.segments if segment.name == name)


def _published(name: str, said: Mapping, sex: str) -> SegmentTable:
    """A table of ``segments.yaml`` for one sex, or for both."""
    own = said[sex]
    centres = _on_lines(own["centre"], own["pelvis_line"]) if "pelvis_line" in own else own["centre"]
    shares = [centre if isinstance(centre, tuple) else (centre, 0.0) for centre in centres]
    segments = tuple(
        Segment(com, *ends, mass, *share)
        for com, ends, mass, share in zip(COMS, pairwise(said["ends"]), own["mass"], shares, strict=True)
    )
    return SegmentTable(name if sex == "both" else f"{name}_{sex}", segments, said["source"].format(sex=sex))


def _on_lines(centres, pelvis_line: tuple[float, float]) -> list[tuple[float, float]]:
    """Centres (forward, up; shares of the length) as shares along and ahead of their segments' lines."""
    (forward, up), length = pelvis_line, hypot(*pelvis_line)
    thorax, abdomen, (x, y) = centres
    pelvis = (x * forward + y * up) / length, (y * forward - x * up) / length
    return [(-thorax[1], thorax[0]), (-abdomen[1], abdomen[0]), pelvis]


_TABLES = {
    name: {sex: _published(name, said, sex) for sex in ("both", "male", "female") if sex in said}
    for name, said in shipped_yaml(Path(__file__).with_name("segments.yaml")).items()
}
WINTER, DUMAS = _TABLES["winter"]["both"], _TABLES["dumas"]


def segment_table(name: str, sex: str) -> SegmentTable:
    """Return a segment table by its name in the configuration, for a sex as declared in the subject's file.

    De Leva's and Dumas's parameters differ between the sexes, Winter's do not.
    """
    tables = _TABLES[name]
    if "both" not in tables and sex not in tables:
        raise InputError(
            f"lifting.segments is {name}, whose parameters differ between the sexes, but subject.sex is "
            f"{sex!r}; "
            "set female or male, or choose winter"
        )
    return tables.get("both") or tables[sex]


@dataclass(frozen=True)
class CentreOfMass:
    """Trajectory of one centre of mass."""

    name: str
    """One of `COMS`."""
    position: np.ndarray
    """Shape (n, 3): of the segment alone, metres."""
    position_with_box: np.ndarray
    """Shape (n, 3): of the segment with its share of the box while the box is held; that of the segment otherwise."""
    mass_kg: float
    """Of the segment alone."""
    mass_with_box_kg: float
    """With its share of the box."""


def segment_centres(points: TrunkPoints, table: SegmentTable) -> dict[str, np.ndarray]:
    """Centre of mass of each trunk segment, shape (n, 3) in metres; NaN where a marker was not seen.

    It lies on the line from the segment's proximal to its distal end, at the table's share of the distance, or ahead
    of that line by another share. Segments of `absent_segments` are left out.
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
    """Common centre of mass of the table's segments, shape (n, 3) in metres."""
    lacking = [segment.name for segment in table.segments if segment.name not in centres]
    if lacking:
        raise InputError(f"no centre of mass of {', '.join(lacking)}, and so none of the trunk")
    masses = [segment.mass_share for segment in table.segments]
    return np.average([centres[segment.name] for segment in table.segments], axis=0, weights=masses)


def box_shares(table: SegmentTable, box_mass: float, share: str) -> dict[str, float]:
    """Mass of the box that each centre of mass carries, in kilograms.

    `share` is by_mass (in proportion to the segments' masses, so that trunk and box together keep their mass) or whole (each
    pendulum carries the whole box).
    """
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
    lift-off to release, and shared among the centres of mass as `box_shares` says; masses in kilograms. The result is in
    the order of `COMS`, as far as the recording has their landmarks. Where neither box nor hands are seen while it is held,
    it is not known where they are with the box: NaN.
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


def head_centre(recording: MarkerRecording, points: TrunkPoints) -> np.ndarray:
    """Centre of head and neck, shape (n, 3) in metres: of the head's markers, or on the line of the trunk where there are none.

    Markers that are hidden while C7/T1 is seen do not count.
    """
    seen = np.isfinite(points["C7T1"])
    if "HEAD_CENTRE" in recording and np.isfinite(recording["HEAD_CENTRE"][seen]).all():
        return recording["HEAD_CENTRE"]
    return points["C7T1"] + HEAD_BEYOND * (points["C7T1"] - points[MID_HIP])


def limb_parts(
    points: Mapping[str, np.ndarray], side: str, whole: str
) -> Iterator[tuple[LimbSegment, np.ndarray, np.ndarray]]:
    """Segments of an arm or a leg (`whole`: ARM or LEG) of one side with their ends; one straight piece where its joint lacks.

    `points` are shoulders, elbows, wrists, knees, ankles by name, and `MID_HIP`.
    """
    middle, bent, straight = {"ARM": ("ELBOW", ARM, STRAIGHT_ARM), "LEG": ("KNEE", LEG, STRAIGHT_LEG)}[whole]
    for start, end, segment in bent if f"{side}_{middle}" in points else (straight,):
        yield segment, points[start if start == MID_HIP else f"{side}_{start}"], points[f"{side}_{end}"]


def whole_body_centre(recording: MarkerRecording, points: TrunkPoints, table: SegmentTable) -> np.ndarray:
    """Centre of mass of the whole body without the box, shape (n, 3) in metres.

    The trunk is that of the segment table; head and limbs have Winter's shares between the joints of `limb_joints`.

    The recording needs shoulders, wrists and ankles of both sides; elbows and knees are used where they are there.
    """
    names = {f"{side}_{name}" for side in "LR" for name in ("SHOULDER", "WRIST", "ANKLE")}
    lacking = sorted(name for name in names if name not in recording)
    lacking += [f"{name} ({points.missing[name]})" for name in ("C7T1", MID_HIP) if name not in points]
    if lacking:
        raise InputError(f"no {', '.join(lacking)}")
    trunk = trunk_centre(segment_centres(points, table), table)
    moment = TRUNK_SHARE * trunk + HEAD.mass * head_centre(recording, points)
    joints = {**recording.positions, **limb_joints(recording), MID_HIP: points[MID_HIP]}
    for side, whole in product(SIDES, ("ARM", "LEG")):
        for segment, first, last in limb_parts(joints, side, whole):
            moment = moment + segment.mass * (first + segment.centre * (last - first))
    return moment
