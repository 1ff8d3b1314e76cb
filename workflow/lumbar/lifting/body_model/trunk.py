"""What the fitted body model says of a trial: markers, ends of the trunk's segments, centres of mass, pendulums.

The same functions as for the rules (`lumbar.lifting.movement`) turn its joints into centres of mass and pendulum states, once
with the most probable unknowns and once with each draw from their posterior: the spread of the results is their
uncertainty, with all that the unknowns share.
"""

from __future__ import annotations

import numpy as np

from lumbar.lifting.body_model.build import LEVEL
from lumbar.lifting.body_model.fit import BodyFit
from lumbar.lifting.body_model.structure import Unknowns
from lumbar.lifting.movement.joint_centres import unit
from lumbar.lifting.movement.trunk_points import L5_SHARE, MID_HIP, TrunkPoint, TrunkPoints
from lumbar.records.markers import MarkerRecording

RULE = "body model fitted to all markers"


def model_recording(fit: BodyFit, unknowns: Unknowns, name: str = "") -> MarkerRecording:
    """Every landmark and marker as the model has it, at the model's instants; skin is where it is on average."""
    model = fit.model
    structure = model.structure
    positions = {
        place: unknowns.place(structure, part, place)
        for part, place in structure.places
        if not place.startswith("HAND_") and (part, place) != LEVEL
    }
    positions |= dict(unknowns.points)
    return MarkerRecording(name, model.time, 1 / model.step, positions)


def model_points(fit: BodyFit, unknowns: Unknowns) -> TrunkPoints:
    """Ends of the trunk's segments, by the names of `lumbar.lifting.movement.trunk_points.SKIN_MARKERS`."""
    structure = fit.model.structure

    def place(part: str, name: str) -> np.ndarray:
        return unknowns.place(structure, part, name)

    top, bottom, lowest = place("thorax", "C7T1"), place("thorax", "T12L1"), place("pelvis", "L5S1")
    shift = unknowns.rotations["pelvis"] @ unknowns.constants[structure.of_place(*LEVEL)]
    left, right = (place("pelvis", f"{side}_HIP_CENTRE") for side in "LR")
    ends = {
        "C7T1": top,
        "T12L1": bottom,
        "L4L5": lowest + L5_SHARE * (bottom - lowest) + shift,
        "L5S1": lowest,
        MID_HIP: (left + right) / 2,
    }
    if "XIPHOID" in structure.names_of("thorax"):
        down = unit(bottom - top)
        along = np.sum((place("thorax", "XIPHOID") - top) * down, axis=1, keepdims=True)
        ends["XIPHOID_LEVEL"] = top + along * down
    points = {name: TrunkPoint(value, f"{name}: {RULE}", True, np.nan, ()) for name, value in ends.items()}
    return TrunkPoints(points, {}, unit(right - left))


def predicted_marker(fit: BodyFit, name: str) -> np.ndarray:
    """Where a marker is, shape (n, 3) in metres: what it showed, and the model's prediction where it did not.

    Across a gap the displacement of the skin that was last seen fades out and the next one in, as a Gauss-Markov process
    goes from one to the other on average.
    """
    measurement = next(m for m in fit.model.measurements if m.name == name and m.observed is not None)
    kept, residual = fit.kept[name], fit.residuals[name]
    predicted = measurement.residual(fit.model.structure, fit.best)[1].value
    phi, frames, seen = fit.noise[name].phi, np.arange(len(kept)), np.flatnonzero(kept)
    if not seen.size:
        return predicted
    before = seen[np.clip(np.searchsorted(seen, frames, side="right") - 1, 0, None)]
    after = seen[np.clip(np.searchsorted(seen, frames), None, len(seen) - 1)]
    back, ahead = np.abs(frames - before), np.abs(after - frames)
    inside = (before < frames) & (after > frames)
    whole = np.where(inside, 1 - phi ** (2.0 * (back + ahead)), 1.0)
    whole = np.maximum(whole, 1e-12)
    early = np.where(inside, (phi**back - phi ** (back + 2.0 * ahead)) / whole, phi**back)
    late = np.where(inside, (phi**ahead - phi ** (ahead + 2.0 * back)) / whole, 0.0)
    late = np.where(~inside & (before > frames), phi**ahead, late)
    bridge = early[:, None] * residual[before] + late[:, None] * residual[after]
    return np.where(kept[:, None], measurement.observed, predicted + bridge)
