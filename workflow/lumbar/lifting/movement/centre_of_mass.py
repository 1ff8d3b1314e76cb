"""Trunk segments, their published parameters, and centres of mass of the segments (with and without the box) and of the body."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from math import hypot, nan
from typing import NamedTuple

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.movement.events import Event, frames_with_box, locate_load
from lumbar.lifting.movement.joint_centres import MID_HIP, SIDES, TrunkPoints, limb_joints, unit
from lumbar.records.markers import MarkerRecording

COMS = ("thorax", "abdomen", "pelvis")
"""The three centres of mass of the trunk, from top to bottom (thesis, Figure 4.2)."""
HEAD_SHARE = 0.35
"""Distance of the ear canal (centre of head and neck) beyond C7/T1, as a share of the line from the hips to C7/T1."""


class LimbSegment(NamedTuple):
    """A segment of a limb, or head and neck, in Winter's Table 4.1."""

    mass: float
    """Mass of the segment, share of the body's mass."""
    centre: float
    """Distance of the centre of mass from the upper end, share of the segment's length."""
    gyration: float = nan
    """Radius of gyration about the centre, across the segment, share of the segment's length; NaN if not needed."""


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
"""Straight limbs (Winter, 2009, Table 4.1), used if no marker shows the elbow or knee."""


@dataclass(frozen=True)
class Segment:
    """One trunk segment between two ends."""

    name: str
    """Name of the segment, one of `COMS`."""
    proximal: str
    """Upper end, a key of `lumbar.lifting.movement.joint_centres.SKIN_MARKERS`."""
    distal: str
    """Lower end, a key of `lumbar.lifting.movement.joint_centres.SKIN_MARKERS`."""
    mass_share: float
    """Mass as a share of body mass."""
    com_share: float
    """Distance of the centre of mass from the proximal end, as a share of the distance between the ends."""
    forward_share: float = 0.0
    """Distance of the centre of mass ahead of the line between the ends, as a share of the distance between the ends."""


@dataclass(frozen=True)
class SegmentTable:
    """A published set of segment parameters."""

    name: str
    segments: tuple[Segment, ...]
    """Segments in the order of `COMS`."""
    source: str
    """Publication, with the adaptations."""

    @property
    def ends(self) -> tuple[str, ...]:
        """Return the ends of the segments, from top to bottom."""
        return tuple(dict.fromkeys(end for segment in self.segments for end in self.ends_of(segment.name)))

    def ends_of(self, name: str) -> tuple[str, str]:
        """Return the upper and lower end of one segment."""
        return next((segment.proximal, segment.distal) for segment in self.segments if segment.name == name)


def _table(
    name: str,
    source: str,
    ends: Sequence[str],
    mass: Sequence[float],
    centre: Sequence[float],
    forward: Sequence[float] = (0.0, 0.0, 0.0),
) -> SegmentTable:
    """Return a table with masses as shares of body mass, and centres as shares along and ahead of the lines between the ends."""
    rows = zip(COMS, pairwise(ends), mass, centre, forward, strict=True)
    return SegmentTable(name, tuple(Segment(com, *pair, *shares) for com, pair, *shares in rows), source)


WINTER = _table(
    "winter",
    "Winter, Biomechanics and Motor Control of Human Movement, 4th ed. (2009), Table 4.1, after Dempster (1955): thorax "
    "C7/T1-T12/L1, abdomen T12/L1-L4/L5, pelvis L4/L5-greater trochanter",
    ("C7T1", "T12L1", "L4L5", MID_HIP),
    mass=(0.216, 0.139, 0.142),
    centre=(0.82, 0.44, 0.105),
)


def _de_leva(sex: str, mass: Sequence[float], centre: Sequence[float]) -> SegmentTable:
    source = (
        f"de Leva, J. Biomech. 29 (1996) 1223-1230, Table 4 ({sex}): upper trunk cervicale-xiphion, middle trunk "
        "xiphion-omphalion, lower trunk omphalion-mid-hip. Adapted: C7/T1 replaces the level of the cervicale, and L4/L5 "
        "the navel (omphalion), which carries no marker and lies at about its level. Its segments end at other heights than "
        "Winter's: compare the trunk's centre, not segments"
    )
    return _table(f"de_leva_{sex}", source, ("C7T1", "XIPHOID_LEVEL", "L4L5", MID_HIP), mass, centre)


