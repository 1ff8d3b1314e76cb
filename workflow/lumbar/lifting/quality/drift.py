"""Markers of the trunk that creep from their place: seen by their neighbours, less what the person's posture explains.

The positions of a marker in the frame of the markers that keep their distances from it best change with posture, since skin
moves. What changes of the body's shape explain of that, by a linear Gaussian process, is set aside; a drift is a ramp in what
is left. A drift that goes along with the only change of posture of a short trial cannot be told from it.
"""

from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality.displacement import percentiles
from lumbar.lifting.quality.landmarks import level
from lumbar.lifting.quality.sheet import Finding, Legend

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "drift")


def drifts(points: dict[str, np.ndarray], legend: Legend) -> list[Finding]:
    """Markers on the trunk that drift, the clearest first; each is looked at without those found before."""
    found: list[Finding] = []
    every = np.linspace(0, len(legend.time) - 1, min(_AT.samples, len(legend.time))).astype(int)
    sample = {label: positions[every] for label, positions in points.items()}
    while len(found) < _AT.most and len(legend.time) >= _AT.shortest_s * legend.rate:
        trunk = [
            label for label in legend.named if label in sample and level(legend.named[label]) is not None
        ]
        each = [drift for label in trunk if (drift := _drift(sample, label, legend))]
        clear, finding = max(each, key=lambda one: one[0], default=(0, None))
        if finding is None or clear < 1:
            break
        found.append(finding)
        del sample[finding.markers[0]]
    return found


def _drift(sample: dict[str, np.ndarray], label: str, legend: Legend) -> tuple[float, Finding] | None:
    """The ramp that explains most of what posture leaves of a marker's place, after its size by that from which it counts.

    None where its neighbours do not tell.
    """
    mates, weights = constant_mates(sample, label)
    within = _in_frame(sample, label, mates, weights) if mates else None
    if within is None:
        return None
    place, shape, seen = within
    ramps, edges = _ramps(len(seen))
    ramps = ramps[seen] - ramps[seen].mean(axis=0)
    scatter = np.eye(len(shape)) + (_AT.skin / _AT.noise_m) ** 2 * (shape @ shape.T)
    left, own = np.split(np.linalg.solve(scatter, np.hstack([ramps, place])), [ramps.shape[1]], axis=1)
    power = (ramps * left).sum(axis=0)
    free = power / np.maximum((ramps**2).sum(axis=0), 1e-9)
    steps = left.T @ place / np.maximum(power, 1e-9)[:, None]
    explained = np.where(free > _AT.free, (steps**2).sum(axis=1) * power, 0)
    best = int(np.argmax(explained))
    if explained[best] < _AT.share * (place * own).sum():
        return None
    smallest = _AT.smallest_m * (_AT.shoulder if legend.named[label].endswith("SHOULDER") else 1)
    size = float(np.linalg.norm(steps[best]))
    start, stop = (round(share * (len(legend.time) - 1)) for share in edges[best])
    words = {"size": size * 1e3, "mates": ", ".join(mates[: _AT.fewest_mates])}
    words |= {"start": legend.time[start], "stop": legend.time[stop]}
    finding = legend.finding("drift", (label,), slice(start, len(legend.time)), **words)
    return size * float(np.sqrt(free[best])) / smallest, finding


def constant_mates(sample: dict[str, np.ndarray], label: str) -> tuple[list[str], np.ndarray]:
    """Markers at the most constant distance, and their weights; none where there are too few."""
    labels = list(sample)
    distance = np.linalg.norm(np.stack([sample[other] for other in labels]) - sample[label], axis=2)
    low, middle, high = percentiles(distance, (0.05, 0.5, 0.95))
    known = (middle > _AT.apart_m) & (np.isfinite(distance).mean(axis=1) > _AT.seen)
    spread = np.where(known, np.hypot(high - low, _AT.bends * middle), np.inf)
    chosen = [int(index) for index in np.argsort(spread)[: _AT.mates] if spread[index] < _AT.loose_m]
    if len(chosen) < _AT.fewest_mates:
        return [], np.zeros(0)
    weights = 1 / (_AT.soft_m**2 + spread[chosen] ** 2)
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
    if seen.sum() < _AT.fewest:
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
    others = others[np.isfinite(others).all(axis=2).mean(axis=1) > _AT.seen]
    local = np.einsum("kti,tji->tkj", np.concatenate([sample[label][None, seen], others]) - centre, turn)
    local -= np.nanmean(local, axis=0)
    shape = np.nan_to_num(local[:, 1:]) / np.sqrt(len(others))
    return local[:, 0], shape.reshape(len(shape), -1), seen


def _ramps(count: int) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """Ramps from 0 to 1 between all pairs of some instants, shape (count, n), and the pairs, as shares of the recording."""
    instants = np.linspace(0, 1, _AT.edges)
    edges = [(float(a), float(b)) for i, a in enumerate(instants) for b in instants[i + 1 :]]
    time = np.linspace(0, 1, count)
    return np.stack([np.clip((time - a) / (b - a), 0, 1) for a, b in edges], axis=1), edges
