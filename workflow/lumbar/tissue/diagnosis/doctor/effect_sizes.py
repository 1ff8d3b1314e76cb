"""How large an effect must be to be told in records: predicted, and by blind diagnoses."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.doctor.injection import Injection, Truth, without_effect
from lumbar.tissue.diagnosis.selection.candidate import ADEQUATE
from lumbar.tissue.diagnosis.selection.verdict import Verdict, effects_text
from lumbar.tissue.models.form import Effect, Form

CONFIRMED_AT = 2.0
"""Size with which a prediction is confirmed, in predicted ones."""
STRONG = 16.0
"""The same in those of the noise, where nothing is predicted: the model can take up all of the effect."""

Diagnose = Callable[[list[Record], int], Verdict]
"""From records and the most effects that may be added to a verdict."""


class Kind(StrEnum):
    """Kinds of outcomes, the best first."""

    NAMED = "named"
    TIED = "tied"
    TOLD = "told"
    UNEXPLAINED = "unexplained"
    REFUSED = "refused"
    UNSEEN = "unseen"
    MISTAKEN = "mistaken"


@dataclass(frozen=True, eq=False)
class Outcome:
    """What was said of records in which an effect or a fault is known to be."""

    kind: Kind
    """``named``: the effect and nothing else; ``tied``: with others; ``told``: as a finding; ``unexplained``: something is
    missing and no effect explains it; ``refused``: the records were not diagnosed; ``unseen``; ``mistaken``: something
    else was named."""
    others: tuple[str, ...] = ()
    """Effects that it is tied with or mistaken for."""
    message: str = ""
    """Of a refusal or a finding."""
    verdict: Verdict | None = None
    """None where the records were refused."""

    @property
    def words(self) -> str:
        """In a few words."""
        if self.kind is Kind.MISTAKEN:
            return f"mistaken for {effects_text(self.others)}"
        if self.kind is Kind.TIED:
            return f"tied with {effects_text(self.others)}"
        if self.kind is Kind.TOLD and self.message.startswith(_TAKEN_UP):
            return self.message
        return str(self.kind)


@dataclass(frozen=True, eq=False)
class EffectSize:
    """The smallest size at which one effect should be named, and what was said of it at `CONFIRMED_AT` times that."""

    form: Form
    injection: Injection
    present: float | None
    """RMS of its force in the records themselves, where the diagnosis named it there."""
    predicted: float | None = None
    """Smallest RMS of its force that a search would select, to first order; None where the model can take up all of it."""
    put_in: float | None = None
    """RMS of its force in the records that were diagnosed; None where these motions do not call the effect forth."""
    outcome: Outcome | None = None
    """What was said of them. Sizes are in the output's unit."""
    felt: float | None = None
    """Smallest RMS of its force that a hand would feel beside the model without it; None where the output is no force."""

    @property
    def is_named(self) -> bool:
        """Whether the effect was named, and nothing else."""
        return self.outcome is not None and self.outcome.kind is Kind.NAMED

    @property
    def words(self) -> str:
        """What was said of it."""
        return "not excited" if self.outcome is None else self.outcome.words


def effect_size(truth: Truth, effect: Effect, least_gain: float, diagnose: Diagnose) -> EffectSize:
    """Predict the smallest size of an effect's first form that would be named, and diagnose records with more of it.

    An effect that the records themselves have is taken out of the model first, and put in again in the form that was found.

    `least_gain` is the likelihood-ratio statistic that a search asks for; `diagnose` is the blind diagnosis.
    """
    present = effect.name in truth.verdict.selected
    if present:
        injection = Injection(*without_effect(truth.fit, effect.name), truth.training)
    else:
        injection = Injection.middle(truth.fit, effect.forms[0], truth.training)
    form, model = injection.form, injection.model
    own = injection.rms(truth.fit) if present else None
    if injection.largest <= 0:
        return EffectSize(form, injection, own)
    predicted = injection.predict(truth.noise * _least_visible(truth, injection, least_gain))
    wanted = STRONG * truth.noise if predicted is None else CONFIRMED_AT * predicted
    put_in = min(wanted, injection.largest)
    found = diagnosis_or_refusal(
        truth.records(injection.at(put_in)), len(model.structure.forms) + 1, diagnose
    )
    outcome = judge_effect(found, effect.name, model.structure.effects, model.structure.base.name)
    experiment = truth.verdict.experiment
    felt = injection.just_felt(put_in, experiment.output_unit, experiment.hands)
    return EffectSize(form, injection, own, predicted, put_in, outcome, felt)


def _least_visible(truth: Truth, injection: Injection, least_gain: float) -> float:
    """RMS in those of the noise that a search must see of an effect.

    Its gain N r² must reach the least one. Beside an effect that the model has already it must also raise the error above what
    counts as adequate: a search ends there.
    """
    least = float(np.sqrt(least_gain / truth.training.size))
    return max(least, float(np.sqrt(ADEQUATE**2 - 1))) if injection.model.structure.forms else least


def diagnosis_or_refusal(records: list[Record], most_effects: int, diagnose: Diagnose) -> Verdict | str:
    """Diagnose records; return the message where they are refused."""
    try:
        return diagnose(records, most_effects)
    except (InputError, NumericalError) as error:
        return str(error)


def judge_effect(found: Verdict | str, effect: str, before: tuple[str, ...], base_before: str) -> Outcome:
    """Say what became of one effect that was put into records beside those that are in them.

    `found` is the verdict on the records with it, or the message of their refusal; `before` are the effects that are in
    the records beside it, `base_before` is the name of the base that is in them.
    """
    if isinstance(found, str):
        return Outcome(Kind.REFUSED, message=found)
    others = tuple(name for name in found.selected if name != effect and name not in before)
    tied = tuple(
        dict.fromkeys(
            name
            for item in found.tied_with
            for name in item.effects
            if name != effect and name not in found.selected and name not in before
        )
    )
    if effect in found.selected and not others:
        kind = Kind.TIED if tied else Kind.UNEXPLAINED if found.verdict == "unexplained" else Kind.NAMED
        return Outcome(kind, tied, verdict=found)
    if any(effect in item.effects for item in found.tied_with):
        return Outcome(Kind.TIED, others, verdict=found)
    message = next((item.sentence for item in found.findings if item.kind in _OF_THE_MODEL), "")
    base = found.base.fit.structure.base.name
    if base != base_before and not others and not message:
        message = f"{_TAKEN_UP} {base}"
    if message and not others:
        return Outcome(Kind.TOLD, message=message, verdict=found)
    if found.verdict == "unexplained":
        return Outcome(Kind.UNEXPLAINED, verdict=found)
    return Outcome(Kind.MISTAKEN if others else Kind.UNSEEN, others, verdict=found)


_TAKEN_UP = "taken up by the base"
_OF_THE_MODEL = ("higher_order_linear", "direction", "sign")
"""Kinds of findings that an effect in the records may be told as."""
