"""Markers of the trunk that creep from their place: seen by their neighbours, less what the person's posture explains.

The places of a marker in the frame of its neighbours change with posture, since skin moves. What changes of the body's shape
explain of that, by a linear Gaussian process, is set aside; a drift is a ramp in what is left, larger than what skin does and
than what the frame itself wavers where the marker is: the farther the neighbours and the less rigid among themselves, the more.
Along with the only change of posture of a short trial a drift must be large to be told from it: `smallest_seen` says how large.
Other trials of the person tell what posture does, too, wherever their markers were put. A drift that they show must be seen
whichever of them is left out, since a marker may have drifted in one of them.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality.displacement import percentiles
from lumbar.lifting.quality.landmarks import level
from lumbar.lifting.quality.sheet import Finding, Legend

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "drift")
Points = dict[str, np.ndarray]


@dataclass(frozen=True)
class _Within:
    """A marker in the frame of its mates, in the samples in which all of them are seen."""

    labels: list[str]
    """The marker, and those whose places are the shape."""
    mates: list[str]
    weights: np.ndarray
    mean: np.ndarray
    """Of the mates, their places from their centre, shape (n_mates, 3)."""
    frames: np.ndarray
    place: np.ndarray
    """Shape (n_samples, 3), less its mean."""
    shape: np.ndarray
    """The same of all other markers, shape (n_samples, n), divided by the root of their number."""
    wavers: np.ndarray
    """Covariance of the place by the frame's own scatter, shape (3, 3)."""


@dataclass(frozen=True)
class _Ramps:
    """What ramps between all pairs of some instants explain of a marker's place, shape (n,) each."""

    within: _Within
    edges: np.ndarray
    """Shape (n, 2): where they begin and end, as shares of the recording."""
    sizes: np.ndarray
    """Metres."""
    clear: np.ndarray
    """Sizes after that which counts in their direction, less what posture leaves of the ramp."""
    share: np.ndarray
    """Of the movement that posture does not explain."""
    faintest: np.ndarray
    """Size that would count in the worst direction, metres."""


def drifts(points: Points, legend: Legend, others: Sequence[Points] = ()) -> list[Finding]:
    """Markers on the trunk that drift, the clearest first; each is looked at without those found before.

    `others` are points of other trials of the person, in some of their frames.
    """
    points, found = dict(points), []
    for trials in ((), others) if others else ((),):
        while len(found) < _AT.most:
            # A marker found is a neighbour less for the others.
            enough = _AT.known if trials and not found else 1.0
            told = {
                label: _told(_ramps(points, label, legend, trials), enough)
                for label in _on_trunk(points, legend)
            }
            label = max(told, key=told.__getitem__, default="")
            if not label or told[label] < enough:
                break
            found.append(_finding(label, next(_ramps(points, label, legend, trials)), legend))
            del points[label]
    return found


def smallest_seen(
    points: Points, legend: Legend, others: Sequence[Points] = ()
) -> dict[str, tuple[float, slice]]:
    """Size in metres from which a drift of a second or more is seen, in whatever direction, by marker of the trunk.

    With the frames in which it is looked for; infinite and none where too few neighbours tell.
    """
    found = {}
    for label in _on_trunk(points, legend):
        found[label] = (np.inf, slice(0))
        for trials in ((), others) if others else ((),):
            for ramps in (each := list(_ramps(points, label, legend, trials)))[:1]:
                size = _AT.surely * max(float(one.faintest.max()) for one in each)
                seen = slice(int(ramps.within.frames[0]), int(ramps.within.frames[-1]) + 1)
                found[label] = (min(size, found[label][0]), seen)
    return found


def _on_trunk(points: Points, legend: Legend) -> list[str]:
    return [label for label, name in legend.named.items() if label in points and level(name) is not None]


def _told(each: Iterable[_Ramps], enough: float) -> float:
    """How clearly all of them tell a drift, as far as it is enough."""
    least = 0.0
    for index, ramps in enumerate(each):
        best = int(np.argmax(ramps.share))
        clear = float(ramps.clear[best] * (ramps.share[best] > _AT.share))
        least = min(least, clear) if index else clear
        if least < enough:
            break
    return least


def _finding(label: str, ramps: _Ramps, legend: Legend) -> Finding:
    best = int(np.argmax(ramps.share))
    start, stop = (round(share * (len(legend.time) - 1)) for share in ramps.edges[best])
    words = {"size": ramps.sizes[best] * 1e3, "mates": ", ".join(ramps.within.mates[: _AT.fewest_mates])}
    words |= {"start": legend.time[start], "stop": legend.time[stop]}
    return legend.finding("drift", (label,), slice(start, len(legend.time)), **words)


