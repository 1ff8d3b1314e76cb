"""Which cause of an error is told from the others, on all records together.

Any force that follows the motion resembles linear dynamics on one record, its best linear approximation, but others on other
excitation (Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2012, chapter 3); and refitting a base
leaves a linear part whatever is missing. So linear dynamics are fitted once to the error of all records, and every other cause
beside them: what it takes of what they leave tells it from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lumbar.tissue.diagnosis.residuals.motion_diagnostics import (
    DEPTHS,
    binned,
    map_edges,
    reversals,
    spread_edges,
)
from lumbar.tissue.diagnosis.residuals.residual import Residual, percent
from lumbar.tissue.diagnosis.residuals.residual_tests import linear_columns, relaxation_times
from lumbar.tissue.diagnosis.residuals.time_frequency import time_edges, time_view

_SHARES = np.linspace(0, 1, 9)
"""Ends of the bins of the way since a reversal, as shares of the samples: most ways are short."""
_MOST, _WORTH = 0.5, 0.05
"""Shares of what linear dynamics leave and of the explainable error that another cause takes where it explains more."""
_LEAST = 0.01
"""Share of the explainable error below which a cause is not told."""
_SMALLEST = 1e-10
"""Eigenvalue of the columns' products, as a share of the largest, below which a direction is rounding."""
MEANINGS = {
    "time": "it does not repeat with the motion, as a drift, a softening or a disturbance",
    "position and velocity": "a damping or friction that depends on the present velocity",
    "depth": "a stiffness that depends on depth, a contact or a limit of the force",
    "reversals": "a memory of the last reversal, as hysteresis or play",
    "linear dynamics": "linear dynamics that the model lacks, as inertia, delay or another relaxation",
}


@dataclass(frozen=True)
class Cause:
    """What one cause accounts for."""

    name: str
    """Of the view that shows it."""
    share: float
    """Of the explainable error: linear dynamics by themselves, velocity beyond position, others beyond linear dynamics."""
    share_of_rest: float
    """Of what linear dynamics leave; of linear dynamics, the share itself."""


def rank_causes(residuals: Sequence[Residual]) -> list[Cause]:
    """Return the causes by how well they are told from the others, the best first.

    That is by share; linear dynamics come after a cause that takes most of what they leave.

    Parameters
    ----------
    residuals : sequence of Residual
        One model's, of all records.
    """
    values = np.concatenate([item.values for item in residuals])
    noise = np.mean([0.0 if item.floor is None else item.floor.rms**2 for item in residuals])
    explainable = float(np.mean(values**2)) - noise
    if explainable <= 0:
        return []
    linear = _linear(residuals)

    def left(groups: np.ndarray | None = None) -> float:
        return max(_mean_square_left(values, linear, groups) - noise, 0.0) / explainable

    rest, left_by = left(), {name: left(groups) for name, groups in _groups(residuals).items()}
    shares = {
        "linear dynamics": 1 - rest,
        "depth": rest - left_by["depth"],
        "position and velocity": left_by["depth"] - left_by["position and velocity"],
        "reversals": rest - left_by["reversals"],
        "time": _time_share(residuals, rest - left_by["time"]),
    }
    causes = [
        Cause(name, share, share if name == "linear dynamics" else share / max(rest, share))
        for name, share in shares.items()
        if share > 0
    ]
    others = [item for item in causes if item.name != "linear dynamics"]
    beaten = any(item.share > _WORTH and item.share_of_rest > _MOST for item in others)
    return sorted(causes, key=lambda item: (beaten and item.name == "linear dynamics", -item.share))


def _linear(residuals: Sequence[Residual]) -> np.ndarray:
    """A constant of each record, and linear dynamics that all have in common; shape (samples, columns)."""
    times = relaxation_times(residuals)
    common = np.vstack([linear_columns(item, times) for item in residuals])
    record = np.repeat(np.arange(len(residuals)), [len(item.values) for item in residuals])
    return np.hstack([common, record[:, None] == np.arange(len(residuals))])


