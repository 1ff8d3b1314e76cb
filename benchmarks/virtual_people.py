"""Virtual people for the benchmark of the body model: the synthetic lifter's movement on bodies that differ.

Every person has joint centres that scatter by the regressions' errors, markers put beside their bones, and skin that moves.
What scatters how much stands here, or is what the model declares (`JOINTS`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.lifting.body_model import anatomy
from lumbar.lifting.body_model.structure import weighted_poses
from lumbar.lifting.movement.joint_centres import L5_SHARE
from lumbar.twin.lifting_recordings import true_movement

JOINTS = ("declared", "lifter")
"""Joints scatter about the regressions on the lifter's landmarks as the model declares, or about the lifter's own, which lie
off the regressions by up to 13 mm in everybody alike."""
JOINT_SD_M = {"C7T1": 0.0115, "T12L1": 0.0115, "L4L5": 0.0095, "MID_HIP": 0.0087}
PLACEMENT_SD_M, SKIN_SD_M, SKIN_S, NOISE_SD_M = 0.006, 0.005, 0.5, 0.001
LOOSE_SD_M = {"SHOULDER": 0.012, "HIP": 0.010}
THORAX = ("C7", "MANUBRIUM", "XIPHOID", "T8", "L_SHOULDER", "R_SHOULDER")
PELVIS = ("L_ASIS", "R_ASIS", "L_PSIS", "R_PSIS", "SACRUM", "L_HIP", "R_HIP")
ON = {"C7T1": "thorax", "T12L1": "thorax", "L4L5": "pelvis", "MID_HIP": "pelvis"}
SEGMENTS = {
    "thorax": ("C7T1", "T12L1", 0.82),
    "abdomen": ("T12L1", "L4L5", 0.44),
    "pelvis": ("L4L5", "MID_HIP", 0.105),
}


@dataclass(frozen=True)
class VirtualTrial:
    """Markers as seen, and the truth behind them."""

    time: np.ndarray
    rate: float
    markers: dict[str, np.ndarray]
    centres: dict[str, np.ndarray]
    pivots: dict[str, np.ndarray]
    events: object
    person: object
    box_mass: float
    corrupted: slice


def virtual_trial(
    settings,
    seed: int,
    what: str = "complete",
    noise_sd: float = NOISE_SD_M,
    joints_of: str = "lifter",
    lift: str | None = None,
) -> VirtualTrial:
    """One lift of one virtual person, the same body in each of the lifts that are named.

    `what` is complete, gaps, exchanged or no_T12, `joints_of` one of `JOINTS`.
    """
    rng = body = np.random.default_rng([seed, 12])
    names = sorted(settings.lifts)
    name = lift or names[seed % len(names)]
    if lift:
        rng = np.random.default_rng([seed, 13, names.index(lift)])
    movement = true_movement(settings, name)
    lift, rate = settings.lifts[name], settings.rate_Hz
    axes = {part: _axes(movement.markers, names) for part, names in (("thorax", THORAX), ("pelvis", PELVIS))}
    joints = (_declared_joints if joints_of == JOINTS[0] else _lifter_joints)(movement, axes, body)
    markers = {}
    for label, values in movement.markers.items():
        part = "pelvis" if label in (*PELVIS, "L5") else "thorax" if label in (*THORAX, "T12") else None
        noise = rng.normal(0, noise_sd, values.shape)
        if part:
            loose = next((sd for word, sd in LOOSE_SD_M.items() if label.endswith(word)), SKIN_SD_M)
            noise += axes[part] @ body.normal(0, PLACEMENT_SD_M, 3) + loose * _skin(rng, len(values), rate)
        markers[label] = values + noise
    start, stop = lift.events_s.deposit_start, lift.events_s.release
    corrupted = slice(0, 0)
    if what == "gaps":
        length = rng.uniform(0.5, 1.0)
        at = rng.uniform(start, max(start, stop - length))
        corrupted = slice(int(at * rate), int((at + length) * rate))
        for label in ("C7", "T12", "L5"):
            markers[label][corrupted] = np.nan
    elif what == "exchanged":
        at = rng.uniform(start, stop - 0.4)
        corrupted = slice(int(at * rate), int((at + 0.4) * rate))
        markers["C7"][corrupted], markers["T12"][corrupted] = (
            markers["T12"][corrupted].copy(), markers["C7"][corrupted].copy()
        )  # fmt: skip
    elif what == "no_T12":
        del markers["T12"], markers["L5"]
    centres = {
        com: joints[top] + share * (joints[low] - joints[top]) for com, (top, low, share) in SEGMENTS.items()
    }
    ankles = (movement.markers["L_ANKLE"] + movement.markers["R_ANKLE"]) / 2
    pivots = {"mid_ankle": ankles, "hip": joints["MID_HIP"]}
    person = settings.people[lift.person]
    return VirtualTrial(
        movement.time, rate, markers, centres, pivots, lift.events_s, person, lift.box_mass_kg, corrupted
    )


def _lifter_joints(movement, axes, rng) -> dict[str, np.ndarray]:
    return {
        joint: values + axes[ON[joint]] @ rng.normal(0, JOINT_SD_M[joint], 3)
        for joint, values in movement.joint_centres.items()
    }


def _declared_joints(movement, axes, rng) -> dict[str, np.ndarray]:
    """Regressions on the landmarks' mean places in their part, and the errors of `anatomy`."""
    joints = {}
    for part, origin in (("thorax", "C7T1"), ("pelvis", "MID_HIP")):
        start = movement.joint_centres[origin]
        places = {
            name: np.einsum("nji,nj->ni", axes[part], movement.markers[name] - start).mean(axis=0)
            for name in anatomy.NEEDED[part]
        }
        for joint, place in anatomy.joints_of(part, places, "male").items():
            off = rng.normal(0, anatomy.JOINT_SD_M[joint], 3)
            joints[joint] = start + axes[part] @ (place + off)
    joints["MID_HIP"] = (joints["L_HIP_CENTRE"] + joints["R_HIP_CENTRE"]) / 2
    lordosis = axes["pelvis"] @ rng.normal(0, anatomy.LEVEL_SD_M, 3)
    joints["L4L5"] = joints["L5S1"] + L5_SHARE * (joints["T12L1"] - joints["L5S1"]) + lordosis
    return joints


def _axes(markers, names) -> np.ndarray:
    """Axes of a segment, shape (n, 3, 3), from its first frame: that of a person who stands."""
    frames = np.stack([markers[name] for name in names], axis=1)
    return weighted_poses(frames[0], frames, np.ones(frames.shape[:2]))[0]


def _skin(rng, n: int, rate: float) -> np.ndarray:
    """A Gauss-Markov process of unit variance, shape (n, 3)."""
    phi = np.exp(-1 / (rate * SKIN_S))
    values = rng.standard_normal((n, 3))
    for index in range(1, n):
        values[index] = phi * values[index - 1] + np.sqrt(1 - phi**2) * values[index]
    return values
