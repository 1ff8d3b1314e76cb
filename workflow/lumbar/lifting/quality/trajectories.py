"""Trajectories that no marker can have: outside any laboratory, or constant to the last bit.

`points` are positions in metres by label, shape (n_frames, 3), NaN where not seen.
"""

from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality.sheet import Finding, Legend
from lumbar.records.stretches import runs

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "trajectories")

LABORATORY_M = 100.0
"""Coordinates beyond this distance from the origin lie in no laboratory."""


def beyond_laboratory(points: dict[str, np.ndarray], legend: Legend) -> list[Finding]:
    """Frames in which a marker is farther from the origin than any laboratory is long."""
    findings = []
    for label, positions in points.items():
        with np.errstate(invalid="ignore"):
            largest = np.abs(positions).max(axis=1)
            far = largest > LABORATORY_M
        for stretch in runs(far):
            most = largest[stretch].max()
            findings.append(legend.finding("beyond laboratory", (label,), stretch, most=most))
    return findings


def frozen_stretches(points: dict[str, np.ndarray], legend: Legend) -> list[Finding]:
    """Stretches in which a marker keeps its coordinates to the last bit while others move.

    A file whose numbers are coarse repeats some of them by chance: the share of unchanged steps outside of a run says how
    often, and a run counts when it has a chance below 1e-9. Where most of the three nearest markers keep theirs too, as on a
    box that stands, nothing is found, nor where the marker comes and goes by the file's resolution.
    """
    steady = np.array([_unchanged(positions) for positions in points.values()])
    if not steady.size:
        return []
    findings = []
    for index, label in enumerate(points):
        for run in runs(steady[index]):
            length = run.stop - run.start
            outside = np.delete(steady[index], np.r_[run])
            chance = (outside.sum() + 1) / (len(outside) + 2)
            if length < max(_AT.shortest_still, np.log(_AT.still_by_chance) / np.log(chance)):
                continue
            beside = np.abs(np.diff(points[label][max(0, run.start - 1) : run.stop + 2], axis=0))
            coarse = [_AT.resolved * _resolution(values) for values in points[label].T]
            near = _nearest(points, index, run)
            still = near and np.median(steady[near, run].mean(axis=1)) > _AT.others_still
            if not near or still or (beside.any() and (beside <= coarse).all()):
                continue
            stretch = slice(run.start, run.stop + 1)
            findings.append(legend.finding("frozen", (label,), stretch, frames_alike=length + 1))
    return findings


def _resolution(values: np.ndarray) -> float:
    """The smallest change of a coordinate that its numbers can express, about: of its third differences."""
    changes = np.abs(np.diff(values[np.isfinite(values)], n=3))
    return float(np.min(changes[changes > _AT.rounded_m], initial=np.inf))


def _unchanged(positions: np.ndarray) -> np.ndarray:
    """Whether each step leaves a marker exactly where it was, shape (n_frames - 1,)."""
    return (np.diff(positions, axis=0) == 0).all(axis=1)


def _nearest(points: dict[str, np.ndarray], index: int, run: slice) -> list[int]:
    """Return the markers nearest to one at the start of a run, among those seen there."""
    there = np.stack([positions[run.start] for positions in points.values()])
    distance = np.linalg.norm(there - there[index], axis=1)
    order = [other for other in np.argsort(distance) if other != index and np.isfinite(distance[other])]
    return order[: _AT.neighbours]


def held_samples(points: dict[str, np.ndarray], legend: Legend) -> tuple[list[Finding], set[str]]:
    """Find markers that move in every second (third, …) frame alone and keep their coordinates to the last bit in between.

    Their labels stand second.
    """
    held_in: dict[int, list[str]] = {}
    for label, positions in points.items():
        every = _moves_every(positions)
        if every:
            held_in.setdefault(every, []).append(label)
    findings = []
    for every, labels in held_in.items():
        words = {"count": len(labels), "of": len(points), "every": every}
        rates = {"own_rate": legend.rate / every, "rate": legend.rate}
        named = tuple(labels) if 2 * len(labels) < len(points) else ()
        findings.append(legend.finding("held", named, **words, **rates))
    return findings, {label for labels in held_in.values() for label in labels}


def _moves_every(positions: np.ndarray) -> int:
    """How many frames a marker keeps each of its positions for; 0 where there is no such number from 2 on."""
    seen = np.isfinite(positions[:, 0])
    known = seen[1:] & seen[:-1]
    moves = ~_unchanged(positions) & known
    if moves.sum() < _AT.fewest_moves or moves.sum() > 0.6 * known.sum():
        return 0
    for every in range(2, _AT.longest_hold + 1):
        phases = [(moves[phase::every].sum(), known[phase::every].sum()) for phase in range(every)]
        shares = sorted(moved / max(1, count) for moved, count in phases)
        if shares[-1] > _AT.held_share and shares[-2] < 1 - _AT.held_share:
            return every
    return 0
