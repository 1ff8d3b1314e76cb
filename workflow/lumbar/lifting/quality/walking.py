"""What walking tells of the clock: how many steps a second, and whether the person walks where he faces.

Of a lift nothing in markers alone does: in no phase the body falls freely, at twice the true rate its centre still
accelerates downwards by less than gravity, and a movement played backwards obeys the same mechanics.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality.body import rightward, trunk_axis
from lumbar.lifting.quality.sheet import Finding, Legend

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "walking")


@dataclass(frozen=True)
class Walk:
    """A straight walk."""

    distance: float
    """Metres."""
    steps: float
    """Per frame; NaN of fewer than three."""
    step_m: float
    facing: float
    """Mean cosine between where the person goes and where the body faces; NaN where no pair of markers tells."""

    def times(self, rate: float) -> float:
        """How many times too high a rate is by the steps of a second; 1 where it may be right, NaN where they do not tell."""
        found = self.steps * rate
        if found < _AT.slowest_hz and self.step_m > _AT.short_step_m:
            return found / _AT.usual_hz
        if found > _AT.fastest_hz and self.step_m < _AT.running_step_m:
            return found / _AT.usual_hz
        return 1.0 if _AT.slowest_hz <= found <= _AT.fastest_hz else np.nan


def walk(points: dict[str, np.ndarray], named: dict[str, str]) -> Walk | None:
    """The walk of a recording; None where the person stays, or the labels name no trunk or no foot on both sides."""
    at = {landmark: points[label] for label, landmark in named.items()}
    foot = next((name for name in ("ANKLE", "HEEL", "TOE") if {f"L_{name}", f"R_{name}"} <= at.keys()), None)
    trunk = trunk_axis(points, named)
    frames = np.flatnonzero(np.isfinite(trunk[0][:, 0])) if trunk else []
    if foot is None or trunk is None or len(frames) < _AT.instants:
        return None
    places = trunk[0][frames[np.linspace(0, len(frames) - 1, _AT.instants).astype(int)], :2]
    way = places[-1] - places[0]
    distance = float(np.linalg.norm(way))
    if distance < max(_AT.way_m, _AT.straight * np.linalg.norm(np.diff(places, axis=0), axis=1).sum()):
        return None
    sides, depths = rightward(points, named)
    right = np.nansum([np.zeros_like(trunk[0]), *sides.values(), *depths.values()], axis=0)
    forward = np.stack([-right[:, 1], right[:, 0]], axis=1)[frames]
    length = np.linalg.norm(forward, axis=1)
    facing = forward[length > 0] @ way / (length[length > 0] * distance)
    steps = _steps_per_frame((at[f"L_{foot}"] - at[f"R_{foot}"])[:, :2] @ way / distance)
    step_m = distance / (frames[-1] - frames[0]) / steps
    return Walk(distance, steps, step_m, float(facing.mean()) if len(facing) else np.nan)


def _steps_per_frame(ahead: np.ndarray) -> float:
    """How often one foot passes the other; `ahead` is by how much it is ahead of it, shape (n_frames,)."""
    frames = np.flatnonzero(np.isfinite(ahead))
    clear = frames[np.abs(ahead[frames]) > _AT.apart * np.std(ahead[frames])] if len(frames) else frames
    passed = clear[1:][np.diff(np.sign(ahead[clear])) != 0]
    return (len(passed) - 1) / (passed[-1] - passed[0]) if len(passed) >= _AT.fewest_steps else np.nan


def walking_findings(points: dict[str, np.ndarray], legend: Legend) -> list[Finding]:
    """Steps that nobody takes at the rate stated, and a walk backwards."""
    found = walk(points, legend.named)
    if found is None:
        return []
    findings = []
    if abs(found.times(legend.rate) - 1) > 0:
        words = {"steps": found.steps * legend.rate, "length": found.step_m, "rate": legend.rate}
        findings.append(legend.finding("steps", **words, factor=found.times(legend.rate)))
    if found.facing < _AT.backwards:
        findings.append(legend.finding("backwards", distance=found.distance))
    return findings
