"""Whether records show that a mechanism acts whatever the speed; where not, relaxation and large strain may look the same."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.selection.candidate import Candidate, drop_effect
from lumbar.tissue.diagnosis.selection.forward_selection import extend
from lumbar.tissue.diagnosis.selection.verdict import Verdict, effects_text
from lumbar.tissue.models.form import Effect
from lumbar.tissue.signals.spectrum import occupied_band

_APART = 2.0
"""Ratio of the highest to the lowest rate of the motion from which on records tell whether a force depends on it."""
_AS_GOOD = 1.5
"""Error on an unseen record in that of training, each as it is or for its size of force, up to which it is predicted; and of a
rival in that of the model, up to which it stands beside."""
_FUNDAMENTAL = 0.9
"""Share of the power that bounds the rates of a motion: without the overtones of a triangle, which has one rate."""
_RIVALS = ("relaxation_spectrum", "second_relaxation")
_SPRINGS = ("hardening_stiffness", "strain_softening", "quadratic_stiffness")
"""What takes the place of a mechanism that does not ask for the speed: relaxation, alone and beside a spring of large strain."""


_OWN_SIZE = 0.5
"""Share of the error on a record of another rate that another size of the mechanism would remove, from which on that rate
contradicts it; else something else is missing there."""


def whatever_the_speed(found: Verdict, effects: Mapping[str, Effect]) -> tuple[Verdict, list[Finding]]:
    """Name a rate-independent mechanism alone only where other rates are predicted without new constants.

    Else it is tied with the relaxations, alone or beside a spring of large strain, that explain the unseen records as well; and
    unexplained where records of other rates contradict it and none of these does. `effects` are all that the records allow.
    """
    named = [name for name in found.selected if effects[name].rate_independent]
    if found.verdict not in ("named", "tied") or not named:
        return found, []
    low, high = _rates(found)
    apart, failed = high >= _APART * low, _not_predicted(found, named)
    if apart and not failed:
        return found, []
    known = {frozenset(item.effects) for item in found.tied_with}
    rivals = [item for item in _rivals(found, named, effects) if frozenset(item.effects) not in known]
    tied = [*found.tied_with, *rivals]
    verdict = "tied" if tied else "unexplained" if apart else "named"
    words = {
        "named": effects_text(named),
        "low": low,
        "high": high,
        "training": found.experiment.training.name,
    }
    kind = "other_rates_missed" if apart else "one_rate"
    finding = Finding.of(kind, high / low, "1", **words, missed=" and ".join(failed))
    return replace(found, verdict=verdict, tied_with=tied), [finding]


def _rates(found: Verdict) -> tuple[float, float]:
    """Lowest and highest frequency (Hz) of the motion in all records."""
    records = [part for item in (found.experiment.training, *found.experiment.tests) for part in item.records]
    bands = [
        occupied_band(part.own(part.motion.position), part.motion.sampling_time, _FUNDAMENTAL)
        for part in records
    ]
    return min(low for low, _ in bands), max(high for _, high in bands)


def _not_predicted(found: Verdict, named: list[str]) -> list[str]:
    """Unseen records with an error far above that of training, also for its force, that other sizes of these would remove."""
    model, experiment = found.model, found.experiment
    least = max(model.train_rms, experiment.noise)

    def size(data: FitData) -> float:
        return float(np.std(data.trim(data.force)))

    own = size(experiment.training)
    return [
        item.name
        for item in experiment.tests
        if model.unseen_rms[item.name] > _AS_GOOD * least * max(1.0, size(item) / own)
        and _removed_by_size(model.fit, named, item) > _OWN_SIZE
    ]


def _removed_by_size(fit: Fit, named: list[str], data: FitData) -> float:
    """Share of the squared error on a record that the named effects' force removes at a size of its own."""
    of_base = np.zeros(len(fit.structure.base.linear), dtype=bool)
    of_forms = [np.full(len(form.linear), form.effect in named) for form in fit.structure.forms]
    larger = fit.linear * np.where(np.concatenate([of_base, *of_forms]), 2.0, 1.0)
    force = fit.structure.simulate(data.motion, larger, fit.nonlinear) + fit.zero - fit.simulate(data.motion)
    error = data.trim(data.force - fit.simulate(data.motion))
    part = data.trim(force)
    error, part = error - error.mean(), part - part.mean()
    return float((error @ part) ** 2 / max((error @ error) * (part @ part), 1e-300))


def _rivals(found: Verdict, named: list[str], effects: Mapping[str, Effect]) -> list[Candidate]:
    """Relaxations in the place of the mechanism, the best alone and beside a spring, that come near on unseen records."""
    experiment, start = found.experiment, found.model
    for name in named:
        start = drop_effect(start, name, experiment)
    relaxing, springs = (
        {name: effects[name] for name in names if name in effects} for names in (_RIVALS, _SPRINGS)
    )
    alone = extend(start, relaxing, experiment)[:1]
    beside = [item for model in alone for item in extend(model, springs, experiment)[:1]]
    return [item for item in alone + beside if item.test_rms <= _AS_GOOD * found.model.test_rms]
