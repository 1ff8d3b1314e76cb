"""Ends of the trunk's segments: joint centres of pelvis and spine by published regressions, or markers on the skin.

Axes of the pelvis: right along the line from the left to the right anterior superior iliac spine (ASIS), up normal to
the plane of both ASIS and the middle of the posterior ones (PSIS), forward across both. Its origin is the middle of the
ASIS. Regressions for one sex take the mean of both rows where the sex is not known.

Sources
-------
Harrington et al., J. Biomech. 40 (2007) 595-602 (hips; magnetic resonance images of 32 people).
Hara et al., Sci. Rep. 6 (2016) 37707 (hips; computed tomography of 180 people).
Reed, Manary and Schneider, SAE 1999-01-0959 (hips, L5/S1, T12/L1, C7/T1), in the axes above as tabulated by
Dumas and Wojtusch, Estimation of the body segment inertial parameters, Handbook of Human Motion (Springer, 2018).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.movement.rigid_filling import fill_from_body
from lumbar.records.markers import MarkerRecording

HIP_RULES = ("harrington", "hara", "reed")
_HIPS = {"male": (-0.095, -0.370, 0.361), "female": (-0.139, -0.336, 0.372)}
_LUMBOSACRAL = {"male": (-0.335, -0.032), "female": (-0.340, 0.049)}
"""Forward and up of the middle of the ASIS, shares of the pelvis's width; hips also to the right."""
_THORACOLUMBAR = {"male": (94.0, 0.52), "female": (92.0, 0.50)}
"""Angle from the line T12-T8 towards the front, degrees, and share of the thorax's width C7-suprasternale."""
_CERVICAL = {"male": (8.0, 0.55), "female": (14.0, 0.53)}
"""Angle from the line C7-suprasternale upwards, degrees, and share of its length."""
INNER, SKIN = "inner", "skin"
SIDES = ("L", "R")
MID_HIP = "MID_HIP"
"""Middle between the hips: of their joint centres, or of the greater trochanters."""
SKIN_MARKERS = {
    "C7T1": ("C7",),
    "T12L1": ("T12",),
    "XIPHOID_LEVEL": ("XIPHOID",),
    "L4L5": ("L5",),
    "L5S1": ("L5",),
    MID_HIP: ("L_HIP", "R_HIP"),
}
"""Markers whose mean is the point on the skin, which the thesis takes."""
SKIN_OFF_MM = {"C7T1": 75.0, "T12L1": 70.0, "XIPHOID_LEVEL": 90.0, "L4L5": 80.0, "L5S1": 85.0, MID_HIP: 20.0}
"""How far the point on the skin is from the joint's centre, about: the regressions' distances on an adult."""
_HIP_OFF_MM = {"harrington": 15.0, "hara": 15.0, "reed": 25.0}
_SPINE_OFF_MM, _WITHOUT_T8_OFF_MM = 20.0, 25.0
L5_SHARE = 0.2
"""L4/L5 lies one of the five lumbar vertebrae above L5/S1, on the line to T12/L1."""
_PELVIS_MARKERS = ("L_ASIS", "R_ASIS", "L_PSIS", "R_PSIS", "SACRUM")
_PAIRS = (("L_ASIS", "R_ASIS"), ("L_HIP", "R_HIP"), ("L_SHOULDER", "R_SHOULDER"))


@dataclass(frozen=True)
class TrunkPoint:
    """One end of a segment."""

    position: np.ndarray
    """Shape (n, 3): metres."""
    rule: str
    """What it is, and from what it was computed."""
    inner: bool
    """Whether it is a joint's centre and not a point on the skin."""
    off_mm: float
    """How far from the joint's centre it may be: of hips the published error, of the others an assumption."""
    markers: tuple[str, ...]
    """Markers it was computed from."""


