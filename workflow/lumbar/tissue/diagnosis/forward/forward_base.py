"""Bases of forward records: which one the data ask for, fitted turned round and then by simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import fit, fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.forward.carried import carried, fitted_base, response_of
from lumbar.tissue.diagnosis.forward.forward_data import forward_experiment
from lumbar.tissue.diagnosis.forward.forward_fit import EVALUATIONS, fit_forward
from lumbar.tissue.diagnosis.selection.forward_selection import Candidate, evaluate
from lumbar.tissue.models.bases import BASES, CHOSEN_BY_DATA, Base
from lumbar.tissue.models.forward_structure import ForwardStructure
from lumbar.tissue.models.measured_motion import with_measured_motion
from lumbar.tissue.models.structure import Structure

FORWARD_BASES = ("KV-mass", "KB-mass", "KV", "KB", "LE")
"""Bases that are tried where the force is the input."""
_SIMULATED = 2
"""Bases, those that fit best turned round, that are simulated."""
_LONG = 6000
"""Samples of every record on which a search is made."""


def prepared_forward(records: list[Record], settings: DiagnosisSettings) -> Experiment:
    """Forward records ready for a diagnosis.

    Raises
    ------
    InputError
        As `prepare`; for records of one session.
    """
    if settings.session:
        raise InputError(
            "records of one session (improvement.session) are not supported with the force as input (improvement.forward): each "
            "begins in the state that its own motion tells; leave session out"
        )
    seen = [with_measured_motion(record) for record in records]
    return replace(forward_experiment(settings.prepared(seen)), records=tuple(seen))


def shortened(experiment: Experiment) -> Experiment:
    """The experiment with no more of every record than a search needs; the same one where none is longer."""

    def short(data: FitData) -> FitData:
        return data.split(_LONG / data.size)[0] if data.size > _LONG else data

    training, tests = short(experiment.training), [short(item) for item in experiment.tests]
    kept = [training, *tests]
    if all(one is other for one, other in zip(kept, [experiment.training, *experiment.tests], strict=True)):
        return experiment
    return replace(experiment, training=training, tests=tests)


def simulated(
    experiment: Experiment,
    structure: ForwardStructure,
    linear: np.ndarray,
    nonlinear: np.ndarray,
    zero: float = 0.0,
    evaluations: int = EVALUATIONS,
) -> Candidate:
    """Fit a structure by the error of its simulation; arguments as of `fit_forward`."""
    found = fit_forward(structure, experiment.training, linear, nonlinear, zero, evaluations)
    return evaluate(found, experiment)


def chosen_base(experiment: Experiment, name: str) -> Candidate:
    """The base of a name, or the one of `FORWARD_BASES` that explains all records best, fitted by simulation.

    Raises
    ------
    InputError
        For a base with contact.
    """
    if name != CHOSEN_BY_DATA:
        if BASES[name].contact or BASES[name].system != "tissue":
            known = ", ".join(FORWARD_BASES)
            raise InputError(f"base {name}: records with the force as input know the bases {known}")
        return simulated_base(experiment, BASES[name])
    turned = [fitted_base(experiment, BASES[item]) for item in FORWARD_BASES]
    # All carried through the response of the first, which has all that the others have but a second relaxation.
    _, linear, nonlinear = turned[0]
    seen = carried(experiment, response_of(BASES[FORWARD_BASES[0]], linear, nonlinear))

    def score(name: str) -> float:
        return evaluate(fit_base(Structure(BASES[name]), seen.training), seen).score

    ranked = sorted(FORWARD_BASES, key=score)
    found = [simulated_base(experiment, BASES[name]) for name in ranked[:_SIMULATED]]
    return min(found, key=lambda item: item.score if np.isfinite(item.score) else np.inf)


def simulated_base(experiment: Experiment, base: Base) -> Candidate:
    """A base fitted turned round, and from there by simulation."""
    _, linear, nonlinear = fitted_base(experiment, base)
    return simulated(experiment, ForwardStructure(base), linear, nonlinear)


def better_base(model: Candidate, seen: Experiment) -> Base | None:
    """The base that explains the turned-round records better with the same effects; None where there is none.

    What a model lacks may have passed for a relaxation or a mass as long as it was lacking.
    """
    structure = model.fit.structure
    _, parts = structure.nonlinear_of(model.fit.nonlinear)
    acting = [parts[form.key] for form in structure.forms]

    def score(base: Base) -> float:
        bare = fit_base(Structure(base), seen.training)
        start = np.concatenate([bare.nonlinear, *acting])
        return evaluate(fit(Structure(base, structure.forms), seen.training, start), seen).score

    bases = {name: BASES[name] for name in (structure.base.name, *FORWARD_BASES)}
    best = min(bases, key=lambda name: score(bases[name]))
    return None if best == structure.base.name else bases[best]
