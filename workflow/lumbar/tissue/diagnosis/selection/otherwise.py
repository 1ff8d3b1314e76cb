"""What else records that differ could be fitted as: trained the other way, all together, or as one session."""

from dataclasses import replace

import numpy as np

from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.selection.candidate import refit
from lumbar.tissue.diagnosis.selection.thresholds import COMPLETE
from lumbar.tissue.diagnosis.selection.verdict import Verdict

FAR = 2.0
"""Error of an unseen record, in noise floors, that a model which leaves only noise in training should not have."""
_STRETCHES = 4
_FALLING = -0.9
"""Rank correlation of the stiffnesses of all stretches with their order, up to which they fall all along."""
_MOVES = 0.2
"""Share of a record's range that a stretch must move over."""
_FALL = 0.01
"""Share of the stiffness by which it falls at least."""


def far_off(found: Verdict) -> list[str]:
    """Unseen records far above the noise, or what is left in training where that is unknown, of a model that is at it there."""
    experiment, model = found.experiment, found.model
    noise = experiment.noise or model.train_rms
    tissue = model.fit.structure.base.system == "tissue" and not experiment.session and not experiment.points
    if not tissue or model.train_rms > COMPLETE * noise:
        return []
    trained = {item.name for item in experiment.training.records}
    return [name for name, rms in model.unseen_rms.items() if rms > FAR * noise and name not in trained]


def trained_otherwise(found: Verdict, settings: DiagnosisSettings) -> list[Finding]:
    """The model that was selected, fitted to the records that were unseen, and to all: what each leaves of the others."""
    left = far_off(found)
    if not left:
        return []
    experiment, model = found.experiment, found.model

    def fitted(names: list[str]):
        chosen = replace(settings, train=names).prepare(list(experiment.records))
        return refit(model.fit.structure, model.fit.nonlinear, chosen.with_origin(experiment.surface))

    first = [item.name for item in experiment.training.records]
    others = [item.name for item in experiment.tests]
    try:
        turned, joint = fitted(others), fitted([*first, *others])
    except InputError:
        return []  # too little motion in the others, or another rate: they are no training records
    noise = experiment.noise or model.train_rms
    worst = max(joint.train_rms, joint.test_rms)
    words = {
        "first": " and ".join(first),
        "left": " and ".join(left),
        "error": max(model.unseen_rms[name] for name in left),
        "others": " and ".join(others),
        "own": turned.train_rms,
        "back": turned.test_rms,
        "all": worst,
        "outcome": "so that one set of parameters holds for all: fit them together with --train"
        if worst <= FAR * noise
        else "so that no one set of parameters holds for all of them",
    }
    return [Finding.of("trained_otherwise", turned.test_rms, experiment.output_unit, **words)]


def falling_stiffness(experiment: Experiment) -> list[Finding]:
    """That the stiffness falls all along the records, in their order, where it does."""
    records = experiment.records
    if len(records) < 2 or experiment.session or experiment.points:
        return []
    slopes = []
    for record in records:
        parts = zip(*(np.array_split(record[role], _STRETCHES) for role in ("input", "output")), strict=True)
        least = _MOVES * float(np.ptp(record["input"]))
        for position, force in parts:
            if np.ptp(position) < least:
                return []  # a hold tells no stiffness
            moved = position - position.mean()
            slopes.append(float(moved @ force / (moved @ moved)))
    ranks = np.argsort(np.argsort(slopes))
    order = float(np.corrcoef(ranks, np.arange(len(slopes)))[0, 1])
    falls = order <= _FALLING and slopes[-1] < (1 - _FALL) * slopes[0]
    unit = f"{experiment.output_unit}/{experiment.input_unit}"
    return [Finding.of("falling_stiffness", slopes[-1], unit, first=slopes[0])] if falls else []