@dataclass(frozen=True)
class TrunkPoints:
    """Ends of the trunk's segments."""

    points: dict[str, TrunkPoint]
    """By the names of `SKIN_MARKERS`."""
    missing: dict[str, str]
    """Points that the recording does not hold, with the markers that would give them."""
    right: np.ndarray
    """Shape (n, 3): unit vector to the person's right."""
    hips: dict[str, np.ndarray]
    """``L_HIP``, ``R_HIP``: what `MID_HIP` is the middle of, shape (n, 3) in metres; none without it."""

    def __getitem__(self, name: str) -> np.ndarray:
        return self.points[name].position

    def __contains__(self, name: str) -> bool:
        return name in self.points

    def on_skin(self, names: Iterable[str]) -> list[str]:
        """Sentences about those of the named points that are no joint centres."""
        return [self.points[name].rule for name in names if name in self and not self.points[name].inner]


class _Lacking(Exception):
    """Markers, or ends above, that a rule needs and the recording does not have; the text names them."""

    def __init__(self, text: str, markers: Iterable[str] = ()):
        super().__init__(text)
        self.markers = frozenset(markers)


def trunk_points(recording: MarkerRecording, ends: str, hips: str, sex: str) -> TrunkPoints:
    """Find the ends of the trunk's segments.

    Where a joint's centre cannot be estimated, the marker on the skin stands for it, and its rule says so and how far it
    may be off. Joint centres of the file are taken as they are.
    The recording is filtered; `ends` are inner (joint centres) or skin (the thesis's markers), `hips` one of `HIP_RULES`.
    """
    inner = _InnerPoints(recording, hips, sex)
    found: dict[str, TrunkPoint] = {}
    missing: dict[str, str] = {}
    for name in SKIN_MARKERS:
        inside = None
        if ends == INNER and not recording.joints:
            try:
                found[name] = inner.point(name, found)
                continue
            except _Lacking as lacking:
                inside = lacking
        try:
            found[name] = _skin_point(recording, name, str(inside or ""))
        except _Lacking as lacking:
            said = inside is not None and lacking.markers <= inside.markers
            missing[name] = "; ".join(map(str, filter(None, (inside, None if said else lacking))))
    hips: dict[str, np.ndarray] = {}
    if MID_HIP in found:
        inside = found[MID_HIP].inner and not recording.joints
        hips = inner.hips_of_sides() if inside else {name: recording[name] for name in SKIN_MARKERS[MID_HIP]}
    return TrunkPoints(found, missing, _rightward(recording), hips)


def limb_joints(recording: MarkerRecording) -> dict[str, np.ndarray]:
    """Elbows, wrists, knees and ankles of both sides, shape (n, 3) in metres, as far as the recording has them.

    A joint is the middle of its lateral and medial marker, where the second is seen whenever the first is and no alias has made
    the joint of several markers already; otherwise it is its marker.
    """
    names = (f"{side}_{joint}" for side in SIDES for joint in ("ELBOW", "WRIST", "KNEE", "ANKLE"))
    joints = {name: recording[name] for name in names if name in recording}
    for name, lateral in joints.items():
        if f"{name}_MEDIAL" in recording and name not in recording.derived:
            middle = (lateral + recording[f"{name}_MEDIAL"]) / 2
            joints[name] = middle if np.array_equal(np.isfinite(middle), np.isfinite(lateral)) else lateral
    return joints


def _skin_point(recording: MarkerRecording, name: str, reason: str) -> TrunkPoint:
    markers = SKIN_MARKERS[name]
    _need(recording, markers)
    position = np.mean([recording[marker] for marker in markers], axis=0)
    what = "the middle of the trochanters" if name == MID_HIP else f"the marker {markers[0]} on the skin"
    if recording.joints:
        rule = f"{name} is given by {' and '.join(markers)}, joint centres as the file has them"
        return TrunkPoint(position, rule, True, _SPINE_OFF_MM, markers)
    off = SKIN_OFF_MM[name]
    rule = f"{name} is {what}, about {off:g} mm from the joint's centre" + (f" ({reason})" if reason else "")
    return TrunkPoint(position, rule, False, off, markers)


def _need(recording: MarkerRecording, markers: tuple[str, ...]) -> None:
    lacking = list(dict.fromkeys(name for name in markers if name not in recording))
    if lacking:
        raise _Lacking(f"no marker {', '.join(lacking)}", lacking)


