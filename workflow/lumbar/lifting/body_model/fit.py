"""Fitting the body model to a trial: the most probable trajectories and constants, and the information about them.

Gauss-Newton steps on all unknowns at once. First every residual counts as independent and by Student's t, so that
exchanged or displaced markers pull little; then outliers are left out, each marker's noise and its correlation in time
are taken from the residuals, and the rest is fitted with them. Movement is smooth by a prior of white acceleration,
whose intensity follows from the trial's own accelerations.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve

from lumbar.lifting.body_model import anatomy
from lumbar.lifting.body_model.build import LEVEL, TrialModel
from lumbar.lifting.body_model.information import ArrowFactor, Information, Noise
from lumbar.lifting.body_model.structure import Structure, Unknowns, logarithm
from lumbar.lifting.movement.joint_centres import L5_SHARE, MID_HIP, TrunkPoint, TrunkPoints, unit
from lumbar.records.markers import MarkerRecording

ROBUST_STEPS, STEPS, ROUNDS = 6, 4, 2
SMALLEST_STEP = 1e-4
"""Metres and radians: smaller steps change nothing."""
ACCELERATION_S = 0.05
"""Time over which accelerations of a body are alike: their intensity is twice the variance times this."""
AVERAGED_S = 0.1
LEAST_INTENSITY = {"m": 0.02, "rad": 0.2}
FIRST_INTENSITY = {"m": 2.0, "rad": 10.0}
"""Intensity of white acceleration in m²/s³ and rad²/s³: least, and before the trial tells."""
RIDGE = 1e-6
TOGETHER = 100
"""Draws made at once: memory."""


@dataclass(frozen=True)
class BodyFit:
    """A fitted model."""

    model: TrialModel
    best: Unknowns
    """The most probable ones."""
    factor: ArrowFactor
    """Of the information about states and constants."""
    noise: dict[str, Noise]
    """By measurement."""
    kept: dict[str, np.ndarray]
    """Shape (n,): frames of each measurement that count."""
    residuals: dict[str, np.ndarray]
    """Shape (n, m): measured less predicted; NaN where nothing was seen."""

    def draws(self, count: int, seed: int) -> Iterator[Unknowns]:
        """Draw unknowns from their posterior distribution."""
        structure, rng = self.model.structure, np.random.default_rng(seed)
        for at in range(0, count, TOGETHER):
            size = min(TOGETHER, count - at)
            states, constants = self.factor.draws(size, rng)
            states = states.reshape(len(self.model.time), structure.size, size)
            yield from (self.best.advance(structure, states[..., i], constants[:, i]) for i in range(size))


def fit(model: TrialModel) -> BodyFit:
    """Fit a model to its trial.

    Raises
    ------
    NumericalError
        If something is neither seen nor has a prior.
    """
    measurements, structure = model.measurements, model.structure
    unknowns = model.guess
    intensity = {name: FIRST_INTENSITY[unit] for name, _, unit in _movements(structure)}
    noise = {m.name: Noise(m.sd) for m in measurements}
    for _ in range(ROBUST_STEPS):
        found = _residuals(model, unknowns)
        weights = {m.name: m.robust_weight(found[m.name]) for m in measurements}
        unknowns, size, _ = _gauss_newton_step(model, unknowns, noise, weights, intensity)
        if size < 10 * SMALLEST_STEP:
            break
    kept = {m.name: m.seen for m in measurements}
    for _ in range(ROUNDS):
        found = _residuals(model, unknowns)
        for m in measurements:
            if m.observed is not None and m.estimated:
                usual = np.linalg.norm(found[m.name][m.seen], axis=1)
                sd = max(m.sd, float(np.median(usual)) / 1.54)
                kept[m.name] = m.inliers(found[m.name], sd)
        noise = _noise(model, found, kept)
        intensity = _intensities(model, unknowns)
        weights = {name: frames.astype(float) for name, frames in kept.items()}
        for _ in range(STEPS):
            unknowns, size, factor = _gauss_newton_step(model, unknowns, noise, weights, intensity)
            if size < SMALLEST_STEP:
                break
    return BodyFit(model, unknowns, factor, noise, kept, _residuals(model, unknowns))


def _residuals(model: TrialModel, unknowns: Unknowns) -> dict[str, np.ndarray]:
    return {m.name: m.residual(model.structure, unknowns)[0] for m in model.measurements}


def _movements(structure: Structure):
    """Name, columns and unit of everything that moves."""
    for part in structure.parts:
        where = structure.of_part(part)
        yield f"{part} shift", slice(where.start, where.start + 3), "m"
        yield f"{part} turning", slice(where.start + 3, where.stop), "rad"
    for point in structure.points:
        yield point, structure.of_point(point), "m"


def _bends(structure: Structure, unknowns: Unknowns) -> dict[str, np.ndarray]:
    """Second differences of everything that moves, shape (n - 2, 3)."""
    bends = {}
    for part in structure.parts:
        turn = unknowns.rotations[part]
        bends[f"{part} shift"] = np.diff(unknowns.shifts[part], 2, axis=0)
        bends[f"{part} turning"] = np.diff(logarithm(turn[1:] @ np.swapaxes(turn[:-1], 1, 2)), axis=0)
    return bends | {name: np.diff(unknowns.points[name], 2, axis=0) for name in structure.points}


def _intensities(model: TrialModel, unknowns: Unknowns) -> dict[str, float]:
    """Intensity of white acceleration from the accelerations that the present estimate has.

    They are means over `AVERAGED_S`: what an estimate that began too lively follows of the markers' noise would confirm itself.
    """
    width = max(1, round(AVERAGED_S / model.step))
    window = np.full((width, 1), 1 / width)
    bends = {
        name: fftconvolve(bend, window, mode="valid", axes=0) if len(bend) > width else bend
        for name, bend in _bends(model.structure, unknowns).items()
    }
    return {
        name: max(
            LEAST_INTENSITY[unit], 2 * ACCELERATION_S * float(np.mean(bends[name] ** 2)) / model.step**4
        )
        for name, _, unit in _movements(model.structure)
    }


def _noise(model: TrialModel, residuals, kept) -> dict[str, Noise]:
    """Noise of every measurement; a part's markers share what its poses follow of them."""
    values: dict[str, int] = {}
    for m in model.measurements:
        if m.second is None and m.first[0] is not None:
            values[m.first[0]] = values.get(m.first[0], 0) + 3
    noise = {}
    for m in model.measurements:
        count = values.get(m.first[0], 0) if m.second is None else 0
        freedom = max(0.25, (count - 6) / count) if count else 1.0
        noise[m.name] = m.noise(residuals[m.name], kept[m.name], model.step, freedom)
    return noise


