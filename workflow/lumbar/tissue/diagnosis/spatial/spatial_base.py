"""The base of a tissue in space that records ask for: which one, of which symmetry, with principal axes where."""

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
from lumbar.tissue.models.bases import BASES
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
"""Bases of a fastened tool that are tried."""
CONTACT_KINDS = ("KB-contact", "KV-contact", "LE-contact")
"""Bases of a tool that is not fastened."""
_SPRINGS = 0.9
"""Squared error of a spring that is met, in those of a fastened one, up to which contact is tried."""
_DEPTHS = 40
"""Depths at which the surface is looked for."""
_STRONG = 0.25
"""Share of the largest squared force above which a force points into the surface."""
_ROOM = 50.0
"""Of twice the log-likelihood, by which fewer parameters may predict unseen records better than all of them do."""


def choose_base(
    experiment: Experiment,
    axes: tuple[str, ...],
    kinds: Sequence[str] = KINDS,
    forms: tuple[Form, ...] = (),
    acting: Sequence[float] = (),
) -> Candidate:
    """Fit the base and symmetry that all records together ask for, by likelihood and number of parameters.

    First which base, with any symmetric matrices; then which symmetry, from the principal axes of these. `forms` are those of
    effects beside it, `acting` their nonlinear parameters where the fits begin.
    """
    fits = {
        evaluate(_fit_symmetric(kind, experiment, axes, forms, acting), experiment): kind for kind in kinds
    }
    symmetric = reduce(partial(likelier, experiment), fits)
    fastened = _of_symmetry(fits[symmetric], symmetric, experiment, axes, forms)
    if kinds != KINDS or is_adequate(fastened, experiment):
        return fastened
    touched = at_plane(experiment, axes, forms, acting)
    return fastened if touched is None else likelier(experiment, fastened, touched)


def likelier(experiment: Experiment, first: Candidate, second: Candidate) -> Candidate:
    """The one of two models that the records speak for; where they do not, that of fewer parameters, or the first.

    More parameters are paid for by all records and by the training record alone, which they are fitted to: where a form is
    slightly wrong on unseen records, parameters that are hardly known happen to help there.
    """
    simple, rich = sorted((first, second), key=lambda item: item.parameters)
    cost = (rich.parameters - simple.parameters) * float(np.log(experiment.size))
    paid = not cost or likelihood_ratio(simple, rich, experiment) > cost
    return rich if paid and rich.score < simple.score - TIED else simple


def _of_symmetry(
    kind: str, symmetric: Candidate, experiment: Experiment, axes: tuple[str, ...], forms: tuple[Form, ...]
) -> Candidate:
    """The base of the symmetry that is likeliest, from the simplest on.

    No symmetry explains more than any symmetric matrices do, so that one is fitted only where these, with its number of
    parameters, would beat what was found.
    """
    fit, base = symmetric.fit, BASES[kind]
    matrices = matrices_of(fit.linear[: len(fit.structure.base.linear)], len(base.linear), len(axes))
    best: Candidate | None = None
    for item in _symmetries(kind, axes):
        more = len(item.linear) + len(item.nonlinear) - len(fit.structure.base.linear) - len(base.nonlinear)
        least = symmetric.score + more * float(np.log(experiment.size))
        if best is None or best.score > least - _ROOM:
            found = _refit(
                _nearest(_with_axes(item, matrices), fit, experiment), fit.nonlinear, experiment, forms
            )
            best = found if best is None else likelier(experiment, best, found)
    assert best is not None
    return best


def _nearest(bases: list[SpatialBase], fit: joint_fit.Fit, experiment: Experiment) -> SpatialBase:
    """The base of several that leaves least without a search, effects that act on the output aside."""
    if len(bases) == 1:
        return bases[0]
    own = len(bases[0].base.nonlinear)

    def left(base: SpatialBase) -> float:
        start = np.concatenate([fit.nonlinear[:own], np.ones(len(base.nonlinear) - own)])
        return joint_fit.fit_at(Structure(base.structural), experiment.training, start).squared_error

    return min(bases, key=left)


def _fit_symmetric(kind, experiment, axes, forms, acting) -> joint_fit.Fit:
    structure = Structure(symmetric_base(BASES[kind], axes), forms)
    if structure.is_linear:
        return joint_fit.fit_base(structure, experiment.training, acting)
    bare = joint_fit.fit_base(Structure(structure.base), experiment.training)
    return joint_fit.fit(structure, experiment.training, np.concatenate([bare.nonlinear, acting]))