def _rightward(recording: MarkerRecording) -> np.ndarray:
    for left, right in _PAIRS:
        if left in recording and right in recording:
            return unit(recording[right] - recording[left])
    return np.tile([1.0, 0.0, 0.0], (len(recording), 1))


class _InnerPoints:
    """Joint centres of one recording; a rule raises _Lacking where its markers are not there."""

    def __init__(self, recording: MarkerRecording, hips: str, sex: str):
        self.recording, self.hips, self.sex = recording, hips, sex

    def point(self, name: str, found: dict[str, TrunkPoint]) -> TrunkPoint:
        """Return a point by its name in `SKIN_MARKERS`; those above it on the spine are in `found`."""
        rules: dict[str, Callable[[], TrunkPoint]] = {
            "C7T1": self.cervical,
            "T12L1": self.thoracolumbar,
            "XIPHOID_LEVEL": lambda: self.level_of_xiphoid(found),
            "L4L5": lambda: self.fourth_lumbar(found),
            "L5S1": self.lumbosacral,
            MID_HIP: self.middle_of_hips,
        }
        return rules[name]()

    @cached_property
    def pelvis(self) -> tuple[Pelvis, tuple[str, ...], str]:
        """The pelvis, its markers and what was filled; the sacrum's marker may stand for both PSIS."""
        recording = self.recording
        psis = ("L_PSIS", "R_PSIS")
        if not all(name in recording for name in psis) and "SACRUM" in recording:
            psis = ("SACRUM",)
        markers = ("L_ASIS", "R_ASIS", *psis)
        _need(recording, markers)
        body = {name: recording[name] for name in _PELVIS_MARKERS if name in recording}
        seen, frames = fill_from_body(body)
        carried = ", ".join(f"{name} in {count} frames" for name, count in frames.items() if name in markers)
        middle = np.mean([seen[name] for name in psis], axis=0)
        pelvis = pelvis_of(seen["L_ASIS"], seen["R_ASIS"], middle, recording.source)
        return (
            pelvis,
            markers,
            f"; not seen and carried by the rest of the pelvis: {carried}" if carried else "",
        )

    @cached_property
    def hip(self) -> tuple[tuple[float, float, float], tuple[str, ...], str]:
        """Coordinates of the right hip along the pelvis's axes, the markers they come from, and whose rule it is."""
        pelvis, markers, _ = self.pelvis
        if self.hips == "harrington":
            return harrington_hips(pelvis), markers, "Harrington et al. 2007"
        if self.hips == "reed":
            return reed_hips(pelvis, self.sex), markers, "Reed et al. 1999"
        legs, source = ("L_ANKLE", "R_ANKLE"), "Hara et al. 2016, leg from ASIS to ankle marker"
        _need(self.recording, legs)
        return hara_hips(self.leg_length()), (*markers, *legs), source

    def hips_of_sides(self) -> dict[str, np.ndarray]:
        pelvis, (forward, up, right) = self.pelvis[0], self.hip[0]
        return {"L_HIP": pelvis.point(forward, up, -right), "R_HIP": pelvis.point(forward, up, right)}

    def middle_of_hips(self) -> TrunkPoint:
        (pelvis, _, filled), (centre, markers, source) = self.pelvis, self.hip
        return TrunkPoint(
            pelvis.point(centre[0], centre[1]),
            f"{MID_HIP} is the middle of the hip joint centres ({source}){filled}",
            True,
            _HIP_OFF_MM[self.hips],
            markers,
        )

    def leg_length(self) -> float:
        """Distance of ASIS and ankle when the legs are straightest, mean of both sides, metres."""
        sides = [
            np.linalg.norm(self.recording[f"{side}_ASIS"] - self.recording[f"{side}_ANKLE"], axis=1)
            for side in "LR"
        ]
        return float(np.mean([np.nanpercentile(side, 95) for side in sides]))

    def lumbosacral(self) -> TrunkPoint:
        pelvis, markers, filled = self.pelvis
        position = lumbosacral_centre(pelvis, self.sex)
        return self.spine("L5S1", position, f"joint centre of L5/S1 (Reed et al. 1999){filled}", markers)

    def fourth_lumbar(self, found: dict[str, TrunkPoint]) -> TrunkPoint:
        if "T12L1" not in found:
            raise _Lacking("no T12/L1 above it")
        below, above = self.lumbosacral(), found["T12L1"]
        position = below.position + L5_SHARE * (above.position - below.position)
        filled = self.pelvis[2]
        rule = f"centre of L4/L5, {L5_SHARE:g} of the way from L5/S1 to T12/L1{filled}"
        off = below.off_mm + L5_SHARE * above.off_mm
        return self.spine("L4L5", position, rule, (*below.markers, *above.markers), off)

    def cervical(self) -> TrunkPoint:
        below = next((name for name in ("T12", "SACRUM", "XIPHOID") if name in self.recording), "T12")
        markers = ("C7", "MANUBRIUM", below)
        _need(self.recording, markers)
        position = cervical_centre(*(self.recording[name] for name in markers), self.sex)
        return self.spine("C7T1", position, "joint centre of C7/T1 (Reed et al. 1999)", markers)

    def thoracolumbar(self) -> TrunkPoint:
        above = "T8" if "T8" in self.recording else "C7"
        markers = ("T12", above, "C7", "MANUBRIUM")
        _need(self.recording, markers)
        position = thoracolumbar_centre(*(self.recording[name] for name in markers), self.sex)
        rule = (
            "joint centre of T12/L1 (Reed et al. 1999"
            + ("" if above == "T8" else ", C7 in place of T8")
            + ")"
        )
        off = _SPINE_OFF_MM if above == "T8" else _WITHOUT_T8_OFF_MM
        return self.spine("T12L1", position, rule, markers, off)

    def level_of_xiphoid(self, found: dict[str, TrunkPoint]) -> TrunkPoint:
        """Foot of the perpendicular from the xiphoid on the line C7/T1-T12/L1."""
        _need(self.recording, ("XIPHOID",))
        if not all(name in found and found[name].inner for name in ("C7T1", "T12L1")):
            raise _Lacking("no C7/T1 and T12/L1 inside the body")
        top, bottom = found["C7T1"], found["T12L1"]
        down = unit(bottom.position - top.position)
        along = np.sum((self.recording["XIPHOID"] - top.position) * down, axis=1, keepdims=True)
        rule = "level of the xiphoid on the line C7/T1-T12/L1"
        markers = ("XIPHOID", *top.markers, *bottom.markers)
        return self.spine("XIPHOID_LEVEL", top.position + along * down, rule, markers)

    @staticmethod
    def spine(
        name: str, position: np.ndarray, rule: str, markers: tuple[str, ...], off: float = _SPINE_OFF_MM
    ) -> TrunkPoint:
        return TrunkPoint(position, f"{name} is the {rule}", True, off, markers)


