"""Checks of the body that the labels show: axes, left and right, front and back, size and stature.

`points` are positions in metres by label, shape (n_frames, 3), NaN if not seen; `named` is landmark by label.
"""

import os
import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_names, shipped_yaml
from lumbar.lifting.quality.marker_sets import landmarks
from lumbar.records.marker_axes import axis_vector, check_axes, find_up
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.settings.layout import MarkerLayout

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "body")

TRUNK_SHARE = 0.265
"""Length of the trunk from the mean of the pelvis's markers to the mean of the shoulders' markers, as a share of stature."""
_SHOULDER_LEVEL = ("SHOULDER", "MANUBRIUM", "C7", "T1")
_PELVIS = ("ASIS", "PSIS", "SACRUM")
_FRONT = ("MANUBRIUM", "XIPHOID", "ASIS")
_BODY = shipped_yaml(Path(__file__).with_name("body.yaml"))
_VERTEBRA = re.compile(r"^([TL])(\d{1,2})$")


def side_pairs(labels: Iterable[str], named: dict[str, str] | None = None) -> list[tuple[str, str]]:
    """Return the pairs of labels that differ only in their side, the left label first.

    Parameters
    ----------
    labels : iterable of str
        Labels of the file.
    named : dict of str to str, optional
        Landmark by label, for labels with the meaning of the other side.

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
    labels_by_name = {landmark: label for label, landmark in (named or {}).items()}
    meant_right = {label for name, label in labels_by_name.items() if name.startswith("R_")}
    pairs = [pair[::-1] if pair[0] in meant_right else pair for pair in pairs]
    known = {
        (label, labels_by_name.get(f"R_{_part(name)}"))
        for name, label in labels_by_name.items()
        if name[:2] == "L_"
    }
    return list(dict.fromkeys([*pairs, *(pair for pair in sorted(known) if pair[1] in present)]))


def level(landmark: str) -> float | None:
    """Return the nominal height of a landmark along the trunk, 0 at the pelvis, 1 at the shoulders; None off the trunk.

    Parameters
    ----------
    landmark : str
        Standard name, with its side if it has one.

    Examples
    --------
    >>> level("L_SHOULDER"), level("T12"), level("L_KNEE")
    (1.0, 0.37, None)
    """
    if _part(landmark) in _BODY["levels"]:
        return _BODY["levels"][_part(landmark)]
    match = _VERTEBRA.match(landmark)
    if not match:
        return None
    # Lumbar vertebrae are taller than thoracic ones.
    numbers, heights = ((1, 12), (0.98, 0.37)) if match[1] == "T" else ((1, 5), (0.31, 0.07))
    return round(float(np.interp(int(match[2]), numbers, heights)), 3)


def _part(landmark: str) -> str:
    return landmark[2:] if landmark[:2] in ("L_", "R_") else landmark


def _centre(points, named, parts: Collection[str]) -> np.ndarray | None:
    """Return the mean of the visible markers of some landmarks, shape (n_frames, 3); NaN if no marker is visible."""
    chosen = [points[label] for label, landmark in named.items() if _part(landmark) in parts]
    if not chosen:
        return None
    stacked = np.stack(chosen)
    known = np.isfinite(stacked)
    with np.errstate(invalid="ignore"):
        return np.where(known, stacked, 0).sum(axis=0) / np.where(
            known.any(axis=0), known.sum(axis=0), np.nan
        )


def _trunk(points: dict[str, np.ndarray], named: dict[str, str]) -> tuple[np.ndarray, float] | None:
    """Return unit vectors, shape (n_frames, 3), from the pelvis up to the shoulders, and their median distance in metres.

    The hips replace a pelvis without markers. None if the labels have no marker of one end.
    """
    pelvis, top = _centre(points, named, _PELVIS), _centre(points, named, _SHOULDER_LEVEL)
    if pelvis is None:
        pelvis = _centre(points, named, ("HIP",))
    if pelvis is None or top is None:
        return None
    axis = top - pelvis
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return axis / length, float(np.nanmedian(length)) if np.isfinite(length).any() else np.nan


def asymmetry(points: dict[str, np.ndarray], named: dict[str, str], label: str) -> float:
    """Return the asymmetry of a trunk marker in metres: differences of its distances to near markers from their mirror images.

    The value is the root mean square of the medians; NaN off the trunk, or if no other pair of markers is comparable.

    Parameters
    ----------
    points : dict of str to numpy.ndarray, shape (n_frames, 3)
        Markers by label in m.
    named : dict of str to str
        Landmark by label.
    label : str
        Label of the marker.
    """
    at = {landmark: points[other] for other, landmark in named.items() if level(landmark) is not None}
    image = {name: {"L_": "R_", "R_": "L_"}.get(name[:2], name[:2]) + name[2:] for name in at}
    this = named.get(label, "")
    that = image.get(this)
    differences = []
    for name, mirrored in image.items() if that in at else ():
        is_near = abs(level(name) - level(this)) < _AT.near_levels
        if is_near and mirrored in at and name not in (this, that) and (name, this) != (mirrored, that):
            distances = [
                np.linalg.norm(at[one] - at[other], axis=1) for one, other in ((this, name), (that, mirrored))
            ]
            difference = distances[0] - distances[1]
            if np.isfinite(difference).any():
                differences.append(float(np.nanmedian(difference)))
    return float(np.sqrt(np.mean(np.square(differences)))) if differences else np.nan


@dataclass(frozen=True)
class SideExchange:
    """Two labels, left and right or front and back, that are exchanged with respect to the rest of the body."""

    labels: tuple[str, str]
    evidence: str
    """Share of frames that contradict the labels, as text."""


def side_exchanges(points: dict[str, np.ndarray], named: dict[str, str]) -> tuple[list[SideExchange], str]:
    """Return the exchanged pairs left/right and front/back, and the evidence if the whole body is mirrored, else empty.

    Every pair of markers (left and right, front and back, toe and heel) indicates the right side. A pair is exchanged if the
    others contradict it in most frames; the first exchange is the one that leaves the fewest contradicted pairs.

    Parameters
    ----------
    points : dict of str to numpy.ndarray, shape (n_frames, 3)
        Markers by label in m.
    named : dict of str to str
        Landmark by label.
    """
    points = dict(points)
    pairs: list[SideExchange] = []
    for _ in range(_AT.most_exchanges):
        sides, depths = rightward(points, named)
        if len(sides) > 1 and len(depths) > 1:
            # Left and right contradict front and back, which agree with each other.
            given = np.nansum(list(depths.values()), axis=0) / len(depths)
            # Frames without front and back, or in which they do not agree, show nothing.
            agreeing = np.linalg.norm(given, axis=1) > _AT.agreeing
            backwards = [(across * given).sum(axis=1)[agreeing] for across in sides.values()]
            known = [each for each in backwards if np.isfinite(each).any()]
            if known and np.mean([np.nanmedian(each) < 0 for each in known]) > 0.7:
                return [], (
                    f"{len(sides)} pairs of left and right markers are inverted for a body that faces as "
                    f"{len(depths)} pairs of front and back markers show"
                )
        reversed_pairs = _find_contradicted(sides, depths)
        if not reversed_pairs:
            break
        # Exchanged first is the pair after whose exchange fewest pairs are contradicted.
        remaining = {
            pair: len(_find_contradicted(*rightward(exchange_labels(points, pair), named)))
            for pair in reversed_pairs
        }
        pair = min(remaining, key=lambda one: (remaining[one], -reversed_pairs[one]))
        kind = "left and right" if pair in sides else "front and back"
        evidence = f"{kind} are inverted for the rest of the body in {reversed_pairs[pair]:.0%} of the frames"
        pairs.append(SideExchange(pair, evidence))
        points = exchange_labels(points, pair)
    return pairs, ""


def exchange_labels(
    points: dict[str, np.ndarray], pair: tuple[str, str], frames: Iterable[slice] = (slice(None),)
) -> dict[str, np.ndarray]:
    """Return the points with two labels exchanged in some frames.

    Parameters
    ----------
    points : dict of str to numpy.ndarray, shape (n_frames, 3)
        Markers by label in m.
    pair : tuple of str
        The two labels.
    frames : iterable of slice, optional
        Intervals of frames; default: all.
    """
    one, other = points[pair[0]].copy(), points[pair[1]].copy()
    for part in frames:
        one[part], other[part] = points[pair[1]][part], points[pair[0]][part]
    return {**points, pair[0]: one, pair[1]: other}


def _find_contradicted(sides: dict, depths: dict) -> dict[tuple[str, str], float]:
    """Return the pairs that most other pairs contradict, with the share of frames; empty for fewer than three pairs."""
    directions = {**sides, **depths}
    if len(directions) < 3:
        return {}
    total = np.nansum(list(directions.values()), axis=0)
    shares = {}
    for pair, direction in directions.items():
        others = total - np.nan_to_num(direction)
        backwards = (direction * others).sum(axis=1)
        agreeing = np.linalg.norm(others, axis=1) > _AT.agreeing * (len(directions) - 1)
        known = np.isfinite(backwards) & agreeing
        if known.any() and (backwards[known] < 0).mean() > _AT.reversed_share:
            shares[pair] = float((backwards[known] < 0).mean())
    return shares


def rightward(points: dict[str, np.ndarray], named: dict[str, str]) -> tuple[dict, dict]:
    """Return unit vectors to the right by every pair left/right and by every pair front/back, each of shape (n_frames, 3).

    Pairs off the trunk need the vertical axis; they are left out if no known label shows it.

    Parameters
    ----------
    points : dict of str to numpy.ndarray, shape (n_frames, 3)
        Markers by label in m.
    named : dict of str to str
        Landmark by label.
    """
    trunk = _trunk(points, named)
    # The declared axes may only be assumed, so the body itself shows which axis is vertical.
    vertical = find_up({landmark: points[label] for label, landmark in named.items()})

    def up(*labels: str) -> np.ndarray | None:
        on_trunk = all(label in named and level(named[label]) is not None for label in labels)
        if trunk is not None and on_trunk:
            return trunk[0]
        return None if vertical is None else axis_vector(vertical)[None]

    def keep_clear(vectors: dict) -> dict:
        """Return unit vectors of the vectors that are long enough to show a direction."""
        lengths = {pair: np.linalg.norm(vector, axis=1, keepdims=True) for pair, vector in vectors.items()}
        with np.errstate(invalid="ignore", divide="ignore"):
            return {
                pair: vectors[pair] / length
                for pair, length in lengths.items()
                if np.isfinite(length).any() and np.nanmedian(length) > _AT.clear_depth_m
            }

    sides, depths = {}, {}
    for pair in side_pairs(points, named):
        along = up(*pair)
        if along is None:
            continue
        across = points[pair[1]] - points[pair[0]]
        sides[pair] = across - (across * along).sum(axis=1, keepdims=True) * along
    # Front and back at the same level of the trunk, toe and heel.
    labels = {landmark: label for label, landmark in named.items()}
    fronts = [landmark for landmark in labels if _part(landmark) in _FRONT]
    backs = [
        back for back in labels if _part(back) in ("PSIS", "SACRUM") or back == "C7" or back[1:].isdigit()
    ]
    pairs = [
        (front, back)
        for front in fronts
        for back in backs
        if abs(level(front) - level(back)) < 0.2 and {front[:2], back[:2]} != {"L_", "R_"}
    ]
    pairs += [
        (f"{side}_TOE", f"{side}_HEEL") for side in "LR" if {f"{side}_TOE", f"{side}_HEEL"} <= labels.keys()
    ]
    for pair in ((labels[front], labels[back]) for front, back in pairs):
        along = up(*pair)
        if along is not None:
            depths[pair] = np.cross(points[pair[0]] - points[pair[1]], along)
    return keep_clear(sides), keep_clear(depths)


def estimate_stature(points: dict[str, np.ndarray], named: dict[str, str]) -> tuple[float, int]:
    """Return the stature in metres, the median of estimates from known lengths of the body (NaN without any), and their number.

    Parameters
    ----------
    points : dict of str to numpy.ndarray, shape (n_frames, 3)
        Markers by label in m.
    named : dict of str to str
        Landmark by label.
    """
    labels = {landmark: label for label, landmark in named.items()}
    statures = []
    for ends, share in _BODY["lengths"].items():
        for side in ("L_", "R_"):
            names = [end if end in labels else side + end for end in ends.split()]
            if all(name in labels for name in names):
                with np.errstate(over="ignore", invalid="ignore"):
                    length = np.linalg.norm(points[labels[names[0]]] - points[labels[names[1]]], axis=1)
                length = length[np.isfinite(length)]
                statures += [float(np.median(length)) / share] if length.size else []
    trunk = _trunk(points, named)
    statures += [] if trunk is None else [trunk[1] / TRUNK_SHARE]
    statures = [value for value in statures if np.isfinite(value)]
    return (float(np.median(statures)), len(statures)) if statures else (np.nan, 0)


def read_upright(path: str | os.PathLike, layout: MarkerLayout) -> MarkerRecording:
    """Read a marker file with `lumbar.records.markers.read_markers`, and check its axes by the body, with all usual labels.

    The notes of the recording list axes that no marker shows.

    Parameters
    ----------
    path : str or os.PathLike
        The marker file.
    layout : MarkerLayout
        Labels, unit and axes of the file.

    Raises
    ------
    InputError
        As in `read_markers`; if `markers.up` or `markers.forward` contradicts the body; if left and right are exchanged.
    """
    # The screen keeps the markers by the file's labels, and omits none.
    measured: dict[str, dict[str, np.ndarray]] = {}
    recording = read_markers(
        path, layout, screen=lambda points, *_: (measured.setdefault("points", points), {})
    )
    unknown = check_unaliased_axes(measured["points"], recording, layout)
    if not unknown:
        return recording
    note = f"not checked: {' and '.join(unknown)} of the axes, because no known label of the body shows them, or it turns"
    return replace(recording, notes=(*recording.notes, note))


def check_unaliased_axes(
    points: dict[str, np.ndarray], recording: MarkerRecording, layout: MarkerLayout
) -> list[str]:
    """Return the declared axes, up and forward, that no marker with a usual label shows, if aliases are ignored.

    Parameters
    ----------
    points : dict of str to numpy.ndarray, shape (n_frames, 3)
        Markers by the file's labels in m, rotated by the declared axes.
    recording : MarkerRecording
        Recording with the same markers under standard names.
    layout : MarkerLayout
        Declared axes.

    Raises
    ------
    InputError
        If the body contradicts the declared axes.
    """
    if not layout.check_axes or not check_axes(recording.positions, layout, recording.source):
        return []
    body = {name: points[label] for name, label in landmarks(points).items()}
    remark = " by its usual labels, which no alias names"
    return check_axes({**body, **recording.positions}, layout, recording.source, remark)
