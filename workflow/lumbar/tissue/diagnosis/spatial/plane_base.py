"""The base of a tool that meets the tissue at a plane, from where its forces point and where they begin."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import combinations, fit, fit_at
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.selection.candidate import Candidate, refit
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.form import Form
from lumbar.tissue.models.plane_contact import PlaneContact, frame_of
from lumbar.tissue.models.structure import Structure
from lumbar.tissue.models.symmetry import symmetric_base

KINDS = ("KB-contact", "KV-contact", "LE-contact")
"""Bases of a tool that is not fastened."""
SPRINGS = 0.9
"""Squared error of a spring that is met, in those of a fastened one, up to which contact is tried."""
_DEPTHS = 40
"""Depths at which the surface is looked for."""
_STRONG = 0.25
"""Share of the largest squared force from which on a force points into the surface."""


def at_plane(
    experiment: Experiment, axes: tuple[str, ...], forms: tuple[Form, ...], acting: Sequence[float]
) -> Candidate | None:
    """The best base that meets the tissue at a plane, beside forms of effects.

    None where a spring that is met there leaves no less than one that is fastened, of any symmetry.
    """
    training = experiment.training
    fastened = fit_at(Structure(symmetric_base(BASES["LE"], axes)), training, np.zeros(0))
    started = _nearest_spring(training, axes)
    if started is None:
        return None
    spring = fit(Structure(started.structural), training, combinations(started.nonlinear, training)[0])
    if spring.squared_error > SPRINGS * fastened.squared_error:
        return None
    started = started.held(spring.nonlinear)
    found = []
    for name in KINDS:
        plane = replace(started, base=BASES[name])
        starts = combinations(plane.nonlinear, training)
        fits = [fit_at(Structure(plane.structural), training, start) for start in starts]
        start = min(fits, key=lambda item: item.squared_error).nonlinear
        found.append(refit(Structure(plane.structural, forms), np.concatenate([start, acting]), experiment))
    return min(found, key=lambda item: item.score)


def _nearest_spring(training: FitData, axes: tuple[str, ...]) -> PlaneContact | None:
    """A spring across the mean direction of strong forces, at the depth that leaves least."""
    records = training.records
    position, force = (
        np.concatenate([np.reshape(signal, (len(axes), -1)) for signal in signals], axis=1)
        for signals in ([item.motion.position for item in records], [item.force for item in records])
    )
    free = np.median(force, axis=1, keepdims=True)
    squares = np.sum((force - free) ** 2, axis=0)
    normal = (force - free)[:, squares > _STRONG * squares.max()].mean(axis=1)
    if not np.any(normal):
        return None
    normal /= np.linalg.norm(normal)
    along = normal @ position
    reach, frames = float(np.ptp(along)), (tuple(frame_of(normal).ravel().tolist()),)

    def left(depth: float) -> float:
        plane = PlaneContact(BASES["LE-contact"], axes, frames, depth, reach)
        start = combinations(plane.nonlinear, training)[0]
        return fit_at(Structure(plane.structural), training, start).squared_error

    depths = (along.min() + reach * np.linspace(0.02, 0.98, _DEPTHS)).tolist()
    return PlaneContact(BASES["LE-contact"], axes, frames, min(depths, key=left), reach)