@dataclass(frozen=True)
class Pelvis:
    """Axes and size of the pelvis; arrays of shape (n, 3)."""

    origin: np.ndarray
    """Middle of the ASIS, metres."""
    forward: np.ndarray
    up: np.ndarray
    right: np.ndarray
    """`forward`, `up`, `right`: unit vectors."""
    width: float
    depth: float
    """`width`, `depth`: distance of the ASIS from each other and of their middle from that of the PSIS: medians over time,
    metres."""

    def point(self, forward: float, up: float, right: float = 0.0) -> np.ndarray:
        """Trajectory, shape (n, 3), of a point of the pelvis, in metres along its axes."""
        return self.origin + forward * self.forward + up * self.up + right * self.right


def pelvis_of(
    left_asis: np.ndarray, right_asis: np.ndarray, middle_of_psis: np.ndarray, source: str = ""
) -> Pelvis:
    """Axes and size of the pelvis from trajectories of its markers, each of shape (n, 3) in metres."""
    origin = (left_asis + right_asis) / 2
    right = unit(right_asis - left_asis)
    up = unit(np.cross(right_asis - middle_of_psis, left_asis - middle_of_psis))
    width = typical_distance(left_asis, right_asis)
    depth = typical_distance(origin, middle_of_psis)
    if not np.isfinite(up).any():
        raise InputError(f"{source}: the markers of the pelvis (ASIS, PSIS) are never seen together")
    return Pelvis(origin, np.cross(up, right), up, right, width, depth)


