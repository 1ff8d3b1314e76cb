"""Ends of the trunk's segments: joint centres of pelvis and spine by published regressions, or points by markers on the skin.

Axes of the pelvis: right along the line from the left to the right anterior superior iliac spine (ASIS), up normal to the
plane of both ASIS and the middle of the posterior spines (PSIS), forward normal to right and up. The origin is the middle of
the ASIS. For an unknown sex, regressions take the mean of the coefficients of both sexes.

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
from functools import cached_property, partial

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.movement.rigid_filling import fill_from_body
from lumbar.records.markers import MarkerRecording

_HIPS = {"male": (-0.095, -0.370, 0.361), "female": (-0.139, -0.336, 0.372)}
_LUMBOSACRAL = {"male": (-0.335, -0.032), "female": (-0.340, 0.049)}
"""L5/S1 forward and up of the middle of the ASIS, shares of the pelvis's width; `_HIPS` has the right as a third share."""
_THORACOLUMBAR = {"male": (94.0, 0.52), "female": (92.0, 0.50)}
"""Direction of T12/L1: angle from the line T12-T8 to the front, degrees; distance: share of the thorax's C7-suprasternale."""
_CERVICAL = {"male": (8.0, 0.55), "female": (14.0, 0.53)}
"""Direction of C7/T1: angle from the line C7-suprasternale upwards, degrees; distance: share of the line's length."""
INNER = "inner"
SIDES = ("L", "R")
MID_HIP = "MID_HIP"
"""Name of the middle between the hips: their joint centres, or the greater trochanters."""
SKIN_MARKERS = {
    "C7T1": ("C7",),
    "T12L1": ("T12",),
    "XIPHOID_LEVEL": ("XIPHOID",),
    "L4L5": ("L5",),
    "L5S1": ("L5",),
    MID_HIP: ("L_HIP", "R_HIP"),
}
"""Markers of the skin points that the thesis takes: each point is the mean of its markers."""
SKIN_TO_JOINT_DISTANCE_MM = {
    "C7T1": 75.0,
    "T12L1": 70.0,
    "XIPHOID_LEVEL": 90.0,
    "L4L5": 80.0,
    "L5S1": 85.0,
    MID_HIP: 20.0,
}
"""Approximate distance of a skin point from the joint's centre, by the regressions on an adult."""
_HIP_YEARS = {"harrington": 2007, "hara": 2016, "reed": 1999}
_HIP_ERROR_MM = {"harrington": 15.0, "hara": 15.0, "reed": 25.0}
_SPINE_ERROR_MM, _ERROR_WITHOUT_T8_MM = 20.0, 25.0
L5_SHARE = 0.2
"""Share of the line from L5/S1 to T12/L1 at which L4/L5 is: one of five lumbar vertebrae."""
_PELVIS_MARKERS = ("L_ASIS", "R_ASIS", "L_PSIS", "R_PSIS", "SACRUM")
_ANKLES = ("L_ANKLE", "R_ANKLE")
_SIDE_PAIRS = (("L_ASIS", "R_ASIS"), ("L_HIP", "R_HIP"), ("L_SHOULDER", "R_SHOULDER"))


@dataclass(frozen=True)
class TrunkPoint:
    """One end of a segment."""

    position: np.ndarray
    """Shape (n, 3): trajectory of the point, metres."""
    rule: str
    """Definition of the point, with its source."""
    inner: bool
    """True for a joint's centre, False for a point on the skin."""
    off_mm: float
    """Possible distance from the joint's centre in mm: for hips the published error, otherwise an assumption."""
    markers: tuple[str, ...]
    """Markers from which the point was computed."""


@dataclass(frozen=True)
class TrunkPoints:
    """Ends of the trunk's segments."""

    points: dict[str, TrunkPoint]
    """Points by their names in `SKIN_MARKERS`."""
    missing: dict[str, str]
    """Points that cannot be computed, with the markers that the recording lacks."""
    right: np.ndarray
    """Shape (n, 3): unit vector to the subject's right."""
    hips: dict[str, np.ndarray]
    """``L_HIP`` and ``R_HIP``, each of shape (n, 3) in metres; empty if `MID_HIP` is missing."""

    def __getitem__(self, name: str) -> np.ndarray:
        return self.points[name].position

    def __contains__(self, name: str) -> bool:
        return name in self.points

    def markers(self, names: Iterable[str]) -> list[str]:
        """Return the markers from which the named points are computed."""
        used = (self.points[name].markers for name in names if name in self)
        return list(dict.fromkeys(marker for markers in used for marker in markers))

    def list_skin_rules(self, names: Iterable[str]) -> list[str]:
        """Return the rules of the named points that are not joint centres."""
        return [self.points[name].rule for name in names if name in self and not self.points[name].inner]