def _ramps(points: Points, label: str, legend: Legend, others: Sequence[Points] = ()) -> Iterator[_Ramps]:
    """Yield them as all other trials tell, then without each of those; nothing where the neighbours of a marker do not tell."""
    within = _within(points, label) if len(legend.time) >= _AT.shortest_s * legend.rate else None
    if within is None:
        return
    instants = np.linspace(0, 1, _AT.edges)
    edges = np.array([(a, b) for index, a in enumerate(instants) for b in instants[index + 1 :]])
    ramps = np.clip((within.frames[:, None] / (len(legend.time) - 1) - edges[:, 0]) / np.diff(edges).T, 0, 1)
    slow = np.diff(edges)[:, 0] * len(legend.time) >= _AT.slow_s * legend.rate
    whole = slow & (np.ptp(ramps, axis=0) > _AT.inside)
    if not whole.any():
        return
    edges, ramps = edges[whole], ramps[:, whole] - ramps[:, whole].mean(axis=0)
    smallest = _AT.smallest_m * (_AT.shoulder if legend.named[label].endswith("SHOULDER") else 1)
    seen = [told for trial in others if (told := _elsewhere(within, trial))]
    for out in (None, *range(len(seen))):
        kept = [told for index, told in enumerate(seen) if index != out]
        yield _explained(within, edges, ramps, smallest, kept)


def _explained(within: _Within, edges: np.ndarray, ramps: np.ndarray, smallest: float, seen: list) -> _Ramps:
    """What the ramps explain beside posture; `seen` are shapes and places in other trials."""
    usual = (_AT.skin / _AT.noise_m) ** 2
    place, shape = within.place, within.shape
    bends = shape @ shape.T
    if seen:
        sums = sum((usual * there.T @ there for there, _ in seen), np.eye(shape.shape[1]))
        places = sum(usual * there.T @ known for there, known in seen)
        learnt = np.linalg.solve(sums, np.hstack([places, shape.T]))
        place, bends = place - shape @ learnt[:, :3], shape @ learnt[:, 3:]
    scatter = np.eye(len(ramps)) + usual * bends
    left, own = np.split(np.linalg.solve(scatter, np.hstack([ramps, place])), [len(edges)], axis=1)
    power = (ramps * left).sum(axis=0)
    free = power / (ramps**2).sum(axis=0)
    steps = left.T @ place / power[:, None]
    counts = smallest**2 * np.eye(3) + _AT.wavers**2 * within.wavers
    squares = (steps * np.linalg.solve(counts, steps.T).T).sum(axis=1)
    total = np.trace(np.linalg.solve(counts, place.T @ own)) + np.finfo(float).tiny
    explained = np.where(free > _AT.free, squares * power, 0)
    # To be told a drift must exceed what counts, and make its share of all movement.
    least = np.maximum(1 / free, _AT.share / (1 - _AT.share) * (total - explained.max()) / power)
    faintest = np.sqrt(np.linalg.eigvalsh(counts)[-1] * least)
    sizes = np.linalg.norm(steps, axis=1)
    return _Ramps(within, edges, sizes, np.sqrt(squares * free), explained / total, faintest)


def _within(points: Points, label: str) -> _Within | None:
    """By the markers at the most constant distance, or by the nearest: which of them a large drift leaves as they are."""
    frames = _spread_frames(points, [label])
    if len(frames) < _AT.fewest:
        return None
    sample = {other: positions[frames] for other, positions in points.items()}
    steady = _by(sample, frames, label, *mates_of(sample, label, near=False))
    if steady and np.trace(steady.wavers) < _AT.steady_m**2:
        return steady
    near = _by(sample, frames, label, *mates_of(sample, label, near=True))
    if near and (not steady or np.trace(near.wavers) < _AT.steadier * np.trace(steady.wavers)):
        return near
    return steady


def _spread_frames(points: Points, labels: list[str]) -> np.ndarray:
    """Some of the frames in which these markers are seen, evenly among all of them."""
    seen = np.flatnonzero(np.isfinite(np.stack([points[label] for label in labels])).all(axis=(0, 2)))
    return seen[np.linspace(0, len(seen) - 1, min(_AT.samples, len(seen))).astype(int)]


def mates_of(sample: Points, label: str, near: bool) -> tuple[list[str], np.ndarray]:
    """Markers at the most constant distance, or the nearest, and by how much it varies, metres; none where there are too few."""
    labels = list(sample)
    distance = np.linalg.norm(np.stack([sample[other] for other in labels]) - sample[label], axis=2)
    low, middle, high = percentiles(distance, (0.05, 0.5, 0.95))
    known = (middle > _AT.apart_m) & (np.isfinite(distance).mean(axis=1) > _AT.seen)
    spread = np.hypot(high - low, _AT.bends * middle)
    usable = known if near else known & (spread < _AT.loose_m)
    order = np.argsort(np.where(usable, middle if near else spread, np.inf))[: _AT.mates]
    chosen = order[usable[order]] if usable.sum() >= _AT.fewest_mates else order[:0]
    return [labels[index] for index in chosen], spread[chosen]


