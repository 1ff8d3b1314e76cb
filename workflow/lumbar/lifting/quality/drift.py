"""Markers of the trunk that creep from their place: seen by their neighbours, less what the person's posture explains.

The positions of a marker in the frame of the markers that keep their distances from it best change with posture, since skin
moves. What changes of the body's shape explain of that, by a linear Gaussian process, is set aside; a drift is a ramp in what
is left. A drift that goes along with the only change of posture of a short trial cannot be told from it.
"""

from dataclasses import dataclass

import numpy as np

from lumbar.lifting.quality.displacement import percentiles
from lumbar.lifting.quality.landmarks import level
from lumbar.lifting.quality.sheet import Clock, Finding

_SAMPLES, _FEWEST = 80, 50
_MATES, _FEWEST_MATES, _SEEN = 8, 3, 0.7
_APART_M, _LOOSE_M, _SOFT_M, _BENDS = 0.03, 0.15, 0.006, 0.04
"""Mates are further away than the first, keep their distance within the second, and count by the inverse square of what it
varies by, at least by the third and by this share of itself."""
_SKIN, _NOISE_M = 0.02, 0.004
"""What posture may explain: skin follows this share of a change of the body's shape, and scatters."""
_EDGES = 11
_SMALLEST_M, _SHARE, _FREE = 0.02, 0.35, 0.1
"""A drift beyond what posture may explain, the share of the marker's movement in the frame that it makes, and how much of
the ramp posture must leave."""
_SHOULDER = 2.0
"""Times as much of shoulders, which arms move."""
_MOST, _SHORTEST_S = 4, 1.5


@dataclass(frozen=True)
class Drift:
    """A ramp in the place of a marker."""

    label: str
    step: np.ndarray
    """Shape (3,), in the frame of the mates, metres."""
    start: float
    stop: float
    """`start`, `stop`: shares of the recording between which it goes on."""
    mates: tuple[str, ...]
    clear: float
    """Size beyond what posture may explain, by that from which it counts."""


def drifts(points: dict[str, np.ndarray], named: dict[str, str], clock: Clock) -> list[Finding]:
    """Markers on the trunk that drift, the clearest first; each is looked at without those found before."""
    found: list[Drift] = []
    every = np.linspace(0, len(clock.time) - 1, min(_SAMPLES, len(clock.time))).astype(int)
    sample = {label: positions[every] for label, positions in points.items()}
    while len(found) < _MOST and len(clock.time) >= _SHORTEST_S * clock.rate:
        trunk = [
            label for label, landmark in named.items() if level(landmark) is not None and label in sample
        ]
        each = [drift for label in trunk if (drift := _drift(sample, label, named[label]))]
        if not each or max(each, key=lambda one: one.clear).clear < 1:
            break
        found.append(max(each, key=lambda one: one.clear))
        del sample[found[-1].label]
    return [_finding(drift, clock) for drift in found]


def _finding(drift: Drift, clock: Clock) -> Finding:
    edges = [round(share * (len(clock.time) - 1)) for share in (drift.start, drift.stop)]
    words = {
        "size": np.linalg.norm(drift.step) * 1e3,
        "mates": ", ".join(drift.mates[:_FEWEST_MATES]),
        "start": clock.time[edges[0]],
        "stop": clock.time[edges[1]],
    }
    return clock.finding("drift", (drift.label,), slice(edges[0], len(clock.time)), **words)


def _drift(sample: dict[str, np.ndarray], label: str, landmark: str) -> Drift | None:
    """The ramp that explains most of what posture leaves of a marker's place; None where its neighbours do not tell."""
    mates, weights = _mates(sample, label)
    within = _in_frame(sample, label, mates, weights) if mates else None
    if within is None:
        return None
    place, shape, seen = within
    ramps, edges = _ramps(len(seen))
    ramps = ramps[seen] - ramps[seen].mean(axis=0)
    scatter = np.eye(len(shape)) + (_SKIN / _NOISE_M) ** 2 * (shape @ shape.T)
    left, own = np.split(np.linalg.solve(scatter, np.hstack([ramps, place])), [ramps.shape[1]], axis=1)
    power = (ramps * left).sum(axis=0)
    free = power / np.maximum((ramps**2).sum(axis=0), 1e-9)
    steps = left.T @ place / np.maximum(power, 1e-9)[:, None]
    explained = np.where(free > _FREE, (steps**2).sum(axis=1) * power, 0)
    best = int(np.argmax(explained))
    if explained[best] < _SHARE * (place * own).sum():
        return None
    smallest = _SMALLEST_M * (_SHOULDER if landmark.endswith("SHOULDER") else 1)
    clear = np.linalg.norm(steps[best]) * np.sqrt(free[best]) / smallest
    return Drift(label, steps[best], *edges[best], tuple(mates), float(clear))


def _mates(sample: dict[str, np.ndarray], label: str) -> tuple[list[str], np.ndarray]:
    """Markers at the most constant distance, and their weights; none where there are too few."""
    labels = list(sample)
    distance = np.linalg.norm(np.stack([sample[other] for other in labels]) - sample[label], axis=2)
    low, middle, high = percentiles(distance, (0.05, 0.5, 0.95))
    known = (middle > _APART_M) & (np.isfinite(distance).mean(axis=1) > _SEEN)
    spread = np.where(known, np.hypot(high - low, _BENDS * middle), np.inf)
    chosen = [int(index) for index in np.argsort(spread)[:_MATES] if spread[index] < _LOOSE_M]
    if len(chosen) < _FEWEST_MATES:
        return [], np.zeros(0)
    weights = 1 / (_SOFT_M**2 + spread[chosen] ** 2)
    return [labels[index] for index in chosen], weights / weights.sum()


def _in_frame(
    sample: dict[str, np.ndarray], label: str, mates: list[str], weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Place of a marker and of all others in the frame of its mates, less their means, and the samples where all are seen.

    None where those are too few. The frame is where weighted squares of the mates' distances from their mean places are least
    (Kabsch).
    """
    parts = np.stack([sample[mate] for mate in mates], axis=1)
    seen = np.isfinite(parts).all(axis=(1, 2)) & np.isfinite(sample[label]).all(axis=1)
    if seen.sum() < _FEWEST:
        return None
    centre = (weights[:, None] * parts[seen]).sum(axis=1)
    parts = parts[seen] - centre[:, None]
    mean = parts[len(parts) // 2]
    for _ in range(3):
        u, _, vt = np.linalg.svd(np.einsum("ki,k,tkj->tij", mean, weights, parts))
        u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
        turn = u @ vt
        mean = np.einsum("tki,tji->tkj", parts, turn).mean(axis=0)
    others = np.stack([positions for other, positions in sample.items() if other != label])[:, seen]
    others = others[np.isfinite(others).all(axis=2).mean(axis=1) > _SEEN]
    local = np.einsum("kti,tji->tkj", np.concatenate([sample[label][None, seen], others]) - centre, turn)
    local -= np.nanmean(local, axis=0)
    shape = np.nan_to_num(local[:, 1:]) / np.sqrt(len(others))
    return local[:, 0], shape.reshape(len(shape), -1), seen


def _ramps(count: int) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """Ramps from 0 to 1 between all pairs of some instants, shape (count, n), and the pairs, as shares of the recording."""
    instants = np.linspace(0, 1, _EDGES)
    edges = [(float(a), float(b)) for i, a in enumerate(instants) for b in instants[i + 1 :]]
    time = np.linspace(0, 1, count)
    return np.stack([np.clip((time - a) / (b - a), 0, 1) for a, b in edges], axis=1), edges