def harrington_hips(pelvis: Pelvis) -> tuple[float, float, float]:
    """Forward, up and rightward coordinate of the right hip's centre in metres (Harrington et al. 2007).

    The published equations that need no length of the leg, with pelvic depth PD and width PW in millimetres:
    -0.24 PD - 9.9, -0.30 PW - 10.9, 0.33 PW + 7.3.
    """
    return (-0.24 * pelvis.depth - 0.0099, -0.30 * pelvis.width - 0.0109, 0.33 * pelvis.width + 0.0073)


def hara_hips(leg_length: float) -> tuple[float, float, float]:
    """Forward, up and rightward coordinate of the right hip's centre from the leg's length, metres (Hara et al. 2016).

    The leg's length is that from ASIS to medial malleolus, LL in millimetres: 11 - 0.063 LL, -9 - 0.078 LL,
    8 + 0.086 LL.
    """
    return (0.011 - 0.063 * leg_length, -0.009 - 0.078 * leg_length, 0.008 + 0.086 * leg_length)


def reed_hips(pelvis: Pelvis, sex: str) -> tuple[float, float, float]:
    """Forward, up and rightward coordinate of the right hip's centre in metres (Reed et al. 1999)."""
    forward, up, right = (share * pelvis.width for share in _row(_HIPS, sex))
    return forward, up, right


def lumbosacral_centre(pelvis: Pelvis, sex: str) -> np.ndarray:
    """Centre of L5/S1, shape (n, 3) in metres (Reed et al. 1999)."""
    return pelvis.point(*(share * pelvis.width for share in _row(_LUMBOSACRAL, sex)))


def cervical_centre(c7: np.ndarray, suprasternale: np.ndarray, below: np.ndarray, sex: str) -> np.ndarray:
    """Centre of C7/T1 from markers, each of shape (n, 3) in metres (Reed et al. 1999).

    `below` is one of the spine further down, which gives the sagittal plane.
    """
    angle, share = _row(_CERVICAL, sex)
    forward = unit(suprasternale - c7)
    up = np.cross(_spine_rightward(c7, suprasternale, below), forward)
    return c7 + share * typical_distance(c7, suprasternale) * _turned(forward, up, angle)


def thoracolumbar_centre(
    t12: np.ndarray, above: np.ndarray, c7: np.ndarray, suprasternale: np.ndarray, sex: str
) -> np.ndarray:
    """Centre of T12/L1 from markers, each of shape (n, 3) in metres (Reed et al. 1999).

    `above` is T8; with C7 in its place the point is moved along the spine by about the sine of the angle between both lines.
    """
    angle, share = _row(_THORACOLUMBAR, sex)
    up = unit(above - t12)
    forward = np.cross(up, _spine_rightward(c7, suprasternale, t12))
    return t12 + share * typical_distance(c7, suprasternale) * _turned(up, forward, angle)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors of length one, shape (n, 3); NaN where a vector has no length."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, np.nan)


def typical_distance(start: np.ndarray, end: np.ndarray) -> float:
    """Median over time of the distance of two trajectories: a size of the body."""
    distance = np.linalg.norm(end - start, axis=-1)
    seen = distance[np.isfinite(distance)]
    return float(np.median(seen)) if seen.size else np.nan


def _spine_rightward(c7: np.ndarray, suprasternale: np.ndarray, below: np.ndarray) -> np.ndarray:
    return unit(np.cross(suprasternale - c7, c7 - below))


def _turned(start: np.ndarray, towards: np.ndarray, angle_deg: float) -> np.ndarray:
    angle = np.deg2rad(angle_deg)
    return np.cos(angle) * start + np.sin(angle) * towards


def _row(table: Mapping[str, tuple[float, ...]], sex: str) -> tuple[float, ...]:
    if sex in table:
        return table[sex]
    return tuple(float(np.mean(values)) for values in zip(*table.values(), strict=True))