def _groups(residuals: Sequence[Residual]) -> dict[str, np.ndarray]:
    """Groups of samples in each of which a cause has a level of its own, alike on all records but for windows of time."""
    position = np.concatenate([item.position for item in residuals])
    velocity = np.concatenate([item.velocity for item in residuals])
    along, across = map_edges(position, velocity)
    windows = [
        binned(np.arange(len(item.values)), [*time_edges(item), len(item.values)]) for item in residuals
    ]
    return {
        "depth": binned(position, spread_edges(position, DEPTHS)),
        "position and velocity": binned(velocity, across) * len(along) + binned(position, along),
        "reversals": _since_reversals(residuals),
        "time": np.concatenate([number * len(position) + window for number, window in enumerate(windows)]),
    }


def _since_reversals(residuals: Sequence[Residual]) -> np.ndarray:
    """Groups by the way since the last reversal, signed by its direction; 0 before the first."""
    ways = np.concatenate([_signed_way(item.position) for item in residuals])
    edges = np.unique(np.quantile(np.abs(ways[ways != 0]), _SHARES)) if np.any(ways) else np.zeros(2)
    return np.sign(ways) * (1 + binned(np.abs(ways), edges))


def _signed_way(position: np.ndarray) -> np.ndarray:
    """Way since the last reversal."""
    turns, _ = reversals(position)
    last = np.searchsorted(turns, np.arange(len(position)), side="right") - 1
    return (
        np.where(last >= 0, position - position[turns[last]], 0.0) if turns.size else np.zeros(len(position))
    )


def _mean_square_left(values: np.ndarray, linear: np.ndarray, groups: np.ndarray | None = None) -> float:
    """Mean square that a least-squares fit of columns, and of a level in each group, leaves, for its degrees of freedom."""
    products, sums = linear.T @ linear, linear.T @ values
    if groups is not None:
        number = np.unique(groups, return_inverse=True)[1]
        across = np.array([np.bincount(number, column) for column in linear.T])
        products = np.block([[products, across], [across.T, np.diag(np.bincount(number))]])
        sums = np.concatenate([sums, np.bincount(number, values)])
    size = np.sqrt(np.maximum(np.diag(products), 1e-300))
    eigenvalues, vectors = np.linalg.eigh(products / np.outer(size, size))
    kept = eigenvalues > _SMALLEST * eigenvalues[-1]
    found = (vectors[:, kept].T @ (sums / size)) ** 2 / eigenvalues[kept]
    return float(values @ values - found.sum()) / (len(values) - int(kept.sum()))


def _time_share(residuals: Sequence[Residual], of_windows: float) -> float:
    """Share that does not repeat with the input, of records that do; of others what windows of time take."""
    repeating = [item for item in residuals if item.folding is not None]
    total = sum(item.explainable for item in repeating)
    if total <= 0:
        return of_windows
    return sum(time_view(item).share * item.explainable for item in repeating) / total


def causes_sentence(causes: Sequence[Cause], records: int, of: str) -> str:
    """Say which cause is told best from the others, with its share `of` the error, and what the next ones take."""
    where = f"All {records} records" if records > 1 else "This record"
    told = [item for item in causes if item.share >= _LEAST]
    if not told:
        return f"{where}: no cause that was tried accounts for the error."
    first, *others = told
    beside = f", {percent(first.share_of_rest)} of what linear dynamics leave"
    beside = "" if first.name in ("linear dynamics", "time") else beside
    sentence = (
        f"{where}: {first.name} first ({percent(first.share)} of the {of}{beside}): {MEANINGS[first.name]}"
    )
    if first.name == "linear dynamics" and 1 - first.share > _WORTH:
        sentence += f", though {percent(1 - first.share)} of it is not linear in the motion"
    listed = ", ".join(f"{item.name} ({percent(item.share)})" for item in others)
    resembled = "; any force that follows the motion looks linear in part"
    resembled = resembled if any(item.name == "linear dynamics" for item in others) else ""
    return f"{sentence}; then {listed}{resembled}." if listed else f"{sentence}."