class _MissingMarkersError(Exception):
    """A rule needs markers, or points above, that the recording lacks; the text names them."""

    def __init__(self, text: str, markers: Iterable[str] = ()):
        super().__init__(text)
        self.markers = frozenset(markers)


def trunk_points(recording: MarkerRecording, ends: str, hips: str, sex: str) -> TrunkPoints:
    """Find the ends of the trunk's segments.

    If a joint's centre cannot be estimated, the point on the skin replaces it, and its rule states this and the possible error.
    Joint centres in the file are used unchanged.

    Parameters
    ----------
    recording : MarkerRecording
        Filtered recording.
    ends : {"inner", "skin"}
        Joint centres, or the thesis's points on the skin.
    hips : {"harrington", "hara", "reed"}
        Rule for the hips.
    sex : str
        Sex in the subject's file.
    """
    inner = _InnerPoints(recording, hips, sex)
    points: dict[str, TrunkPoint] = {}
    missing: dict[str, str] = {}
    for name, markers in SKIN_MARKERS.items():
        inside = None
        if ends == INNER and not recording.joints:
            try:
                points[name] = inner.locate(name, points)
                continue
            except _MissingMarkersError as error:
                inside = error
        try:
            _require(recording, markers)
        except _MissingMarkersError as error:
            repeated = inside is not None and error.markers <= inside.markers
            missing[name] = "; ".join(map(str, filter(None, (inside, None if repeated else error))))
            continue
        rule, off = (
            f"{name} is given by {' and '.join(markers)}, joint centres as the file has them",
            _SPINE_ERROR_MM,
        )
        if not recording.joints:
            place = (
                "the middle of the trochanters" if name == MID_HIP else f"the marker {markers[0]} on the skin"
            )
            off = SKIN_TO_JOINT_DISTANCE_MM[name]
            rule = f"{name} is {place}, about {off:g} mm from the joint's centre" + (
                f" ({inside})" if inside else ""
            )
        position = np.mean([recording[marker] for marker in markers], axis=0)
        points[name] = TrunkPoint(position, rule, recording.joints, off, markers)
    sides: dict[str, np.ndarray] = {}
    if MID_HIP in points and points[MID_HIP].inner and not recording.joints:
        forward, up, right = inner.hip
        sides = {
            f"{side}_HIP": inner.pelvis.point(forward, up, s * right) for side, s in (("L", -1), ("R", 1))
        }
    elif MID_HIP in points:
        sides = {name: recording[name] for name in SKIN_MARKERS[MID_HIP]}
    # The subject's right: by the first pair of markers in the recording, else that of the laboratory.
    right = np.tile([1.0, 0.0, 0.0], (len(recording), 1))
    pair = next((pair for pair in _SIDE_PAIRS if all(name in recording for name in pair)), None)
    if pair is not None:
        right = unit(recording[pair[1]] - recording[pair[0]])
    return TrunkPoints(points, missing, right, sides)


def limb_joints(recording: MarkerRecording) -> dict[str, np.ndarray]:
    """Return the elbows, wrists, knees and ankles that the recording has, each of shape (n, 3) in metres.

    A joint is the middle of its lateral and medial marker if the medial marker is seen whenever the lateral is and no alias has
    computed the joint from several markers already; otherwise the joint is its marker.
    """
    names = (f"{side}_{joint}" for side in SIDES for joint in ("ELBOW", "WRIST", "KNEE", "ANKLE"))
    joints = {name: recording[name] for name in names if name in recording}
    for name, lateral in joints.items():
        if f"{name}_MEDIAL" in recording and name not in recording.derived:
            middle = (lateral + recording[f"{name}_MEDIAL"]) / 2
            joints[name] = middle if np.array_equal(np.isfinite(middle), np.isfinite(lateral)) else lateral
    return joints


def _require(recording: MarkerRecording, markers: Iterable[str]) -> None:
    lacking = list(dict.fromkeys(name for name in markers if name not in recording))
    if lacking:
        raise _MissingMarkersError(f"no marker {', '.join(lacking)}", lacking)


