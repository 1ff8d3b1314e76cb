"""Labels against the body: its axes, left and right, front and back, size against stature.

`points` are positions in metres by label, shape (n_frames, 3), NaN where not seen; `named` says which landmarks labels mean.
"""

import os
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality.landmarks import LENGTHS, landmarks, level, side_pairs
from lumbar.records.marker_axes import check_axes, tells_axes
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.settings.layout import Axis, MarkerLayout

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "body")

TRUNK_SHARE = 0.265
"""Length of the trunk, from the middle of the pelvis's markers to that of the shoulders', as a share of stature."""
_TOP = ("SHOULDER", "MANUBRIUM", "C7", "T1")
_PELVIS = ("ASIS", "PSIS", "SACRUM")
_FRONT = ("MANUBRIUM", "XIPHOID", "ASIS")
_BY_LABELS = " by its usual labels, which no alias names"
AXES: tuple[tuple[Axis, Axis], ...] = (("-x", "+x"), ("-y", "+y"), ("-z", "+z"))


def _part(landmark: str) -> str:
    return landmark[2:] if landmark[:2] in ("L_", "R_") else landmark


def _centre(points, named, parts: Collection[str]) -> np.ndarray | None:
    """Mean over those markers of some landmarks that are seen, NaN where none is, shape (n_frames, 3)."""
    chosen = [points[label] for label, landmark in named.items() if _part(landmark) in parts]
    if not chosen:
        return None
    stacked = np.stack(chosen)
    seen = np.isfinite(stacked)
    with np.errstate(invalid="ignore"):
        return np.where(seen, stacked, 0).sum(axis=0) / np.where(seen.any(axis=0), seen.sum(axis=0), np.nan)