def _by(
    sample: Points, frames: np.ndarray, label: str, mates: list[str], spread: np.ndarray
) -> _Within | None:
    """None where the mates are too few, or seen together in too few samples.

    The frame is where weighted squares of the mates' distances from their mean places are least (Kabsch); then once more, with
    weights by those distances.
    """
    told = np.isfinite(np.stack([sample[mate] for mate in mates])).all(axis=(0, 2)) if mates else frames[:0]
    if told.sum() < _AT.fewest:
        return None
    sample = {other: positions[told] for other, positions in sample.items()}
    parts = np.stack([sample[mate] for mate in mates], axis=1)
    far = np.nanmedian(np.linalg.norm(parts - sample[label][:, None], axis=2), axis=0)
    for _ in range(2):
        weights = 1 / (_AT.soft_m**2 + spread**2)
        centre = np.average(parts, axis=1, weights=weights)
        turn, mean, off = _turned(parts - centre[:, None], weights)
        spread = np.hypot(np.sqrt(off), _AT.bends * far)
    seen = [other for other in sample if np.isfinite(sample[other]).all(axis=1).mean() > _AT.seen]
    labels = [label, *(other for other in seen if other != label)]
    at, place, shape = _placed(sample, labels, centre, turn)
    wavers = _wavers(at, mean, 1 / (_AT.least_scatter_m**2 + off))
    return _Within(labels, mates, weights, mean, frames[told], place, shape, wavers)


def _elsewhere(within: _Within, trial: Points) -> tuple[np.ndarray, np.ndarray] | None:
    """Shape and place, as of `within`, in another trial; None where it shows too little of them."""
    needed = [within.labels[0], *within.mates]
    frames = _spread_frames(trial, needed) if trial.keys() >= set(needed) else np.empty(0)
    if len(frames) < _AT.fewest:
        return None
    unseen = np.full((len(frames), 3), np.nan)
    sample = {
        other: trial[other][frames] if other in trial else unseen for other in (*needed, *within.labels)
    }
    parts = np.stack([sample[mate] for mate in within.mates], axis=1)
    centre = np.average(parts, axis=1, weights=within.weights)
    turn = _turn(within.mean, parts - centre[:, None], within.weights)
    return _placed(sample, within.labels, centre, turn)[:0:-1]


def _placed(
    sample: Points, labels: list[str], centre: np.ndarray, turn: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """In a frame: mean place of the first marker, its place less that, and the shape of the others, wherever they were put."""
    local = np.einsum("kti,tji->tkj", np.stack([sample[label] for label in labels]) - centre, turn)
    seen = np.isfinite(local)
    mean = np.where(seen, local, 0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    shape = np.nan_to_num(local - mean)[:, 1:].reshape(len(local), -1) / np.sqrt(len(labels) - 1)
    return mean[0], local[:, 0] - mean[0], shape


def _turn(mean: np.ndarray, parts: np.ndarray, weights: np.ndarray) -> np.ndarray:
    u, _, vt = np.linalg.svd(np.einsum("ki,k,tkj->tij", mean, weights, parts))
    u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    return u @ vt


def _turned(parts: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Turns into the frame, mean places in it, and each mate's mean square from its own, by as many as weigh."""
    mean = parts[len(parts) // 2]
    for _ in range(3):
        turn = _turn(mean, parts, weights)
        local = np.einsum("tki,tji->tkj", parts, turn)
        mean = local.mean(axis=0)
    # A frame takes six of the three numbers that each mate gives: so much smaller is what is left.
    count = weights.sum() ** 2 / (weights**2).sum()
    off = ((local - mean) ** 2).sum(axis=2).mean(axis=0)
    return turn, mean, off * count / max(count - 2, _AT.least_free)


def _wavers(place: np.ndarray, mates: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Covariance of a place in a frame by mates whose places have the inverse of these variances, shape (3, 3)."""
    centre = np.average(mates, axis=0, weights=weights)
    lever, *arms = (np.cross(np.eye(3), arm) for arm in (place - centre, *(mates - centre)))
    turn = np.linalg.pinv(sum(weight * arm @ arm.T for weight, arm in zip(weights, arms, strict=True)))
    return np.eye(3) / weights.sum() + lever.T @ turn @ lever
