"""Ends of the trunk's segments: joint centres of pelvis and spine by published regressions, or markers on the skin.

Axes of the pelvis: right along the line from the left to the right anterior superior iliac spine (ASIS), up normal to the
plane of both ASIS and the middle of the posterior ones (PSIS), forward across both. Its origin is the middle of the ASIS.
Regressions that differ between the sexes take the mean of both rows for an unknown sex.

Sources
-------
Harrington et al., J. Biomech. 40 (2007) 595-602 (hips; magnetic resonance images of 32 people).
Hara et al., Sci. Rep. 6 (2016) 37707 (hips; computed tomography of 180 people).
Reed, Manary and Schneider, SAE 1999-01-0959 (hips, L5/S1, T12/L1, C7/T1), in the axes above as tabulated by
Dumas and Wojtusch, Estimation of the body segment inertial parameters, Handbook of Human Motion (Springer, 2018).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

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
"""Approximate distance of the point on the skin from the joint's centre: by the regressions on an adult."""
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
    """Definition, with its source."""
    inner: bool
    """Whether it is a joint's centre and not a point on the skin."""
    off_mm: float
    """Possible distance from the joint's centre: for hips the published error, otherwise an assumption."""
    markers: tuple[str, ...]
    """Markers it was computed from."""


@dataclass(frozen=True)
class TrunkPoints:
    """Ends of the trunk's segments."""

    points: dict[str, TrunkPoint]
    """By the names of `SKIN_MARKERS`."""
    missing: dict[str, str]
    """Points that the recording does not have, with the markers that would give them."""
    right: np.ndarray
    """Shape (n, 3): unit vector to the subject's right."""
    hips: dict[str, np.ndarray]
    """``L_HIP``, ``R_HIP``, whose middle is `MID_HIP`, shape (n, 3) in metres; empty without it."""

    def __getitem__(self, name: str) -> np.ndarray:
        return self.points[name].position

    def __contains__(self, name: str) -> bool:
        return name in self.points

    def markers(self, names: Iterable[str]) -> list[str]:
        """Return the markers that the named points are computed from."""
        used = (self.points[name].markers for name in names if name in self)
        return list(dict.fromkeys(marker for markers in used for marker in markers))

    def on_skin(self, names: Iterable[str]) -> list[str]:
        """Return the rules of those of the named points that are not joint centres."""
        return [self.points[name].rule for name in names if name in self and not self.points[name].inner]


class _MissingMarkers(Exception):
    """Markers, or ends above, that a rule needs and the recording does not have; the text names them."""

    def __init__(self, text: str, markers: Iterable[str] = ()):
        super().__init__(text)
        self.markers = frozenset(markers)


def trunk_points(recording: MarkerRecording, ends: str, hips: str, sex: str) -> TrunkPoints:
    """Find the ends of the trunk's segments.

    If a joint's centre cannot be estimated, the marker on the skin replaces it, and its rule reports this and the possible error.
    Joint centres of the file are used unchanged.
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
            except _MissingMarkers as error:
                inside = error
        try:
            found[name] = _skin_point(recording, name, str(inside or ""))
        except _MissingMarkers as error:
            repeated = inside is not None and error.markers <= inside.markers
            missing[name] = "; ".join(map(str, filter(None, (inside, None if repeated else error))))
    sides: dict[str, np.ndarray] = {}
    if MID_HIP in found and found[MID_HIP].inner and not recording.joints:
        pelvis, hip = inner.pelvis.pelvis, inner.hip.centre
        sides = {
            f"{side}_HIP": pelvis.point(hip.forward, hip.up, sign * hip.right)
            for side, sign in (("L", -1), ("R", 1))
        }
    elif MID_HIP in found:
        sides = {name: recording[name] for name in SKIN_MARKERS[MID_HIP]}
    # The subject's right: by the first pair of markers in the recording, else that of the laboratory.
    right = np.tile([1.0, 0.0, 0.0], (len(recording), 1))
    pair = next((pair for pair in _PAIRS if all(name in recording for name in pair)), None)
    if pair is not None:
        right = unit(recording[pair[1]] - recording[pair[0]])
    return TrunkPoints(found, missing, right, sides)


def limb_joints(recording: MarkerRecording) -> dict[str, np.ndarray]:
    """Return elbows, wrists, knees and ankles of both sides, shape (n, 3) in metres, as far as the recording has them.

    A joint is the middle of its lateral and medial marker, if the second is seen whenever the first is and no alias has already
    computed the joint from several markers; otherwise it is its marker.
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
        raise _MissingMarkers(f"no marker {', '.join(lacking)}", lacking)


