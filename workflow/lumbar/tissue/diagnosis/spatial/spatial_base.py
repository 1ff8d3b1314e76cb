"""Choice of the base model of a tissue in space: its equation, its symmetry and its principal axes."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial, reduce
from itertools import permutations

import numpy as np

from lumbar.tissue.diagnosis.fitting import joint_fit
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.selection.candidate import (
    Candidate,
    evaluate,
    is_adequate,
    likelihood_ratio,
    refit,
)
from lumbar.tissue.diagnosis.selection.thresholds import TIED
from lumbar.tissue.models.bases import BASES, Base
from lumbar.tissue.models.form import Form
from lumbar.tissue.models.space import (
    PlaneContact,
    SpatialBase,
    Symmetry,
    frame_of,
    matrices_of,
    symmetric_base,
)
from lumbar.tissue.models.structure import Structure

KINDS = ("KB", "KV", "Maxwell", "LE")
"""Bases that are tried for a tool that is fastened to the tissue."""
_CONTACT_KINDS = ("KB-contact", "KV-contact", "LE-contact")
"""Bases that are tried for a tool that is not fastened."""
_MAX_CONTACT_ERROR_RATIO = 0.9
"""Largest ratio of the squared errors of a spring with contact and a fastened spring for which contact is tried."""
_SURFACE_DEPTHS = 40
"""Number of depths of the surface that are tried."""
_STRONG_FORCE = 0.25
"""Share of the largest squared force above which a force is assumed to be normal to the surface."""
_LIKELIHOOD_MARGIN = 50.0
"""Largest advantage of a symmetry over general symmetric matrices on unseen records, in twice the log-likelihood."""


def choose_base(
    experiment: Experiment,
    kinds: Sequence[str] = KINDS,
    forms: tuple[Form, ...] = (),
    acting: Sequence[float] = (),
) -> Candidate:
    """Choose base and symmetry by the likelihood of all records and the number of parameters.

    The base is chosen with general symmetric matrices; then the symmetry is chosen, starting from their principal axes.

    Parameters
    ----------
    experiment : Experiment
        Prepared records of several axes.
    kinds : sequence of str
        Names of the bases to try.
    forms : tuple of Form
        Forms of effects that are fitted together with the base.
    acting : sequence of float
        Starting values of the nonlinear parameters of `forms`.
    """
    fits = {}
    for kind in kinds:
        structure = Structure(symmetric_base(BASES[kind], experiment.records[0].axes), forms)
        if structure.is_linear:
            fit = joint_fit.fit_base(structure, experiment.training, acting)
        else:
            bare = joint_fit.fit_base(Structure(structure.base), experiment.training)
            fit = joint_fit.fit(structure, experiment.training, np.concatenate([bare.nonlinear, acting]))
        fits[evaluate(fit, experiment)] = kind
    symmetric = reduce(partial(choose_likelier, experiment), fits)
    fastened = _choose_symmetry(BASES[fits[symmetric]], symmetric, experiment)
    if kinds != KINDS or is_adequate(fastened, experiment):
        return fastened
    contact = _fit_plane_contact(experiment, forms, acting)
    return fastened if contact is None else choose_likelier(experiment, fastened, contact)


def choose_likelier(experiment: Experiment, first: Candidate, second: Candidate) -> Candidate:
    """Return the model that the records support; if they do not decide, the model with fewer parameters, or the first.

    Additional parameters must be worthwhile for all records together and for the training record. If a form is slightly
    wrong, parameters that the training record hardly determines can reduce the unseen error by chance.
    """
    simple, rich = sorted((first, second), key=lambda item: item.parameters)
    cost = (rich.parameters - simple.parameters) * float(np.log(experiment.size))
    paid = not cost or likelihood_ratio(simple, rich, experiment) > cost
    return rich if paid and rich.score < simple.score - TIED else simple


def _choose_symmetry(base: Base, symmetric: Candidate, experiment: Experiment) -> Candidate:
    """Return the base with the likeliest symmetry; the simplest one is fitted first."""
    fit, axes = symmetric.fit, experiment.records[0].axes
    count, forms = len(fit.structure.base.linear), fit.structure.forms
    matrices = matrices_of(fit.linear[:count], len(base.linear), len(axes))
    own = len(base.nonlinear)
    best: Candidate | None = None
    for symmetry in Symmetry:
        # A plane has no direction across an axis, and a single matrix no second frame.
        if (symmetry is Symmetry.TRANSVERSE and len(axes) < 3) or (
            symmetry is Symmetry.FULL and len(base.linear) < 2
        ):
            continue
        bases = _bases_on_axes(base, symmetry, axes, matrices)
        # No symmetry fits better than any symmetric matrices: skip it if these, with its number of parameters, would lose.
        more = len(bases[0].linear) + len(bases[0].nonlinear) - count - own
        least = symmetric.score + more * float(np.log(experiment.size))
        if best is None or best.score > least - _LIKELIHOOD_MARGIN:
            if len(bases) > 1:
                start = np.concatenate([fit.nonlinear[:own], np.ones(len(bases[0].nonlinear) - own)])
                structures = [Structure(item.structural) for item in bases]
                fits = [joint_fit.fit_at(item, experiment.training, start) for item in structures]
                bases = [bases[int(np.argmin([item.squared_error for item in fits]))]]
            fitted = _refit(bases[0], fit.nonlinear, experiment, forms)
            best = fitted if best is None else choose_likelier(experiment, best, fitted)
    assert best is not None
    return best


def _bases_on_axes(
    base: Base, symmetry: Symmetry, axes: tuple[str, ...], matrices: Sequence[np.ndarray]
) -> list[SpatialBase]:
    """Return bases with the principal axes of matrices; any of three axes may be the axis of transverse isotropy."""
    options = [[np.eye(len(axes))]]
    if symmetry is Symmetry.FULL:
        options = [[_principal_frame(matrix) for matrix in matrices]]
    elif symmetry is not Symmetry.ISOTROPIC:
        frame = _principal_frame(sum(matrix / max(np.linalg.norm(matrix), 1e-300) for matrix in matrices))
        options = [[frame]]
        if symmetry is Symmetry.TRANSVERSE:
            orders = list(permutations(range(3)))[::2]
            options = [[_make_right_handed(frame[:, order])] for order in orders]
    return [
        SpatialBase(base, symmetry, axes, tuple(tuple(frame.ravel().tolist()) for frame in frames))
        for frames in options
    ]


def _principal_frame(matrix: np.ndarray) -> np.ndarray:
    return _make_right_handed(np.linalg.eigh(matrix)[1][:, ::-1])


def _make_right_handed(frame: np.ndarray) -> np.ndarray:
    return frame * np.where(np.arange(len(frame)) == 0, np.sign(np.linalg.det(frame)), 1.0)


def _refit(
    base: SpatialBase, start: np.ndarray, experiment: Experiment, forms: tuple[Form, ...]
) -> Candidate:
    """Fit a base with forms; `start` has the nonlinear parameters without rotations, which start at 0."""
    own = len(base.base.nonlinear)
    start = np.concatenate([start[:own], np.ones(len(base.nonlinear) - own), start[own:]])
    return refit(Structure(base.structural, forms), start, experiment)


def refit_axes(model: Candidate, experiment: Experiment, free: bool) -> Candidate:
    """Fit a model again, with its principal axes free or fixed; a contact plane is always fitted."""
    structure = model.fit.structure
    spatial, count = structure.base.spatial, len(structure.base.nonlinear)
    if isinstance(spatial, PlaneContact):
        return model
    base = spatial.replace_frames(spatial.frames_at(model.fit.nonlinear[:count]), free)
    start = np.concatenate([model.fit.nonlinear[: len(spatial.base.nonlinear)], model.fit.nonlinear[count:]])
    return _refit(base, start, experiment, structure.forms)


def _fit_plane_contact(
    experiment: Experiment, forms: tuple[Form, ...], acting: Sequence[float]
) -> Candidate | None:
    """Fit the best base with contact at a plane; None if a spring with contact fits no better than a fastened spring."""
    training, axes = experiment.training, experiment.records[0].axes
    fastened = joint_fit.fit_at(Structure(symmetric_base(BASES["LE"], axes)), training, np.zeros(0))
    plane = _find_plane(training, axes)
    if plane is None:
        return None
    start = joint_fit.combinations(plane.nonlinear, training)[0]
    spring = joint_fit.fit(Structure(plane.structural), training, start)
    if spring.squared_error > _MAX_CONTACT_ERROR_RATIO * fastened.squared_error:
        return None
    plane = plane.freeze(spring.nonlinear)
    candidates = []
    for name in _CONTACT_KINDS:
        contact = replace(plane, base=BASES[name])
        starts = joint_fit.combinations(contact.nonlinear, training)
        fits = [joint_fit.fit_at(Structure(contact.structural), training, start) for start in starts]
        start = min(fits, key=lambda item: item.squared_error).nonlinear
        structure = Structure(contact.structural, forms)
        candidates.append(refit(structure, np.concatenate([start, acting]), experiment))
    return min(candidates, key=lambda item: item.score)


def _find_plane(training: FitData, axes: tuple[str, ...]) -> PlaneContact | None:
    """Return a spring with contact at the plane normal to the mean strong force, at the depth with the smallest error."""
    records = training.records
    position, force = (
        np.concatenate([np.reshape(signal, (len(axes), -1)) for signal in signals], axis=1)
        for signals in ([item.motion.position for item in records], [item.force for item in records])
    )
    free = np.median(force, axis=1, keepdims=True)
    squares = np.sum((force - free) ** 2, axis=0)
    normal = (force - free)[:, squares > _STRONG_FORCE * squares.max()].mean(axis=1)
    if not np.any(normal):
        return None
    normal /= np.linalg.norm(normal)
    along = normal @ position
    span, frames = float(np.ptp(along)), (tuple(frame_of(normal).ravel().tolist()),)

    def squared_error(depth: float) -> float:
        plane = PlaneContact(BASES["LE-contact"], axes, frames, depth, span)
        start = joint_fit.combinations(plane.nonlinear, training)[0]
        return joint_fit.fit_at(Structure(plane.structural), training, start).squared_error

    depths = (along.min() + span * np.linspace(0.02, 0.98, _SURFACE_DEPTHS)).tolist()
    return PlaneContact(BASES["LE-contact"], axes, frames, min(depths, key=squared_error), span)