def _symmetries(kind: str, axes: tuple[str, ...]) -> list[SpatialBase]:
    """The family of a base, from the simplest on; that in the plane has no axis to be alike about, nor one matrix two frames."""
    base, frame = BASES[kind], tuple(np.eye(len(axes)).ravel().tolist())
    frames = dict.fromkeys(Symmetry, (frame,))
    if len(base.linear) < 2:
        del frames[Symmetry.FULL]
    else:
        frames[Symmetry.FULL] = (frame,) * len(base.linear)
    if len(axes) < 3:
        del frames[Symmetry.TRANSVERSE]
    return [SpatialBase(base, symmetry, axes, given) for symmetry, given in frames.items()]


def _with_axes(base: SpatialBase, matrices: Sequence[np.ndarray]) -> list[SpatialBase]:
    """The base from the principal axes of matrices: of one axis apart from the others, from each of them."""
    if base.symmetry is Symmetry.ISOTROPIC:
        return [base]
    if base.symmetry is Symmetry.FULL:
        return [base.at([_axes_of(matrix) for matrix in matrices])]
    together = sum(matrix / max(np.linalg.norm(matrix), 1e-300) for matrix in matrices)
    frame = _axes_of(together)
    if base.symmetry is Symmetry.ORTHOTROPIC:
        return [base.at([frame])]
    return [
        base.at([_right_handed(frame[:, [first, *others]])])
        for first, *others in list(permutations(range(3)))[::2]
    ]


def _axes_of(matrix: np.ndarray) -> np.ndarray:
    return _right_handed(np.linalg.eigh(matrix)[1][:, ::-1])


def _right_handed(frame: np.ndarray) -> np.ndarray:
    return frame * np.where(np.arange(len(frame)) == 0, np.sign(np.linalg.det(frame)), 1.0)


def _refit(
    base: SpatialBase, start: np.ndarray, experiment: Experiment, forms: tuple[Form, ...]
) -> Candidate:
    own = len(base.base.nonlinear)
    turns = np.ones(len(base.nonlinear) - own)
    return refit(
        Structure(base.structural, forms), np.concatenate([start[:own], turns, start[own:]]), experiment
    )


def held(model: Candidate, experiment: Experiment) -> Candidate:
    """Fix the principal axes of a model for a search of effects."""
    return _exchanged(model, experiment, free=False)


def freed(model: Candidate, experiment: Experiment) -> Candidate:
    """Fit a model together with its principal axes."""
    return _exchanged(model, experiment, free=True)


def _exchanged(model: Candidate, experiment: Experiment, free: bool) -> Candidate:
    structure = model.fit.structure
    spatial, count = structure.base.spatial, len(structure.base.nonlinear)
    if isinstance(spatial, PlaneContact):
        return model  # the plane is fitted with every effect
    base = spatial.at(spatial.frames_at(model.fit.nonlinear[:count]), free)
    start = np.concatenate([model.fit.nonlinear[: len(spatial.base.nonlinear)], model.fit.nonlinear[count:]])
    return _refit(base, start, experiment, structure.forms)


def at_plane(
    experiment: Experiment, axes: tuple[str, ...], forms: tuple[Form, ...], acting: Sequence[float]
) -> Candidate | None:
    """Fit the best base that meets the tissue at a plane, with forms of effects.

    Return None if a spring that is met there fits no better than one that is fastened, of any symmetry.
    """
    training = experiment.training
    fastened = joint_fit.fit_at(Structure(symmetric_base(BASES["LE"], axes)), training, np.zeros(0))
    started = _nearest_spring(training, axes)
    if started is None:
        return None
    spring = joint_fit.fit(
        Structure(started.structural), training, joint_fit.combinations(started.nonlinear, training)[0]
    )
    if spring.squared_error > _SPRINGS * fastened.squared_error:
        return None
    started = started.held(spring.nonlinear)
    found = []
    for name in CONTACT_KINDS:
        plane = replace(started, base=BASES[name])
        starts = joint_fit.combinations(plane.nonlinear, training)
        fits = [joint_fit.fit_at(Structure(plane.structural), training, start) for start in starts]
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
        start = joint_fit.combinations(plane.nonlinear, training)[0]
        return joint_fit.fit_at(Structure(plane.structural), training, start).squared_error

    depths = (along.min() + reach * np.linspace(0.02, 0.98, _DEPTHS)).tolist()
    return PlaneContact(BASES["LE-contact"], axes, frames, min(depths, key=left), reach)