class HipCentre(NamedTuple):
    """Coordinates of the right hip's centre along the axes of the pelvis, metres."""

    forward: float
    up: float
    right: float


@dataclass(frozen=True)
class _SeenPelvis:
    """The pelvis of a recording."""

    pelvis: Pelvis
    markers: tuple[str, ...]
    filled: str
    """Text on frames that were filled; empty without any."""


@dataclass(frozen=True)
class _RuledHip:
    """The right hip by one of `HIP_RULES`."""

    centre: HipCentre
    markers: tuple[str, ...]
    source: str
    """Publication."""


class _InnerPoints:
    """Joint centres of one recording; a rule raises `_MissingMarkers` if its markers are missing."""

    def __init__(self, recording: MarkerRecording, hips: str, sex: str):
        self.recording, self.hips, self.sex = recording, hips, sex

    def point(self, name: str, found: dict[str, TrunkPoint]) -> TrunkPoint:
        """Return a point by its name in `SKIN_MARKERS`; those above it on the spine are in `found`."""
        match name:
            case "C7T1":
                return self.cervical()
            case "T12L1":
                return self.thoracolumbar()
            case "XIPHOID_LEVEL":
                return self.level_of_xiphoid(found)
            case "L4L5":
                return self.fourth_lumbar(found)
            case "L5S1":
                return self.lumbosacral()
        hip = self.hip
        rule = f"{MID_HIP} is the middle of the hip joint centres ({hip.source}){self.pelvis.filled}"
        position = self.pelvis.pelvis.point(hip.centre.forward, hip.centre.up)
        return TrunkPoint(position, rule, True, _HIP_OFF_MM[self.hips], hip.markers)

    @cached_property
    def pelvis(self) -> _SeenPelvis:
        """The pelvis; the sacrum's marker may replace both PSIS."""
        recording = self.recording
        psis = ("L_PSIS", "R_PSIS")
        if not all(name in recording for name in psis) and "SACRUM" in recording:
            psis = ("SACRUM",)
        markers = ("L_ASIS", "R_ASIS", *psis)
        _need(recording, markers)
        body = {name: recording[name] for name in _PELVIS_MARKERS if name in recording}
        seen, frames = fill_from_body(body)
        counts = ", ".join(f"{name} in {count} frames" for name, count in frames.items() if name in markers)
        filled = f"; not seen and filled from the rest of the pelvis: {counts}" if counts else ""
        middle = np.mean([seen[name] for name in psis], axis=0)
        return _SeenPelvis(
            pelvis_of(seen["L_ASIS"], seen["R_ASIS"], middle, recording.source), markers, filled
        )

    @cached_property
    def hip(self) -> _RuledHip:
        """The right hip by the chosen rule."""
        recording, seen = self.recording, self.pelvis
        if self.hips == "harrington":
            return _RuledHip(harrington_hips(seen.pelvis), seen.markers, "Harrington et al. 2007")
        if self.hips == "reed":
            return _RuledHip(reed_hips(seen.pelvis, self.sex), seen.markers, "Reed et al. 1999")
        legs = ("L_ANKLE", "R_ANKLE")
        _need(recording, legs)
        # Distance of ASIS and ankle with the straightest legs, mean of both sides.
        lengths = [
            np.linalg.norm(recording[f"{side}_ASIS"] - recording[f"{side}_ANKLE"], axis=1) for side in "LR"
        ]
        length = float(np.mean([np.nanpercentile(side, 95) for side in lengths]))
        source = "Hara et al. 2016, leg from ASIS to ankle marker"
        return _RuledHip(hara_hips(length), (*seen.markers, *legs), source)

    def lumbosacral(self) -> TrunkPoint:
        seen = self.pelvis
        position = lumbosacral_centre(seen.pelvis, self.sex)
        rule = f"joint centre of L5/S1 (Reed et al. 1999){seen.filled}"
        return self.spine("L5S1", position, rule, seen.markers)

    def fourth_lumbar(self, found: dict[str, TrunkPoint]) -> TrunkPoint:
        if "T12L1" not in found:
            raise _MissingMarkers("no T12/L1 above it")
        below, above = self.lumbosacral(), found["T12L1"]
        position = below.position + L5_SHARE * (above.position - below.position)
        rule = f"centre of L4/L5, {L5_SHARE:g} of the way from L5/S1 to T12/L1{self.pelvis.filled}"
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
        rule, off = "joint centre of T12/L1 (Reed et al. 1999)", _SPINE_OFF_MM
        if above != "T8":
            rule, off = "joint centre of T12/L1 (Reed et al. 1999, C7 in place of T8)", _WITHOUT_T8_OFF_MM
        return self.spine("T12L1", position, rule, markers, off)

    def level_of_xiphoid(self, found: dict[str, TrunkPoint]) -> TrunkPoint:
        """Foot of the perpendicular from the xiphoid on the line C7/T1-T12/L1."""
        _need(self.recording, ("XIPHOID",))
        if not all(name in found and found[name].inner for name in ("C7T1", "T12L1")):
            raise _MissingMarkers("no C7/T1 and T12/L1 inside the body")
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
    """Unit vector."""
    up: np.ndarray
    """Unit vector."""
    right: np.ndarray
    """Unit vector."""
    width: float
    """Distance between the ASIS, median over time, metres."""
    depth: float
    """Distance of their middle from that of the PSIS, median over time, metres."""

    def point(self, forward: float, up: float, right: float = 0.0) -> np.ndarray:
        """Return the trajectory, shape (n, 3), of a point of the pelvis, in metres along its axes."""
        return self.origin + forward * self.forward + up * self.up + right * self.right


