"""From what size on each effect of the catalogue would be named in a set of records."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lumbar.tissue.diagnosis.design.detectable import threshold_ratio
from lumbar.tissue.diagnosis.doctor.injection import Injection, without_effect
from lumbar.tissue.diagnosis.doctor.outcome import Diagnose, Kind, Outcome, diagnosed, judge_effect
from lumbar.tissue.diagnosis.doctor.smallest import Search, search
from lumbar.tissue.diagnosis.doctor.truth import Truth
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.selection.forward_selection import ADEQUATE
from lumbar.tissue.diagnosis.selection.null_distribution import shipped
from lumbar.tissue.models.form import Effect, Form

STRONGEST = 16.0
"""RMS of an effect's force, in those of the noise, from which the search falls."""
_BEYOND_PREDICTED = 4.0
"""The same, at least, in the predicted smallest one."""


@dataclass(frozen=True, eq=False)
class EffectSize:
    """From what size on one effect would be named."""

    form: Form
    injection: Injection
    noise: float
    """RMS per sample, in the output's unit."""
    present: float | None
    """RMS of its force in the records themselves, where the diagnosis named it there."""
    predicted: float | None
    """Smallest RMS of its force that a search would select, to first order; None where the model can take up all of it.
    """
    trials: Search | None
    """None where these motions do not call the effect forth."""

    @property
    def smallest(self) -> float | None:
        """Smallest RMS of its force at which it was named, in the output's unit; None where it never was."""
        if self.trials is None or self.trials.smallest is None:
            return None
        return self.trials.smallest * self.noise

    @property
    def smallest_fit(self) -> Fit | None:
        """The model with the effect at that size."""
        return None if self.smallest is None else self.injection.at(self.smallest)

    @property
    def words(self) -> str:
        """What was said of it where it is strong, and if that is another thing, that it is named where it is weaker."""
        if self.trials is None:
            return "not excited"
        outcome = self.trials.at_strongest
        if self.smallest is not None and outcome.kind is not Kind.NAMED:
            return f"named, but {outcome.words} where strong"
        return outcome.words

    @property
    def words_below(self) -> str:
        """What was said of it where it is too weak to be named."""
        below = self.trials.at_missed if self.trials and self.smallest is not None else None
        return below.words if below else ""


def forms_to_try(
    catalogue: dict[str, Effect], truth: Truth, all_forms: bool
) -> list[tuple[Form, Fit, np.ndarray | None]]:
    """Forms to put in, with the model that each is put into and, of effects of the model, their fitted parameters.

    Of every effect the first form, or all; of an effect that the records themselves have the form that was found.
    """
    found = []
    for effect in catalogue.values():
        if effect.name in truth.verdict.selected:
            rest, form, nonlinear = without_effect(truth.fit, effect.name)
            found.append((form, rest, nonlinear))
            continue
        found += [(form, truth.fit, None) for form in (effect.forms if all_forms else effect.forms[:1])]
    return found


def effect_sizes(
    truth: Truth,
    catalogue: dict[str, Effect],
    tried: list[tuple[Form, Fit, np.ndarray | None]],
    diagnose: Diagnose,
    quick: bool,
) -> Iterator[EffectSize]:
    """Search the smallest size of every form that would be named.

    Parameters
    ----------
    catalogue : dict of str to Effect
        All candidates of a diagnosis.
    tried : list
        Of `forms_to_try`.
    diagnose : callable
        Blind diagnosis.
    quick : bool
        One diagnosis per form.
    """
    null = shipped(truth.fit.structure.base.system)
    threshold = threshold_ratio(null, sum(len(effect.forms) for effect in catalogue.values()))
    for form, model, nonlinear in tried:
        if nonlinear is None:
            injection = Injection.middle(model, form, truth.training)
        else:
            injection = Injection(model, form, nonlinear, truth.training)
        yield _sized(truth, injection, threshold, diagnose, quick)


def _least_visible(model: Fit, training: FitData, threshold: float) -> float:
    """RMS in those of the noise that a search must see of an effect.

    Its gain N r² must reach the threshold. Beside an effect that the model has already it must also raise the error above what
    counts as adequate: a search ends there.
    """
    least = float(np.sqrt(threshold / training.size))
    return max(least, float(np.sqrt(ADEQUATE**2 - 1))) if model.structure.forms else least


def _sized(
    truth: Truth, injection: Injection, threshold: float, diagnose: Diagnose, quick: bool
) -> EffectSize:
    form, model, noise = injection.form, injection.model, truth.noise
    present = None
    if model is not truth.fit:
        present = injection.rms(truth.fit)
    if injection.largest <= 0:
        return EffectSize(form, injection, noise, present, None, None)
    predicted = injection.predicted(noise * _least_visible(model, truth.training, threshold))
    most = len(model.structure.forms) + 1

    def outcome_at(strength: float) -> Outcome:
        records = truth.records(injection.at(min(strength * noise, injection.largest)))
        found = diagnosed(records, most, diagnose)
        return judge_effect(found, form.effect, model.structure.effects, model.structure.base.name)

    expected = predicted / noise
    strongest = max(STRONGEST, _BEYOND_PREDICTED * expected) if expected == expected else STRONGEST
    found = search(outcome_at, expected, min(strongest, injection.largest / noise), quick)
    return EffectSize(form, injection, noise, present, predicted if expected == expected else None, found)