@dataclass(frozen=True)
class Pelvis:
    """Size and axes of the pelvis; the axes are unit vectors of shape (n, 3)."""

    origin: np.ndarray
    """Shape (n, 3): middle of the ASIS, metres."""
    forward: np.ndarray
    up: np.ndarray
    right: np.ndarray
    width: float
    """Distance between the ASIS, median over time, metres."""
    depth: float
    """Distance between the middle of the ASIS and the middle of the PSIS, median over time, metres."""
    markers: tuple[str, ...]
    filled: str
    """Text on frames that were filled; empty if there are none."""

    def point(self, forward: float, up: float, right: float = 0.0) -> np.ndarray:
        """Return the trajectory, shape (n, 3) in m, of a point of the pelvis.

        Parameters
        ----------
        forward, up : float
            Distance ahead of the origin in m; distance above the origin in m.
        right : float, default 0.0
            Distance to the right of the origin in m.
        """
        return self.origin + forward * self.forward + up * self.up + right * self.right


class _InnerPoints:
    """Joint centres of one recording; their rules raise `_MissingMarkersError` if markers are missing."""

    def __init__(self, recording: MarkerRecording, hips: str, sex: str):
        self.recording, self.hips, self.sex = recording, hips, sex

    def locate(self, name: str, above: Mapping[str, TrunkPoint]) -> TrunkPoint:
        """Return a point by its name in `SKIN_MARKERS`, given the points above it on the spine."""
        rules = {
            "C7T1": self._cervical,
            "T12L1": self._thoracolumbar,
            "XIPHOID_LEVEL": partial(self._xiphoid_level, above),
            "L4L5": partial(self._fourth_lumbar, above),
            "L5S1": self._lumbosacral,
        }
        if name in rules:
            return rules[name]()
        forward, up, _ = self.hip
        markers, source = self.pelvis.markers, f"{self.hips.title()} et al. {_HIP_YEARS[self.hips]}"
        if self.hips == "hara":
            markers, source = (*markers, *_ANKLES), f"{source}, leg from ASIS to ankle marker"
        rule = f"{MID_HIP} is the middle of the hip joint centres ({source}){self.pelvis.filled}"
        return TrunkPoint(self.pelvis.point(forward, up), rule, True, _HIP_ERROR_MM[self.hips], markers)

    def _row(self, table: Mapping[str, tuple[float, ...]]) -> tuple[float, ...]:
        """Return the coefficients of the subject's sex; the mean of both for an unknown sex."""
        means = (float(np.mean(values)) for values in zip(*table.values(), strict=True))
        return table[self.sex] if self.sex in table else tuple(means)

    @cached_property
    def pelvis(self) -> Pelvis:
        """Size and axes of the pelvis; the sacrum's marker may replace both PSIS."""
        recording = self.recording
        psis = ("L_PSIS", "R_PSIS")
        if not all(name in recording for name in psis) and "SACRUM" in recording:
            psis = ("SACRUM",)
        markers = ("L_ASIS", "R_ASIS", *psis)
        _require(recording, markers)
        body, frames = fill_from_body(
            {name: recording[name] for name in _PELVIS_MARKERS if name in recording}
        )
        counts = ", ".join(f"{name} in {count} frames" for name, count in frames.items() if name in markers)
        filled = f"; not seen and filled from the rest of the pelvis: {counts}" if counts else ""
        left, right, back = body["L_ASIS"], body["R_ASIS"], np.mean([body[name] for name in psis], axis=0)
        origin, rightward, up = (
            (left + right) / 2,
            unit(right - left),
            unit(np.cross(right - back, left - back)),
        )
        if not np.isfinite(up).any():
            raise InputError(
                f"{recording.source}: the markers of the pelvis (ASIS, PSIS) are never seen together"
            )
        width, depth = typical_distance(left, right), typical_distance(origin, back)
        return Pelvis(origin, np.cross(up, rightward), up, rightward, width, depth, markers, filled)

    @cached_property
    def hip(self) -> tuple[float, ...]:
        """Coordinates of the right hip's centre along the axes of the pelvis, metres: forward, up, right."""
        pelvis = self.pelvis
        if self.hips == "harrington":
            # Those of the published equations that need no length of the leg.
            return -0.24 * pelvis.depth - 0.0099, -0.30 * pelvis.width - 0.0109, 0.33 * pelvis.width + 0.0073
        if self.hips == "reed":
            return tuple(share * pelvis.width for share in self._row(_HIPS))
        # Hara: distance of ASIS and ankle with the straightest legs, mean of both sides.
        _require(self.recording, _ANKLES)
        lines = [self.recording[f"{side}_ASIS"] - self.recording[f"{side}_ANKLE"] for side in SIDES]
        leg = float(np.mean([np.nanpercentile(np.linalg.norm(line, axis=1), 95) for line in lines]))
        return 0.011 - 0.063 * leg, -0.009 - 0.078 * leg, 0.008 + 0.086 * leg

    def _lumbosacral(self) -> TrunkPoint:
        pelvis = self.pelvis
        position = pelvis.point(*(share * pelvis.width for share in self._row(_LUMBOSACRAL)))
        rule = f"L5S1 is the joint centre of L5/S1 (Reed et al. 1999){pelvis.filled}"
        return TrunkPoint(position, rule, True, _SPINE_ERROR_MM, pelvis.markers)

    def _fourth_lumbar(self, above: Mapping[str, TrunkPoint]) -> TrunkPoint:
        if "T12L1" not in above:
            raise _MissingMarkersError("no T12/L1 above it")
        bottom, top = self._lumbosacral(), above["T12L1"]
        position = bottom.position + L5_SHARE * (top.position - bottom.position)
        rule = (
            f"L4L5 is the centre of L4/L5, {L5_SHARE:g} of the way from L5/S1 to T12/L1{self.pelvis.filled}"
        )
        off = bottom.off_mm + L5_SHARE * top.off_mm
        return TrunkPoint(position, rule, True, off, (*bottom.markers, *top.markers))

    def _cervical(self) -> TrunkPoint:
        # A marker further down the spine gives the sagittal plane.
        below = next((name for name in ("T12", "SACRUM", "XIPHOID") if name in self.recording), "T12")
        markers = ("C7", "MANUBRIUM", below)
        _require(self.recording, markers)
        c7, front, lower = (self.recording[name] for name in markers)
        angle, share = self._row(_CERVICAL)
        forward = unit(front - c7)
        up = np.cross(unit(np.cross(front - c7, c7 - lower)), forward)
        position = c7 + share * typical_distance(c7, front) * _rotate(forward, up, angle)
        rule = "C7T1 is the joint centre of C7/T1 (Reed et al. 1999)"
        return TrunkPoint(position, rule, True, _SPINE_ERROR_MM, markers)

    def _thoracolumbar(self) -> TrunkPoint:
        # With C7 for T8 the point moves along the spine by about the sine of the angle between both lines.
        has_t8 = "T8" in self.recording
        markers = ("T12", "T8" if has_t8 else "C7", "C7", "MANUBRIUM")
        _require(self.recording, markers)
        t12, above, c7, front = (self.recording[name] for name in markers)
        angle, share = self._row(_THORACOLUMBAR)
        up = unit(above - t12)
        forward = np.cross(up, unit(np.cross(front - c7, c7 - t12)))
        position = t12 + share * typical_distance(c7, front) * _rotate(up, forward, angle)
        rule = (
            f"T12L1 is the joint centre of T12/L1 (Reed et al. 1999{'' if has_t8 else ', C7 in place of T8'})"
        )
        return TrunkPoint(position, rule, True, _SPINE_ERROR_MM if has_t8 else _ERROR_WITHOUT_T8_MM, markers)

    def _xiphoid_level(self, above: Mapping[str, TrunkPoint]) -> TrunkPoint:
        # Foot of the perpendicular from the xiphoid on the line C7/T1-T12/L1.
        _require(self.recording, ("XIPHOID",))
        if not all(name in above and above[name].inner for name in ("C7T1", "T12L1")):
            raise _MissingMarkersError("no C7/T1 and T12/L1 inside the body")
        top, bottom = above["C7T1"], above["T12L1"]
        down = unit(bottom.position - top.position)
        along = np.sum((self.recording["XIPHOID"] - top.position) * down, axis=1, keepdims=True)
        rule = "XIPHOID_LEVEL is the level of the xiphoid on the line C7/T1-T12/L1"
        markers = ("XIPHOID", *top.markers, *bottom.markers)
        return TrunkPoint(top.position + along * down, rule, True, _SPINE_ERROR_MM, markers)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Return the vectors divided by their lengths, shape (n, 3); NaN for a zero vector."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, np.nan)


def typical_distance(start: np.ndarray, end: np.ndarray) -> float:
    """Return the median over time of the distance between two trajectories in m, as a size of the body.

    Parameters
    ----------
    start, end : numpy.ndarray, shape (n, 3)
        Positions in m, NaN if unknown.
    """
    distance = np.linalg.norm(end - start, axis=-1)
    known = distance[np.isfinite(distance)]
    return float(np.median(known)) if known.size else np.nan


def _rotate(start: np.ndarray, towards: np.ndarray, angle_deg: float) -> np.ndarray:
    """Return unit vectors, shape (n, 3), rotated by an angle towards unit vectors at right angles to them."""
    angle = np.deg2rad(angle_deg)
    return np.cos(angle) * start + np.sin(angle) * towards