def _dumas(
    sex: str,
    mass: Sequence[float],
    centre: Sequence[tuple[float, float]],
    pelvis_line: tuple[float, float],
) -> SegmentTable:
    """Return Dumas's table of one sex from centres forward and up of the upper end, for the pelvis in the axes of the pelvis."""
    source = (
        f"Dumas and Wojtusch, Handbook of Human Motion (2018), Table 1 ({sex}), after McConville et al. and Young et al.: thorax "
        "C7/T1-T12/L1, abdomen T12/L1-L5/S1, pelvis L5/S1-hips. Adapted: the pelvis's centre, published in the axes of ASIS and "
        "PSIS, is taken along and ahead of the line L5/S1-hips, as both lie in the regressions it comes with"
    )
    (forward, up), length = pelvis_line, hypot(*pelvis_line)
    thorax, abdomen, (x, y) = centre
    along = (-thorax[1], -abdomen[1], (x * forward + y * up) / length)
    ahead = (thorax[0], abdomen[0], (y * forward - x * up) / length)
    return _table(f"dumas_{sex}", source, ("C7T1", "T12L1", "L5S1", MID_HIP), mass, along, ahead)


DE_LEVA = {
    "male": _de_leva("male", (0.1596, 0.1633, 0.1117), (0.5066, 0.4502, 0.6115)),
    "female": _de_leva("female", (0.1545, 0.1465, 0.1247), (0.5050, 0.4512, 0.4920)),
}
DUMAS = {
    "male": _dumas(
        "male", (0.304, 0.029, 0.142), ((0.0, -0.555), (0.176, -0.361), (-0.002, -0.282)), (0.240, -0.338)
    ),
    "female": _dumas(
        "female", (0.263, 0.041, 0.147), ((0.015, -0.542), (0.219, -0.410), (-0.072, -0.228)), (0.201, -0.385)
    ),
}


def segment_table(name: str, sex: str) -> SegmentTable:
    """Return a segment table by its name in the configuration, for the sex declared in the subject's file.

    Parameters
    ----------
    name : {"winter", "de_leva", "dumas"}
        Name of the table.
    sex : str
        ``male`` or ``female``; for ``winter`` any value, because its parameters do not differ between the sexes.

    Raises
    ------
    InputError
        If the table needs a sex and the sex is not known.
    """
    if name == "winter":
        return WINTER
    tables = {"de_leva": DE_LEVA, "dumas": DUMAS}[name]
    if sex not in tables:
        raise InputError(
            f"lifting.segments is {name}, whose parameters differ between the sexes, but subject.sex is "
            f"{sex!r}; set female or male, or choose winter"
        )
    return tables[sex]


@dataclass(frozen=True)
class CentreOfMass:
    """Trajectory of one centre of mass."""

    position: np.ndarray
    """Shape (n, 3): position without the box, metres."""
    position_with_box: np.ndarray
    """Shape (n, 3): position with the segment's share of the box while the box is held, metres; otherwise as `position`."""
    mass_kg: float
    mass_with_box_kg: float
    """Mass with its share of the box."""


def segment_centres(points: TrunkPoints, table: SegmentTable) -> dict[str, np.ndarray]:
    """Return the centre of mass of each trunk segment, shape (n, 3) in metres; NaN if a marker is not seen.

    The centre is at the table's share of the distance from the proximal to the distal end, and ahead of the line between the
    ends by the table's forward share. Segments in `absent_segments` are left out.

    Parameters
    ----------
    points : TrunkPoints
        Ends of the segments.
    table : SegmentTable
        Parameters of the segments.
    """
    absent, centres = absent_segments(points, table), {}
    for segment in table.segments:
        if segment.name not in absent:
            proximal, line = points[segment.proximal], points[segment.distal] - points[segment.proximal]
            centres[segment.name] = proximal + segment.com_share * line
            # Only a centre ahead of its line needs the subject's right.
            if segment.forward_share:
                forward = unit(np.cross(-line, points.right)) * np.linalg.norm(line, axis=1, keepdims=True)
                centres[segment.name] += segment.forward_share * forward
    return centres


def absent_segments(points: TrunkPoints, table: SegmentTable) -> dict[str, str]:
    """Return the segments with missing ends, each with the markers that the recording lacks and a remedy."""
    absent = {}
    for segment in table.segments:
        ends = [end for end in (segment.proximal, segment.distal) if end not in points]
        if ends:
            lacking = ", ".join(f"{end} ({points.missing[end]})" for end in ends)
            absent[segment.name] = (
                f"no {lacking}: name the markers' labels, or a rule for them, in lifting.markers.aliases"
            )
    return absent


