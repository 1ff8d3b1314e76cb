"""From the markers of a trial to the model's structure, its measurements and a first guess of all unknowns.

Markers are landmarks, points of a limb, or corners of the box by their names; the others ride on what they fit.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.body_model import anatomy
from lumbar.lifting.body_model.structure import (
    Measurement,
    Structure,
    Unknowns,
    interpolate_poses,
    weighted_poses,
)
from lumbar.lifting.quality.landmarks import landmarks
from lumbar.records.markers import MarkerRecording
from lumbar.settings.layout import Alias

BOX = "box"
LEVEL = ("pelvis", "L4L5_SHIFT")
"""The shift of L4/L5 off the line from L5/S1 to T12/L1: a vector in the pelvis's axes and no place."""
OFF_M, ELSEWHERE_M = 0.015, 0.035
"""A marker without a name rides on the nearest part to which it keeps its place within the first (median); a landmark that
strays further than the second is none of its part."""
SEEN_SHARE = 0.1
"""Share of the trial that a marker is seen at least."""
REACH_M, LOOSE_SD_M = 0.5, 0.1
"""A marker without a name lies no further than the first from its part's middle; and how far it may be from its first guess."""


@dataclass(frozen=True)
class Prior:
    """What is known of some constants before the trial: `root` @ (value - `mean`) has unit variance."""

    columns: np.ndarray
    mean: np.ndarray
    root: np.ndarray


@dataclass(frozen=True)
class TrialModel:
    """A model before it is fitted."""

    time: np.ndarray
    """Shape (n,)."""
    structure: Structure
    measurements: list[Measurement]
    priors: list[Prior]
    guess: Unknowns
    sex: str
    unused: dict[str, str]
    """Markers that no part takes, with the reason."""

    @property
    def step(self) -> float:
        """Seconds from one instant to the next."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))


@dataclass
class _Part:
    """A rigid part on its first guess: `shape` are the places of its own markers."""

    shape: dict[str, np.ndarray]
    rotations: np.ndarray
    shifts: np.ndarray

    def local(self, points: np.ndarray) -> np.ndarray:
        """Trajectory in the part's axes, shape (n, 3)."""
        return np.einsum("nji,nj->ni", self.rotations, points - self.shifts)


def build(
    time: np.ndarray,
    markers: Mapping[str, np.ndarray],
    height: float,
    sex: str = "unknown",
    held: np.ndarray | None = None,
) -> TrialModel:
    """Set up the model of a trial.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Seconds, evenly spaced; n is even.
    markers : mapping of str to ndarray, shape (n, 3)
        Measured ones, metres; NaN where not seen. Landmarks by their standard names, the box's ``BOX_1`` and so on.
    height : float
        Stature in metres.
    sex : {"male", "female", "unknown"}
    held : ndarray of bool, shape (n,), optional
        When both hands hold the box.

    Raises
    ------
    InputError
        Pelvis or thorax shows fewer than three markers that do not lie on a line.
    """
    enough = {
        name: points
        for name, points in markers.items()
        if np.isfinite(points).all(axis=1).mean() > SEEN_SHARE
    }
    unused = {name: "hardly ever seen" for name in markers if name not in enough}
    parts: dict[str, _Part] = {}
    for part, template in anatomy.TEMPLATES.items():
        own = {name: enough[name] for name in template if name in enough}
        parts[part] = _first_poses(time, own, {name: height * np.array(template[name]) for name in own}, part)
    box = {name: points for name, points in enough.items() if name.startswith("BOX_")}
    if len(box) >= 3:
        parts[BOX] = _first_poses(time, box, _seen_shape(box), BOX)
    _drop_strays(parts, enough, unused)
    points = [f"{side}_{name}" for name in anatomy.POINTS for side in "LR" if f"{side}_{name}" in enough]
    taken = {name for part in parts.values() for name in part.shape} | set(points) | set(unused)
    extras = _riders(parts, {name: values for name, values in enough.items() if name not in taken}, unused)
    return _assemble(time, enough, height, sex, held, parts, points, extras, unused)