def pelvis_of(
    left_asis: np.ndarray, right_asis: np.ndarray, middle_of_psis: np.ndarray, source: str = ""
) -> Pelvis:
    """Return axes and size of the pelvis from trajectories of its markers, each of shape (n, 3) in metres."""
    origin = (left_asis + right_asis) / 2
    right = unit(right_asis - left_asis)
    up = unit(np.cross(right_asis - middle_of_psis, left_asis - middle_of_psis))
    width = typical_distance(left_asis, right_asis)
    depth = typical_distance(origin, middle_of_psis)
    if not np.isfinite(up).any():
        raise InputError(f"{source}: the markers of the pelvis (ASIS, PSIS) are never seen together")
    return Pelvis(origin, np.cross(up, right), up, right, width, depth)


def harrington_hips(pelvis: Pelvis) -> HipCentre:
    """Return the right hip's centre (Harrington et al. 2007).

    The published equations that need no length of the leg, with pelvic depth PD and width PW in millimetres:
    -0.24 PD - 9.9, -0.30 PW - 10.9, 0.33 PW + 7.3.
    """
    return HipCentre(
        -0.24 * pelvis.depth - 0.0099, -0.30 * pelvis.width - 0.0109, 0.33 * pelvis.width + 0.0073
    )


def hara_hips(leg_length: float) -> HipCentre:
    """Return the right hip's centre from the leg's length in metres (Hara et al. 2016).

    The leg's length is that from ASIS to medial malleolus, LL in millimetres: 11 - 0.063 LL, -9 - 0.078 LL,
    8 + 0.086 LL.
    """
    return HipCentre(0.011 - 0.063 * leg_length, -0.009 - 0.078 * leg_length, 0.008 + 0.086 * leg_length)


def reed_hips(pelvis: Pelvis, sex: str) -> HipCentre:
    """Return the right hip's centre (Reed et al. 1999)."""
    return HipCentre(*(share * pelvis.width for share in _row(_HIPS, sex)))


def lumbosacral_centre(pelvis: Pelvis, sex: str) -> np.ndarray:
    """Return the centre of L5/S1, shape (n, 3) in metres (Reed et al. 1999)."""
    return pelvis.point(*(share * pelvis.width for share in _row(_LUMBOSACRAL, sex)))


def cervical_centre(c7: np.ndarray, suprasternale: np.ndarray, below: np.ndarray, sex: str) -> np.ndarray:
    """Return the centre of C7/T1 from markers, each of shape (n, 3) in metres (Reed et al. 1999).

    `below` is one of the spine further down, which gives the sagittal plane.
    """
    angle, share = _row(_CERVICAL, sex)
    forward = unit(suprasternale - c7)
    up = np.cross(_spine_rightward(c7, suprasternale, below), forward)
    return c7 + share * typical_distance(c7, suprasternale) * _turned(forward, up, angle)


def thoracolumbar_centre(
    t12: np.ndarray, above: np.ndarray, c7: np.ndarray, suprasternale: np.ndarray, sex: str
) -> np.ndarray:
    """Return the centre of T12/L1 from markers, each of shape (n, 3) in metres (Reed et al. 1999).

    `above` is T8; with C7 in its place the point is moved along the spine by about the sine of the angle between both lines.
    """
    angle, share = _row(_THORACOLUMBAR, sex)
    up = unit(above - t12)
    forward = np.cross(up, _spine_rightward(c7, suprasternale, t12))
    return t12 + share * typical_distance(c7, suprasternale) * _turned(up, forward, angle)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Return the vectors divided by their lengths, shape (n, 3); NaN for a vector without length."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, np.nan)


def typical_distance(start: np.ndarray, end: np.ndarray) -> float:
    """Return the median over time of the distance of two trajectories: a size of the body."""
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
