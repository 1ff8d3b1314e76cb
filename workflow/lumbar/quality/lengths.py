"""Lengths between markers of one rigid part, found from the recording itself: a box, a plate, a pelvis, a thorax."""

from __future__ import annotations

import numpy as np

from lumbar.records.stretches import runs

_SAMPLES = 300
_RIGID_M = 0.008
"""Spread (5th to 95th percentile) of a length that is called rigid: skin moves by some millimetres."""
_APART_M = 0.03
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
    return {label: [other for other, _ in found] for label, found in _mates(points, without).items()}


def _mates(
    points: dict[str, np.ndarray], without: frozenset[str] = frozenset()
) -> dict[str, list[tuple[str, float]]]:
    """Mates of each marker, with the spread of the distance in metres."""
    labels = list(points)
    every = max(1, len(next(iter(points.values()))) // _SAMPLES)
    sample = np.stack([points[label][::every] for label in labels])
    mates = {}
    for index, label in enumerate(labels):
        low, middle, high = _percentiles(np.linalg.norm(sample - sample[index], axis=2), (0.05, 0.5, 0.95))
        spread = high - low
        known = [
            other for other in np.argsort(spread) if np.isfinite(spread[other]) and middle[other] > _APART_M
        ]
        chosen = [(labels[other], float(spread[other])) for other in known if labels[other] not in without]
        mates[label] = chosen[:_MATES]
    return mates


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


def off_its_part(points: dict[str, np.ndarray]) -> list[tuple[str, slice, str]]:
    """Stretches in which a marker is not where the rigid part that it belongs to has it.

    A marker counts as part of a rigid one by three mates at distances that stay within 8 mm in nine of ten frames. It is off
    where most of these differ by more than 30 mm, and by six times their usual spread, from their medians.

    Returns
    -------
    list of (str, slice, str)
        Label, frames, what was seen.
    """
    found = []
    for label, others in _mates(points).items():
        rigid = [(other, spread) for other, spread in others if spread < _RIGID_M]
        if len(rigid) >= _LEAST_MATES:
            changes = {other: _change_of_length(points[label], points[other]) for other, _ in rigid}
            limits = [max(_DEVIATION_M, _SPREADS * spread) for _, spread in rigid]
            found += _stretches_off(label, changes, limits)
    return found


def _change_of_length(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    distance = np.linalg.norm(one - other, axis=1)
    return distance - np.nanmedian(distance)


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