def _seen_shape(markers: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Places of markers in the frame that shows most of them; the others at their middle."""
    stacked = np.stack(list(markers.values()), axis=1)
    frame = stacked[np.isfinite(stacked).all(axis=2).sum(axis=1).argmax()]
    frame = frame - np.nanmean(frame, axis=0)
    return dict(zip(markers, np.nan_to_num(frame), strict=True))


def _first_poses(time, markers: Mapping[str, np.ndarray], shape: dict[str, np.ndarray], part: str) -> _Part:
    """Lay a shape on the markers, mend the shape by what is seen, and again, far markers counting less."""
    frames = np.stack(list(markers.values()), axis=1) if markers else np.zeros((len(time), 0, 3))
    seen = np.isfinite(frames).all(axis=2).astype(float)
    places, weights, poses = np.array(list(shape.values())).reshape(-1, 3), seen, None
    for mending in (False, False, True, True, True):
        found = interpolate_poses(time, *weighted_poses(places, frames, weights))
        if found is None:
            raise InputError(
                f"the body model needs three markers of the {part} that do not lie on a line, seen together; "
                f"there are {', '.join(markers) or 'none'}"
            )
        poses = found
        local = np.einsum("nji,nmj->nmi", poses[0], frames - poses[1][:, None])
        if mending:
            places = np.nanmedian(local, axis=0)
        off = np.linalg.norm(np.where(seen[..., None] > 0, local - places, 0.0), axis=2)
        weights = seen / (1 + (off / 0.03) ** 2)
    return _Part(dict(zip(markers, places, strict=True)), *poses)


def _drop_strays(parts: dict[str, _Part], markers: Mapping[str, np.ndarray], unused: dict[str, str]) -> None:
    for name, part in parts.items():
        for marker, place in list(part.shape.items()):
            stray = np.nanmedian(np.linalg.norm(part.local(markers[marker]) - place, axis=1))
            if stray > ELSEWHERE_M and len(part.shape) > 3:
                del part.shape[marker]
                unused[marker] = f"strays {1e3 * stray:.0f} mm from its place on the {name}"


def _riders(
    parts: dict[str, _Part], markers: Mapping[str, np.ndarray], unused: dict[str, str]
) -> dict[tuple[str, str], np.ndarray]:
    """Places of markers without a name on the nearest part to which they keep it."""
    found = {}
    for marker, points in markers.items():
        near = []
        for name, part in parts.items():
            local = part.local(points)
            place = np.nanmedian(local, axis=0)
            reach = np.linalg.norm(place - np.mean(list(part.shape.values()), axis=0))
            if reach < REACH_M and np.nanmedian(np.linalg.norm(local - place, axis=1)) < OFF_M:
                near.append((reach, name, place))
        if near:
            _, name, place = min(near, key=lambda found: found[0])
            found[name, marker] = place
        else:
            unused[marker] = "rides on no part"
    return found


def _assemble(time, markers, height, sex, held, parts, points, extras, unused) -> TrialModel:
    places = _places(parts, height, sex) | extras
    hands = _hands(parts, markers, points, held)
    places |= {(BOX, hand): place for hand, (place, _) in hands.items()}
    rods = _rods(places, points)
    structure = Structure(tuple(parts), tuple(points), tuple(places), tuple(pair for _, _, pair, _ in rods))
    guess = Unknowns(
        {name: part.rotations for name, part in parts.items()},
        {name: part.shifts for name, part in parts.items()},
        {name: _interpolate(time, markers[name]) for name in points},
        np.concatenate([*places.values(), np.zeros(len(rods))]),
    )
    measurements = _markers(structure, markers, extras, points, parts)
    always = np.ones(len(time), dtype=bool)
    for first, second, pair, sd in rods:
        measurements.append(_soft("-".join(pair), first, second, sd, always, pair))
    for name in points:
        if ("thorax", name) in places:
            tied = f"{name} on the thorax", (None, name), ("thorax", name)
            measurements.append(_soft(*tied, anatomy.GIRDLE_SD_M, always))
    for hand, (_, when) in hands.items():
        tied = f"{hand} at the box", (None, hand.removeprefix("HAND_")), (BOX, hand)
        measurements.append(_soft(*tied, anatomy.GRIP_SD_M, when))
    priors = [_landmark_prior(structure, part, height) for part in anatomy.TEMPLATES]
    priors += _loose_priors(structure, guess, extras)
    guess, length_priors = _with_lengths(structure, guess, measurements, height)
    return TrialModel(time, structure, measurements, priors + length_priors, guess, sex, unused)


def _places(parts: dict[str, _Part], height: float, sex: str) -> dict[tuple[str, str], np.ndarray]:
    """First guess of landmarks, joint centres and corners of the box, in the axes of their part."""
    places: dict[tuple[str, str], np.ndarray] = {}
    for part, template in anatomy.TEMPLATES.items():
        landmarks = dict(parts[part].shape)
        standing = height * np.array([template[name] for name in landmarks])
        seen = np.array(list(landmarks.values()))[None]
        (turned,), (shifted,) = weighted_poses(standing, seen, np.ones((1, len(landmarks))))
        for name in anatomy.NEEDED[part]:
            landmarks.setdefault(name, turned @ (height * np.array(template[name])) + shifted)
        joints = anatomy.joints_of(part, landmarks, sex)
        places |= {(part, name): value for name, value in (landmarks | joints).items()}
    places[LEVEL] = np.zeros(3)
    if BOX in parts:
        places |= {(BOX, name): value for name, value in parts[BOX].shape.items()}
    return places


def _soft(
    name, first, second, sd: float, when: np.ndarray, length: tuple[str, str] | None = None
) -> Measurement:
    """A soft joint, or a distance that hardly changes."""
    return Measurement(name, first, second, None, length, when, sd, anatomy.JOINT_CORRELATION_S, False)


def _interpolate(time: np.ndarray, points: np.ndarray) -> np.ndarray:
    seen = np.isfinite(points).all(axis=1)
    return np.stack([np.interp(time, time[seen], axis[seen]) for axis in points.T], axis=1)


def _hands(parts, markers, points, held) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Places of the hands on the box and when they are there; none without box, wrists or a lift."""
    if BOX not in parts or held is None or not held.any():
        return {}
    hands = {}
    for name in ("L_WRIST", "R_WRIST"):
        if name in points:
            local = parts[BOX].local(markers[name])[held]
            if np.isfinite(local).all(axis=1).any():
                hands[f"HAND_{name}"] = (np.nanmedian(local, axis=0), held)
    return hands


def _rods(places, points):
    """Pairs that keep their distance: ends, name and standard deviation."""

    def end(name: str):
        return (None, name) if name in points else ("pelvis", name) if ("pelvis", name) in places else None

    rods = [(("pelvis", "L5S1"), ("thorax", "T12L1"), ("L5S1", "T12L1"), anatomy.LUMBAR_STRETCH_SD_M)]
    for first, second, sd in anatomy.LIMBS:
        for side in "LR":
            pair = f"{side}_{first}", f"{side}_{second}"
            ends = [end(name) for name in pair]
            if all(ends):
                rods.append((*ends, pair, sd))
    return rods


def _markers(structure: Structure, markers, extras, points, parts) -> list[Measurement]:
    """Every marker's measurement: on a part it tells its own noise, on a limb it is the point itself."""
    measurements = []
    for part, name in structure.places:
        if name in points or not (name in parts[part].shape or (part, name) in extras):
            continue
        sd, correlation = anatomy.SOFT_TISSUE_SD_M.get(name, anatomy.SKIN_SD_M), anatomy.SKIN_CORRELATION_S
        if (part, name) in extras:
            sd = anatomy.RIDER_SD_M
        elif part == BOX:
            sd, correlation = anatomy.BOX_SD_M, 0.0
        measurements.append(_marker(name, (part, name), markers[name], sd, correlation, True))
    return measurements + [
        _marker(name, (None, name), markers[name], anatomy.POINT_NOISE_SD_M, 0.0, False) for name in points
    ]


def _marker(name, where, observed: np.ndarray, sd: float, correlation: float, estimated: bool) -> Measurement:
    seen = np.isfinite(observed).all(axis=1)
    return Measurement(name, where, None, observed, None, seen, sd, correlation, estimated)


def _landmark_prior(structure: Structure, part: str, height: float) -> Prior:
    """Landmarks scatter about the template, neighbours together, hardly off the midline."""
    template = anatomy.TEMPLATES[part]
    names = [name for name in structure.names_of(part) if name in template]
    mean = height * np.array([template[name] for name in names])
    covariance = anatomy.landmark_covariance(mean)
    middle = np.array([name[:2] not in ("L_", "R_") for name in names])
    narrow = np.where(middle, anatomy.MIDLINE_SD_M / np.sqrt(np.diag(covariance)), 1.0)
    rows = [
        np.linalg.inv(np.linalg.cholesky(covariance * scale)) for scale in (np.outer(narrow, narrow), 1, 1)
    ]
    starts = np.array([structure.of_place(part, name).start for name in names])
    columns = np.concatenate([starts + axis for axis in range(3)])
    root = np.zeros((len(columns), len(columns)))
    for axis, block in enumerate(rows):
        where = slice(axis * len(names), (axis + 1) * len(names))
        root[where, where] = block
    return Prior(columns, np.concatenate(list(mean.T)), root)


def _loose_priors(structure: Structure, guess: Unknowns, extras) -> list[Prior]:
    """Markers without a name, corners of the box and hands may be anywhere near; L4/L5 near its line."""
    loose = dict.fromkeys([*extras, *((BOX, name) for name in structure.names_of(BOX))], LOOSE_SD_M)
    priors = []
    for place, sd in (loose | {LEVEL: anatomy.LEVEL_SD_M}).items():
        where = structure.of_place(*place)
        columns = np.arange(where.start, where.stop)
        priors.append(Prior(columns, guess.constants[where].copy(), np.eye(3) / sd))
    return priors


def _with_lengths(
    structure: Structure, guess: Unknowns, measurements, height
) -> tuple[Unknowns, list[Prior]]:
    """Start every length at its median; the lumbar spine's is known from the stature, others hardly."""
    constants, priors = guess.constants.copy(), []
    for measurement in measurements:
        if measurement.length is None:
            continue
        where = structure.of_length(measurement.length)
        _, prediction = measurement.residual(structure, guess)
        constants[where] = np.median(prediction.value)
        mean, sd = constants[where].copy(), 0.05
        if measurement.length == ("L5S1", "T12L1"):
            mean, sd = np.array([anatomy.LUMBAR_LENGTH * height]), anatomy.LUMBAR_LENGTH_SD * height
        priors.append(Prior(np.array([where.start]), mean, np.array([[1 / sd]])))
    return Unknowns(guess.rotations, guess.shifts, guess.points, constants), priors


def measured_markers(raw: MarkerRecording, aliases: Mapping[str, Alias | None]) -> MarkerRecording:
    """Measured markers under standard names; nothing is derived, and labels without a standard name keep theirs.

    Parameters
    ----------
    raw : MarkerRecording
        Read without aliases, so that every marker has its label in the file.
    aliases : mapping of str to Alias
        Of the laboratory: labels go before the usual meaning, rules (means, points between) are left out.
    """
    if raw.joints:
        raise InputError(
            f"{raw.source}: a body model is fitted to markers on the skin; the file holds joint centres"
        )
    meant = {}
    for name, alias in aliases.items():
        choices = alias if isinstance(alias, tuple) else (alias,)
        label = next((choice for choice in choices if isinstance(choice, str) and choice in raw), None)
        if label is not None:
            meant[name] = label
    named = landmarks(raw.positions, meant)
    standard = {label: name for name, label in named.items()}
    positions = {standard.get(label, label): points for label, points in raw.positions.items()}
    return MarkerRecording(raw.name, raw.time, raw.rate, positions, raw.source)


def at_nodes(recording: MarkerRecording, rate: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times and markers at no more than `rate` instants per second: means of the frames about each.

    The number of instants is even; a marker, shape (n, 3), is NaN where fewer than half of the frames show it.
    """
    frames = max(1, int(np.floor(recording.rate / rate + 0.01)))
    nodes = len(recording) // (2 * frames) * 2
    time = recording.time[: nodes * frames].reshape(nodes, frames).mean(axis=1)
    markers = {}
    for name, points in recording.positions.items():
        blocks = points[: nodes * frames].reshape(nodes, frames, 3)
        seen = np.isfinite(blocks).all(axis=2)
        count = seen.sum(axis=1)
        total = np.where(seen[..., None], blocks, 0.0).sum(axis=1)
        enough = 2 * count >= frames
        markers[name] = np.where(enough[:, None], total / np.maximum(count, 1)[:, None], np.nan)
    return time, markers
