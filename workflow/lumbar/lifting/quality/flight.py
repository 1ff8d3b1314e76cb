"""Gravity while both feet are off the floor, as in a jump or a run: it tells the rate, or the unit."""

from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality.landmarks import level
from lumbar.lifting.quality.sheet import Finding, Legend
from lumbar.records.stretches import runs

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "flight")
_GRAVITY = 9.81
_MASSES = {"KNEE": 0.2, "ANKLE": 0.12, "ELBOW": 0.06, "WRIST": 0.04}
"""Shares of the body's mass that move about as both of these do, by Winter's segments; the rest moves as the trunk."""


def flight_findings(points: dict[str, np.ndarray], legend: Legend) -> list[Finding] | None:
    """What gravity says against the rate or the unit, if anything; None without a flight that tells."""
    falls = _falls(points, legend)
    if not falls:
        return None
    fall, apart = np.median(falls, axis=0)
    low, high = fall - apart, fall + apart
    if high > _GRAVITY * _AT.limbs and low < _GRAVITY / _AT.limbs:
        return []
    words = {"count": len(falls), "low": low, "high": high, "rate": legend.rate}
    return [legend.finding("flight", **words, factor=np.sqrt(fall / _GRAVITY))]


def _falls(points: dict[str, np.ndarray], legend: Legend) -> list[tuple[float, float]]:
    """Acceleration downwards in every flight that tells, and what its parabola leaves open, m/s²."""
    at = {landmark: points[label] for label, landmark in legend.named.items() if label in points}
    trunk = [positions[:, 2] for landmark, positions in at.items() if level(landmark) is not None]
    feet = [
        [at[f"{side}_{name}"] for name in ("TOE", "HEEL", "ANKLE") if f"{side}_{name}" in at] for side in "LR"
    ]
    # Of a foot that rolls, either the toe or what is behind it stays on the floor.
    if not trunk or not {"L_TOE", "R_TOE"} <= at.keys() or min(map(len, feet)) < 2:
        return []
    heights = np.stack([marker[:, 2] for foot in feet for marker in foot])
    if not np.isfinite(heights).any(axis=1).all():
        return []
    off = (heights > np.nanquantile(heights, _AT.floor, axis=1)[:, None] + _AT.clear_m).all(axis=0)
    off &= np.mean(trunk, axis=0) > heights.max(axis=0) + _AT.upright_m
    shares = {name: share for name, share in _MASSES.items() if {f"L_{name}", f"R_{name}"} <= at.keys()}
    centre = (1 - sum(shares.values())) * np.mean(trunk, axis=0)
    for name, share in shares.items():
        centre = centre + share * (at[f"L_{name}"] + at[f"R_{name}"])[:, 2] / 2
    found = []
    for run in runs(off & np.isfinite(centre)):
        quarter = (run.stop - run.start) // 4
        middle = slice(run.start + quarter, run.stop - quarter)
        moves = min(float(np.ptp(np.mean(foot, axis=0)[middle], axis=0).max()) for foot in feet)
        if moves > _AT.stands_m:  # else it stands, as on a step
            found += _parabola(centre[run], legend.rate)
    return found


def _parabola(height: np.ndarray, rate: float) -> list[tuple[float, float]]:
    """Acceleration downwards and what the fit leaves open; nothing where that tells nothing."""
    if len(height) < _AT.fewest:
        return []
    half = (len(height) - 1) / (2 * rate)
    curve, residuals, *_ = np.polyfit(np.linspace(-1, 1, len(height)), height, 2, full=True)
    # What is left is the limbs' movement rather than noise: it counts as few independent values.
    apart = np.sqrt(residuals.sum() / len(height) * 45 / _AT.independent) / 2
    if -curve[0] < max(_AT.least_m, _AT.clear * 2 * apart):
        return []
    return [(-2 * curve[0] / half**2, 4 * apart / half**2)]