def centres_of_mass(
    recording: MarkerRecording,
    points: TrunkPoints,
    table: SegmentTable,
    masses_kg: tuple[float, float],
    share: str,
    events: dict[str, Event],
) -> dict[str, CentreOfMass]:
    """Return the centres of mass of the trunk over the whole recording in the order of `COMS`, without segments that lack an end.

    The box is a point mass at the centre of its markers, or of the hands if it has none, carried from lift-off to release.
    Positions with the box are NaN while the box is held and neither box nor hands are seen.

    Parameters
    ----------
    recording : MarkerRecording
        Filtered recording.
    points : TrunkPoints
        Ends of the segments.
    table : SegmentTable
        Parameters of the segments.
    masses_kg : tuple of float
        Mass of the body and of the box.
    share : {"by_mass", "whole"}
        ``by_mass`` shares the box among the centres in proportion to the segments' masses, so that the masses add up to trunk and
        box; ``whole`` adds the whole box to each centre.
    events : dict of str to Event
        Events of the lift.
    """
    body_mass, box_mass = masses_kg
    segments = segment_centres(points, table)
    trunk = sum(segment.mass_share for segment in table.segments)
    is_held = frames_with_box(recording.time, events)
    box, _ = locate_load(recording)
    if box is None:
        box = np.full((len(recording), 3), np.nan)
    result = {}
    # Tables have their segments in the order of `COMS`.
    for segment in (segment for segment in table.segments if segment.name in segments):
        mass, position = segment.mass_share * body_mass, segments[segment.name]
        carried = box_mass * (segment.mass_share / trunk if share == "by_mass" else 1.0)
        with_box = position.copy()
        if box_mass > 0:
            with_box[is_held] = (mass * position[is_held] + carried * box[is_held]) / (mass + carried)
        result[segment.name] = CentreOfMass(position, with_box, mass, mass + carried)
    return result


def head_centre(recording: MarkerRecording, points: TrunkPoints) -> np.ndarray:
    """Return the centre of head and neck, shape (n, 3) in metres: mean of the head's markers, else a point on the trunk's line.

    Head markers that are hidden while C7/T1 is seen are not used.
    """
    if "HEAD_CENTRE" in recording:
        visible = np.isfinite(points["C7T1"])
        if np.isfinite(recording["HEAD_CENTRE"][visible]).all():
            return recording["HEAD_CENTRE"]
    return points["C7T1"] + HEAD_SHARE * (points["C7T1"] - points[MID_HIP])


def limb_parts(
    points: Mapping[str, np.ndarray], side: str, whole: str
) -> Iterator[tuple[LimbSegment, np.ndarray, np.ndarray]]:
    """Yield the segments of an arm or a leg with their ends; the straight limb if elbow or knee is missing.

    Parameters
    ----------
    points : mapping of str to numpy.ndarray, shape (n, 3)
        Shoulders, elbows, wrists, knees, ankles by name, and `MID_HIP`, in m.
    side : {"L", "R"}
        Left or right.
    whole : {"ARM", "LEG"}
        Arm or leg.
    """
    middle, bent, straight = {"ARM": ("ELBOW", ARM, STRAIGHT_ARM), "LEG": ("KNEE", LEG, STRAIGHT_LEG)}[whole]
    for start, end, segment in bent if f"{side}_{middle}" in points else (straight,):
        yield segment, points[start if start == MID_HIP else f"{side}_{start}"], points[f"{side}_{end}"]


def whole_body_centre(recording: MarkerRecording, points: TrunkPoints, table: SegmentTable) -> np.ndarray:
    """Return the centre of mass of the whole body without the box, shape (n, 3) in metres.

    Trunk segments have the parameters of `table`; head and limbs have Winter's shares between the joints of `limb_joints`.

    Parameters
    ----------
    recording : MarkerRecording
        Needs shoulders, wrists and ankles of both sides; elbows and knees are used if present.
    points : TrunkPoints
        Ends of the trunk's segments.
    table : SegmentTable
        Parameters of the trunk's segments.

    Raises
    ------
    InputError
        If the recording lacks markers or segments.
    """
    names = {f"{side}_{name}" for side in "LR" for name in ("SHOULDER", "WRIST", "ANKLE")}
    lacking = sorted(name for name in names if name not in recording)
    lacking += [f"{name} ({points.missing[name]})" for name in ("C7T1", MID_HIP) if name not in points]
    if lacking:
        raise InputError(f"no {', '.join(lacking)}")
    centres = segment_centres(points, table)
    absent = [segment.name for segment in table.segments if segment.name not in centres]
    if absent:
        raise InputError(f"no centre of mass of {', '.join(absent)}, and so none of the trunk")
    weights = [segment.mass_share for segment in table.segments]
    trunk = np.average([centres[segment.name] for segment in table.segments], axis=0, weights=weights)
    moment = TRUNK_SHARE * trunk + HEAD.mass * head_centre(recording, points)
    joints = {**recording.positions, **limb_joints(recording), MID_HIP: points[MID_HIP]}
    for side, whole in product(SIDES, ("ARM", "LEG")):
        for segment, first, last in limb_parts(joints, side, whole):
            moment = moment + segment.mass * (first + segment.centre * (last - first))
    return moment