def _gauss_newton_step(
    model: TrialModel, unknowns: Unknowns, noise, weights, intensity
) -> tuple[Unknowns, float, ArrowFactor]:
    """One Gauss-Newton step: the new unknowns, the largest change of a state, and the information's factor."""
    structure = model.structure
    n, size = len(model.time), structure.size
    information = Information(n, size, structure.constants)
    for m in model.measurements:
        residual, predicted = m.residual(structure, unknowns)
        information.add(residual, predicted.states, predicted.constants, noise[m.name], weights[m.name])
    for (name, columns, _), bend in zip(
        _movements(structure), _bends(structure, unknowns).values(), strict=True
    ):
        information.add_smoothness(columns, bend, 1 / (intensity[name] * model.step**3))
    for prior in model.priors:
        information.add_prior(
            prior.columns, prior.root, prior.root @ (prior.mean - unknowns.constants[prior.columns])
        )
    for part in anatomy.TEMPLATES:
        _add_joints(information, model, unknowns, part)
    axis = np.arange(size)
    information.same[:, axis, axis] += RIDGE
    factor = information.factor()
    states, constants = factor.solve(information.states.ravel(), information.constants)
    states = states.reshape(n, size)
    return unknowns.advance(structure, states, constants), float(np.abs(states).max()), factor


def _add_joints(information: Information, model: TrialModel, unknowns: Unknowns, part: str) -> None:
    """Joint centres lie where the regressions put them, but for the regressions' error."""
    structure = model.structure
    landmarks = {name: unknowns.constants[structure.of_place(part, name)] for name in anatomy.NEEDED[part]}
    joints = anatomy.joints_of(part, landmarks, model.sex)
    difference = 1e-5
    for joint, present in joints.items():
        where = structure.of_place(part, joint)
        columns, root = list(range(where.start, where.stop)), [np.eye(3)]
        for name, place in landmarks.items():
            slopes = []
            for axis in np.eye(3):
                moved = landmarks | {name: place + difference * axis}
                slopes.append((anatomy.joints_of(part, moved, model.sex)[joint] - present) / difference)
            at = structure.of_place(part, name)
            columns += range(at.start, at.stop)
            root.append(-np.array(slopes).T)
        # Markers beside their bones move the regression's result too.
        spread = np.concatenate(root[1:], axis=1)
        covariance = (
            anatomy.JOINT_SD_M[joint] ** 2 * np.eye(3) + anatomy.PLACEMENT_SD_M**2 * spread @ spread.T
        )
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        residual = whiten @ (present - unknowns.constants[where])
        information.add_prior(np.array(columns), whiten @ np.concatenate(root, axis=1), residual)


RULE = "body model fitted to all markers"


def model_recording(fit: BodyFit, unknowns: Unknowns) -> MarkerRecording:
    """Every landmark and marker as the model has it, at the model's instants; skin is where it is on average."""
    model = fit.model
    structure = model.structure
    positions = {
        place: unknowns.place(structure, part, place)
        for part, place in structure.places
        if not place.startswith("HAND_") and (part, place) != LEVEL
    }
    positions |= dict(unknowns.points)
    return MarkerRecording("", model.time, 1 / model.step, positions)


def model_points(fit: BodyFit, unknowns: Unknowns) -> TrunkPoints:
    """Ends of the trunk's segments, by the names of `lumbar.lifting.movement.joint_centres.SKIN_MARKERS`."""
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
    return TrunkPoints(points, {}, unit(right - left), {"L_HIP": left, "R_HIP": right})
