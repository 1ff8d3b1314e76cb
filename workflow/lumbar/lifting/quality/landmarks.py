"""What labels of usual marker sets stand for: landmarks, their sides, their levels along the trunk."""

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_yaml

_SAID = shipped_yaml(Path(__file__).with_suffix(".yaml"))
_LABELS: dict[str, list[str]] = _SAID["midline"]
_SIDED_LABELS: dict[str, list[str]] = _SAID["sided"]
_JOINTS, _JOINTS_OF_THE_MIDLINE = _SAID["joints"], _SAID["joints_of_the_midline"]
LEVELS: dict[str, float] = _SAID["levels"]
"""Height along the trunk: 0 at the pelvis, 1 at the shoulders. Those of the other vertebrae follow from C7 and the
sacrum by `vertebra_level`."""
LENGTHS: dict[tuple[str, ...], float] = {
    tuple(ends.split()): share for ends, share in _SAID["lengths"].items()
}
"""Distances as shares of stature, between markers on the skin."""
THIGH = ("LHIP", "RHIP")
"""Labels that some laboratories give to markers on the thigh: not taken for hips unasked."""
_VERTEBRA = re.compile(r"^([TL])V?(\d{1,2})$")


def landmarks(labels: Iterable[str], meant: dict[str, str] | None = None) -> dict[str, str]:
    """Landmark to label, for the labels whose meaning is known.

    Parameters
    ----------
    labels : iterable of str
        Without subject prefixes.
    meant : dict of str to str, optional
        Landmark to label, by a laboratory's own aliases: they go before the usual meaning.

    Examples
    --------
    >>> landmarks(["CV7", "TV8", "L_IAS", "PSISr", "whatever"])
    {'C7': 'CV7', 'L_ASIS': 'L_IAS', 'R_PSIS': 'PSISr', 'T8': 'TV8'}
    >>> landmarks(["r.ASIS_study", "L_calc_study", "LeftAnkle"])
    {'R_ASIS': 'r.ASIS_study', 'L_ANKLE': 'LeftAnkle', 'L_HEEL': 'L_calc_study'}
    """
    bare = {_bare(label): label for label in labels}
    found, skeleton = {}, is_skeleton(bare)
    for landmark, names in _LABELS.items():
        _take(found, landmark, names, bare)
    for landmark, names in _SIDED_LABELS.items():
        joints = _JOINTS.get(landmark, []) if skeleton else []
        for side, word in (("L", "LEFT"), ("R", "RIGHT")):
            candidates = [word + name for name in (*joints, *names)]
            candidates += [label for name in names for label in (side + name, name + side)]
            _take(found, f"{side}_{landmark}", candidates, bare)
    if skeleton:
        for landmark, names in _JOINTS_OF_THE_MIDLINE.items():
            _take(found, landmark, names, bare)
    for name, label in bare.items():
        match = _VERTEBRA.match(name)
        if match and 1 <= int(match[2]) <= {"T": 12, "L": 5}[match[1]]:
            found.setdefault(f"{match[1]}{int(match[2])}", label)
    meant = meant or {}
    own = set(meant.values())
    return {**{name: label for name, label in found.items() if label not in own}, **meant}


def is_skeleton(labels: Iterable[str]) -> bool:
    """Whether labels are those of a skeleton's joints, each named after the segment that begins there.

    Examples
    --------
    >>> is_skeleton(["Hips", "LeftUpLeg", "LeftLeg", "LeftFoot"]), is_skeleton(["LASI", "LKNE", "LeftFoot"])
    (True, False)
    """
    bare = {_bare(label) for label in labels}
    return all(any(f"LEFT{name}" in bare for name in _JOINTS[joint]) for joint in ("HIP", "KNEE"))


def _take(found: dict[str, str], landmark: str, names: Iterable[str], bare: dict[str, str]) -> None:
    """Note the first of these names that a file holds."""
    label = next((bare[name] for name in names if name in bare), None)
    if label is not None:
        found[landmark] = label


def _bare(label: str) -> str:
    return re.sub(r"_STUDY$|[^A-Z0-9]", "", label.rpartition(":")[2].upper())


def side_pairs(labels: Iterable[str], named: dict[str, str] | None = None) -> list[tuple[str, str]]:
    """Return the labels that differ in their side alone, left one first; `named` says where a label means the other side.

    Examples
    --------
    >>> side_pairs(["LASI", "RASI", "PSISl", "PSISr", "L_FTC", "RTOE"])
    [('LASI', 'RASI'), ('PSISl', 'PSISr')]
    """
    labels = list(labels)
    present = set(labels)
    pairs = []
    for label in labels:
        others = []
        if label[:1] in "Ll":
            others.append({"L": "R", "l": "r"}[label[0]] + label[1:])
        if label[:4].upper() == "LEFT":
            others += [word + label[4:] for word in ("Right", "RIGHT", "right")]
        if label[-1:] == "l" or label[-2:] == "_L":
            others.append(label[:-1] + {"l": "r", "L": "R"}[label[-1]])
        pairs += [(label, other) for other in others if other in present]
    meant_right = {label for label, landmark in (named or {}).items() if landmark.startswith("R_")}
    return [(right, left) if left in meant_right else (left, right) for left, right in pairs]


def level(landmark: str) -> float | None:
    """Nominal height of a landmark along the trunk; None off the trunk.

    Examples
    --------
    >>> level("L_SHOULDER"), level("T12"), level("L_KNEE")
    (1.0, 0.37, None)
    """
    name = landmark[2:] if landmark[:2] in ("L_", "R_") else landmark
    if name in LEVELS:
        return LEVELS[name]
    match = _VERTEBRA.match(landmark)
    return vertebra_level(match[1], int(match[2])) if match else None


def vertebra_level(region: str, number: int) -> float:
    """Height of a thoracic (T) or lumbar (L) vertebra along the trunk; lumbar ones are taller."""
    heights = (
        np.interp(number, (1, 12), (0.98, 0.37)) if region == "T" else np.interp(number, (1, 5), (0.31, 0.07))
    )
    return round(float(heights), 3)