def trunk_axis(
    points: dict[str, np.ndarray], named: dict[str, str]
) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Middle of the pelvis, unit vector from it to the shoulders, both shape (n_frames, 3), and their median distance.

    The hips stand for a pelvis without markers. None where the labels name no marker of one of them.
    """
    pelvis = _centre(points, named, _PELVIS)
    if pelvis is None:
        pelvis = _centre(points, named, ("HIP",))
    top = _centre(points, named, _TOP)
    if pelvis is None or top is None:
        return None
    axis = top - pelvis
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return pelvis, axis / length, float(np.nanmedian(length)) if np.isfinite(length).any() else np.nan


def _distance(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.linalg.norm(one - other, axis=1)


def asymmetry(points: dict[str, np.ndarray], named: dict[str, str], label: str) -> float:
    """How far the distances of a marker on the trunk from those near it differ from their mirror images, metres.

    Root mean square of the medians; NaN off the trunk, or where no other pair of markers tells.
    """
    at = {landmark: points[other] for other, landmark in named.items() if level(landmark) is not None}
    own = named.get(label, "")
    image = {name: {"L_": "R_", "R_": "L_"}.get(name[:2], name[:2]) + name[2:] for name in at}
    differences = [
        float(np.nanmedian(difference))
        for name, mirrored in image.items()
        if own in at and image[own] in at and mirrored in at and name not in (own, image[own])
        if abs(level(name) - level(own)) < _AT.near_levels
        and (name, own) != (mirrored, image[own])
        and np.isfinite(
            difference := _distance(at[own], at[name]) - _distance(at[image[own]], at[mirrored])
        ).any()
    ]
    return float(np.sqrt(np.mean(np.square(differences)))) if differences else np.nan


def side_exchanges(
    points: dict[str, np.ndarray], named: dict[str, str]
) -> tuple[list[tuple[str, str, str]], str]:
    """Pairs left/right and front/back that lie the wrong way round, and what shows that all of left and right do, if so.

    Every pair of a left and a right marker, of a front and a back one and of toe and heel says where the right side is. One
    that most frames of the others contradict is exchanged: the one after whose exchange fewest are contradicted goes first.
    Each pair comes with what was seen.
    """
    points = dict(points)
    pairs: list[tuple[str, str, str]] = []
    for _ in range(_AT.most_exchanges):
        sides, depths = rightward(points, named)
        if len(sides) > 1 and len(depths) > 1 and _mirrored(sides, depths):
            return [], (
                f"{len(sides)} pairs of left and right markers lie the wrong way round for a body that faces where "
                f"{len(depths)} pairs of front and back markers say"
            )
        reversed_pairs = _contradicted(sides, depths)
        if not reversed_pairs:
            break
        left = {
            pair: len(_contradicted(*rightward(_exchanged(points, pair), named))) for pair in reversed_pairs
        }
        pair = min(left, key=lambda one: (left[one], -reversed_pairs[one]))
        kind = "left and right" if pair in sides else "front and back"
        share = reversed_pairs[pair]
        pairs.append(
            (*pair, f"{kind} lie the wrong way round for the rest of the body in {share:.0%} of the frames")
        )
        points = _exchanged(points, pair)
    return pairs, ""


def _exchanged(points: dict[str, np.ndarray], pair: tuple[str, str]) -> dict[str, np.ndarray]:
    return {**points, pair[0]: points[pair[1]], pair[1]: points[pair[0]]}


def _contradicted(sides: dict, depths: dict) -> dict[tuple[str, str], float]:
    """Pairs whose direction most of the others contradict, with the share of frames; none of fewer than three."""
    rightward = {**sides, **depths}
    if len(rightward) < 3:
        return {}
    total = np.nansum(list(rightward.values()), axis=0)
    found = {}
    for pair, own in rightward.items():
        others = total - np.nan_to_num(own)
        backwards = (own * others).sum(axis=1)
        seen = np.isfinite(backwards) & (np.linalg.norm(others, axis=1) > _AT.agreeing * (len(rightward) - 1))
        if seen.any() and (backwards[seen] < 0).mean() > _AT.reversed_share:
            found[pair] = float((backwards[seen] < 0).mean())
    return found


def _mirrored(sides: dict, depths: dict) -> bool:
    """Whether left and right contradict front and back, which agree with each other."""
    given = np.nansum(list(depths.values()), axis=0) / len(depths)
    against = [np.nanmedian((own * given).sum(axis=1)) < 0 for own in sides.values()]
    return bool(np.mean(against) > 0.7 and np.nanmedian(np.linalg.norm(given, axis=1)) > _AT.agreeing)


def rightward(points: dict[str, np.ndarray], named: dict[str, str]) -> tuple[dict, dict]:
    """Unit vectors to the right by every pair left/right, and by every pair front/back, shape (n_frames, 3) each."""
    trunk = trunk_axis(points, named)
    shape = next(iter(points.values())).shape
    vertical = np.broadcast_to([0.0, 0.0, 1.0], shape)

    def up(*labels: str) -> np.ndarray:
        on_trunk = all(label in named and level(named[label]) is not None for label in labels)
        return trunk[1] if trunk is not None and on_trunk else vertical

    sides, depths = {}, {}
    for pair in side_pairs(points, named):
        across = points[pair[1]] - points[pair[0]]
        along = up(*pair)
        sides[pair] = across - (across * along).sum(axis=1, keepdims=True) * along
    for pair in _front_and_back(named):
        depths[pair] = np.cross(points[pair[0]] - points[pair[1]], up(*pair))
    return (
        {pair: _unit(vectors) for pair, vectors in sides.items() if _clear(vectors)},
        {pair: _unit(vectors) for pair, vectors in depths.items() if _clear(vectors)},
    )


def _clear(vectors: np.ndarray) -> bool:
    length = np.linalg.norm(vectors, axis=1)
    return bool(np.isfinite(length).any() and np.nanmedian(length) > _AT.clear_depth_m)


def _front_and_back(named: dict[str, str]) -> list[tuple[str, str]]:
    """Labels in front and behind at the same level of the trunk, and toe and heel."""
    found = {landmark: label for label, landmark in named.items()}
    fronts = [landmark for landmark in found if _part(landmark) in _FRONT]
    pairs = [(found[front], found[back]) for front in fronts for back in found if _behind(front, back)]
    feet = [(f"{side}_TOE", f"{side}_HEEL") for side in "LR"]
    return pairs + [(found[toe], found[heel]) for toe, heel in feet if toe in found and heel in found]


def _behind(front: str, back: str) -> bool:
    if _part(back) not in ("PSIS", "SACRUM") and not (back in ("C7", "SACRUM") or back[1:].isdigit()):
        return False
    sides = {front[:2], back[:2]}
    return abs(level(front) - level(back)) < 0.2 and sides != {"L_", "R_"}


def _unit(vectors: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore", divide="ignore"):
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def stature_found(points: dict[str, np.ndarray], named: dict[str, str]) -> tuple[float, int]:
    """Stature in metres by the median over the known lengths of the body, and how many there are; NaN without one."""
    found = {landmark: label for label, landmark in named.items()}
    statures = []
    for ends, share in LENGTHS.items():
        for side in ("L_", "R_"):
            names = [end if end in found else side + end for end in ends]
            if all(name in found for name in names):
                between = points[found[names[0]]] - points[found[names[1]]]
                with np.errstate(over="ignore", invalid="ignore"):
                    length = np.linalg.norm(between, axis=1)
                length = length[np.isfinite(length)]
                statures.append((float(np.median(length)) if length.size else np.nan) / share)
    trunk = trunk_axis(points, named)
    if trunk is not None:
        statures.append(trunk[2] / TRUNK_SHARE)
    statures = [value for value in statures if np.isfinite(value)]
    return (float(np.median(statures)), len(statures)) if statures else (np.nan, 0)


def axes_found(points: dict[str, np.ndarray], named: dict[str, str]) -> tuple[Axis, Axis] | None:
    """Return the signed axes up and forward, e.g. ``("+y", "+x")``, in the axes the points are given in.

    Up is where the shoulders are above the pelvis, forward where neither up nor to the right is. None where the labels name
    no trunk, no sides, or the person lies so that one axis is both.
    """
    trunk = trunk_axis(points, named)
    if trunk is None:
        return None
    up = np.nanmedian(trunk[1], axis=0)
    sides, depths = rightward(points, named)
    votes = [*sides.values(), *depths.values()]
    if not votes or not np.isfinite(up).all():
        return None
    right = np.nanmedian(np.nansum(votes, axis=0), axis=0)
    vertical = _signed(up)
    forward = _signed(np.cross(up, right))
    return None if vertical[1] == forward[1] else (vertical, forward)


def read_upright(path: str | os.PathLike, layout: MarkerLayout) -> MarkerRecording:
    """Read a marker file as `lumbar.records.markers.read_markers` does, and compare its axes with the body by all usual labels.

    What no marker tells is among the notes of the recording.

    Raises
    ------
    InputError
        As `read_markers`; and where the body stands or faces along another axis than `markers.up` or `markers.forward`, or left
        and right are exchanged.
    """
    measured: dict[str, np.ndarray] = {}

    def kept(points: dict[str, np.ndarray], *_):
        measured.update(points)
        return points, {}

    recording = read_markers(path, layout, screen=kept)
    unknown = check_unaliased_axes(measured, recording, layout)
    if not unknown:
        return recording
    note = f"not checked: {' and '.join(unknown)} of the axes, which no known label of the body tells"
    return replace(recording, notes=(*recording.notes, note))


def check_unaliased_axes(
    points: dict[str, np.ndarray], recording: MarkerRecording, layout: MarkerLayout
) -> list[str]:
    """Raise where usual labels show a body that stands or faces another way than declared, and no alias tells.

    The markers are given by the file's labels, turned by the declared axes, and as a recording under standard names. What is
    returned is which of up and forward no marker tells.
    """
    if not layout.check_axes or not tells_axes(recording.positions):
        return []
    body = {name: points[label] for name, label in landmarks(points).items()}
    check_axes({**body, **recording.positions}, layout, recording.source, _BY_LABELS)
    return tells_axes({**body, **recording.positions})


def _signed(vector: np.ndarray) -> Axis:
    largest = int(np.abs(vector).argmax())
    return AXES[largest][int(vector[largest] > 0)]
