"""Lengths between markers of one rigid part, found from the recording itself: a box, a plate, a pelvis, a thorax."""

from __future__ import annotations

import numpy as np

from lumbar.records.stretches import runs

_SAMPLES = 300
_RIGID_M = 0.008
"""Spread (5th to 95th percentile) of a length that is called rigid: skin moves by some millimetres."""
_APART_M = 0.03
_MOVING_M, _MOVING_S = 0.015, 0.2
"""A marker moves where it comes further than this within this time."""
_MATES = 6
_DEVIATION_M = 0.03
_SPREADS = 6.0
_SHORTEST = 5
_MAJORITY = 0.6
_LEAST_MATES = 3


def rigid_mates(points: dict[str, np.ndarray], without: frozenset[str] = frozenset()) -> dict[str, list[str]]:
    """Return, for each marker, those at the most constant distance from it, most constant first.

    Parameters
    ----------
    points : dict of str to ndarray, shape (n_frames, 3)
        Metres; NaN where not seen.
    without : frozenset of str
        Labels that are nobody's mate.
    """
    labels = list(points)
    every = max(1, len(next(iter(points.values()))) // _SAMPLES)
    sample = np.stack([points[label][::every] for label in labels])
    mates = {}
    for index, label in enumerate(labels):
        spread, middle = _spread(sample, index)
        known = [
            other for other in np.argsort(spread) if np.isfinite(spread[other]) and middle[other] > _APART_M
        ]
        mates[label] = [labels[other] for other in known if labels[other] not in without][:_MATES]
    return mates


def _spread(sample: np.ndarray, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Spread and median of the distance of every marker from one of them; sample has shape (n_markers, n, 3)."""
    low, middle, high = _percentiles(np.linalg.norm(sample - sample[index], axis=2), (0.05, 0.5, 0.95))
    return high - low, middle


def _rigid_parts(points: dict[str, np.ndarray], rate: float) -> dict[str, list[tuple[str, float]]]:
    """Mates whose distance from a marker is constant while either moves, with its spread in metres; at most `_MATES`.

    What rests tells nothing: two feet on the ground are not one body.
    """
    labels = list(points)
    every = max(1, round(_MOVING_S * rate / 8))
    lag = max(1, round(_MOVING_S * rate / every))
    sample = np.stack([points[label][::every] for label in labels])
    with np.errstate(invalid="ignore"):
        moving = np.linalg.norm(sample[:, lag:] - sample[:, :-lag], axis=2) > _MOVING_M
    spreads = np.full((len(labels), len(labels)), np.nan)
    for index in range(len(labels)):
        frames = np.flatnonzero(moving[index])
        if len(frames) * every >= _MOVING_S * rate:
            chosen = frames[np.linspace(0, len(frames) - 1, min(len(frames), _SAMPLES)).astype(int)]
            spread, middle = _spread(sample[:, chosen], index)
            spreads[:, index] = np.where(middle > _APART_M, spread, np.nan)
    spreads = np.maximum(spreads, spreads.T)
    return {
        label: [
            (labels[other], float(row[other])) for other in np.argsort(row)[:_MATES] if row[other] < _RIGID_M
        ]
        for label, row in zip(labels, spreads, strict=True)
    }


def _percentiles(values: np.ndarray, shares: tuple[float, ...]) -> np.ndarray:
    """Of each row over what is finite, shape (n_shares, n_rows); NaN with fewer than ten finite values.

    By one sorting: NumPy's own percentiles without NaN go through the rows one by one.
    """
    ordered = np.sort(values, axis=1)
    count = np.isfinite(ordered).sum(axis=1)
    at = np.round(np.outer(shares, np.maximum(count - 1, 0))).astype(int)
    found = np.take_along_axis(ordered, at.T, axis=1).T
    return np.where(count >= min(10, values.shape[1]), found, np.nan)


def length(points: dict[str, np.ndarray], one: str, other: str, frames: slice | np.ndarray) -> float:
    """Median distance of two markers over some frames, metres; NaN where they were not seen together."""
    distance = np.linalg.norm(points[one][frames] - points[other][frames], axis=1)
    return float(np.nanmedian(distance)) if np.isfinite(distance).any() else np.nan


def off_its_part(points: dict[str, np.ndarray], rate: float) -> list[tuple[str, slice, str]]:
    """Stretches in which a marker is not where the rigid part that it belongs to has it.

    A marker counts as part of a rigid one by three mates at distances that stay within 8 mm in nine of ten frames in which either
    moves. It is off where most of these differ by more than 30 mm, and by six times their usual spread, from their medians.

    Returns
    -------
    list of (str, slice, str)
        Label, frames, what was seen.
    """
    found = []
    known: dict[frozenset[str], np.ndarray] = {}
    for label, rigid in _rigid_parts(points, rate).items():
        if len(rigid) >= _LEAST_MATES:
            for other, _ in rigid:
                if frozenset((label, other)) not in known:
                    known[frozenset((label, other))] = _change_of_length(points[label], points[other])
            changes = {other: known[frozenset((label, other))] for other, _ in rigid}
            limits = [max(_DEVIATION_M, _SPREADS * spread) for _, spread in rigid]
            found += _stretches_off(label, changes, limits)
    return found


def _change_of_length(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    distance = np.linalg.norm(one - other, axis=1)
    # The median of what is seen: NumPy's own without NaN takes twice as long.
    return distance - np.median(distance[np.isfinite(distance)])


def _stretches_off(
    label: str, changes: dict[str, np.ndarray], limits: list[float]
) -> list[tuple[str, slice, str]]:
    change = np.abs(list(changes.values()))
    with np.errstate(invalid="ignore"):
        far = (change > np.array(limits)[:, None]).sum(axis=0)
    together = np.isfinite(change).sum(axis=0)
    stretches = runs((far > _MAJORITY * together) & (together >= _LEAST_MATES))
    mates = ", ".join(changes)
    return [
        (
            label,
            stretch,
            f"up to {np.nanmax(change[:, stretch]) * 1e3:.0f} mm off its distances from {mates}, constant elsewhere",
        )
        for stretch in stretches
        if stretch.stop - stretch.start >= _SHORTEST
    ]
