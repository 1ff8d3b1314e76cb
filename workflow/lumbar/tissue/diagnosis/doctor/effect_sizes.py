"""How large an effect or a mistake of a recording must be to be told in records: predicted, and by blind diagnoses."""

from collections.abc import Callable, Sequence
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
    return EffectSize(form, injection, own, predicted, put_in, outcome)


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


_NOTABLE = 0.5
"""Share by which the size of a finding must differ from that of the same finding without the fault."""
_TELLING = (Kind.TOLD, Kind.NAMED, Kind.TIED, Kind.REFUSED)


@dataclass(frozen=True, eq=False)
class Fault:
    """A mistake, in one or several sizes."""

    name: str
    words: str
    """What it is."""
    size_words: str
    """Its size, as ``{}``; empty where it has none."""
    sizes: tuple[float, ...]
    """The largest first."""
    change: Callable[[Record, float, np.random.Generator], Record]
    """From a record, size and what is random in it to the record with the mistake."""
    findings: tuple[str, ...] = ()
    """Kinds of findings that tell it."""
    effects: tuple[str, ...] = ()
    """Effects of the catalogue whose naming tells it."""
    one: bool = False
    """Whether it is in the shortest record alone, which no model is fitted to unless it is asked for."""

    def size(self, size: float) -> str:
        """A size in words."""
        return self.size_words.format(f"{size:g}")

    def put_into(self, records: list[Record], size: float, seed: int) -> list[Record]:
        """The records with the mistake."""
        if self.one:
            shortest = min(records, key=len)
            random = np.random.default_rng(seed)
            return [self.change(item, size, random) if item is shortest else item for item in records]
        return [
            self.change(record, size, np.random.default_rng([seed, number]))
            for number, record in enumerate(records)
        ]


@dataclass(frozen=True, eq=False)
class FaultOutcomes:
    """What was said of one mistake."""

    fault: Fault
    outcomes: dict[float, Outcome]
    """By size, the largest first, down to the first that was not told."""

    @property
    def smallest(self) -> float | None:
        """Smallest size that was told; None where none was."""
        told = [size for size, outcome in self.outcomes.items() if outcome.kind in _TELLING]
        return min(told, default=None)

    @property
    def largest_missed(self) -> float | None:
        """Largest size that was not told; None where all were."""
        missed = [size for size, outcome in self.outcomes.items() if outcome.kind not in _TELLING]
        return max(missed, default=None)


def fault_outcomes(
    records: Sequence[Record], reference: Verdict, fault: Fault, diagnose: Diagnose, seed: int
) -> FaultOutcomes:
    """Put a mistake into the records, from its largest size down to the first that is not told.

    `reference` is the verdict on the records as they are, `diagnose` the blind diagnosis; `seed` is that of what is
    random in a mistake.
    """
    outcomes: dict[float, Outcome] = {}
    for size in fault.sizes:
        spoilt = fault.put_into(list(records), size, seed)
        found = diagnosis_or_refusal(spoilt, len(reference.selected) + 1, diagnose)
        outcomes[size] = judge_fault(found, fault, reference)
        if outcomes[size].kind not in _TELLING:
            break
    return FaultOutcomes(fault, outcomes)


def judge_fault(found: Verdict | str, fault: Fault, reference: Verdict) -> Outcome:
    """Say what became of a mistake that was put into records.

    `found` is the verdict on the records with it, or the message of their refusal; `reference` that on the records
    without it.
    """
    if isinstance(found, str):
        return Outcome(Kind.REFUSED, message=found)
    known = {(item.kind, item.record): item.value for item in reference.findings}
    for item in found.findings:
        before = known.get((item.kind, item.record), np.nan)
        new = not abs(item.value - before) <= _NOTABLE * abs(before)
        if item.kind in fault.findings and new:
            return Outcome(Kind.TOLD, message=item.sentence, verdict=found)
    added = tuple(name for name in found.selected if name not in reference.selected)
    if added and set(added) <= set(fault.effects):
        return Outcome(Kind.NAMED, message=f"named: {', '.join(added)}", verdict=found)
    if added:
        return Outcome(Kind.MISTAKEN, added, verdict=found)
    if found.verdict == "unexplained" != reference.verdict:
        return Outcome(Kind.UNEXPLAINED, verdict=found)
    return Outcome(Kind.UNSEEN, verdict=found)


def _flip(record: Record, _size, _random) -> Record:
    return record.with_values(output=-record["output"])


def _exchange(record: Record, _size, _random) -> Record:
    return record.with_values(input=record["output"], output=record["input"])


def _offset(record: Record, percent: float, _random) -> Record:
    return record.with_values(output=record["output"] + percent / 100 * np.ptp(record["output"]))


def _scale_input(record: Record, factor: float, _random) -> Record:
    return record.with_values(input=factor * record["input"])


def _scale_response(record: Record, factor: float, _random) -> Record:
    return record.with_values(output=factor * record["output"])


def _delay(record: Record, samples: float, _random) -> Record:
    count, values = int(samples), record["output"]
    return record.with_values(output=np.concatenate([np.full(count, values[0]), values[:-count]]))


def _add_noise(record: Record, percent: float, random: np.random.Generator) -> Record:
    size = percent / 100 * np.ptp(record["input"])
    return record.with_values(input=record["input"] + size * random.standard_normal(len(record)))


def _round(record: Record, percent: float, _random) -> Record:
    step = percent / 100 * np.ptp(record["input"])
    return record.with_values(input=step * np.round(record["input"] / step))


_OFFSETS, _RESOLUTIONS = (10.0, 3.0, 1.0), (3.0, 1.0, 0.3, 0.1)
_OF_RANGE = "{} % of its range"
FAULTS = {
    fault.name: fault
    for fault in (
        Fault("sign_flip", "sign of the response changed in all records", "", (1.0,), _flip, ("sign",)),
        Fault("one_sign_flip", "sign of the response changed in one record", "", (1.0,), _flip, ("sign",), one=True),
        Fault("exchanged_columns", "input and response exchanged in all records", "", (1.0,), _exchange, ("direction",)),
        Fault("offset", "zero of the response off in all records", _OF_RANGE, _OFFSETS, _offset, ("force_offset",)),
        Fault("one_offset", "zero of the response off in one record", _OF_RANGE, _OFFSETS, _offset, ("force_offset",), one=True),
        Fault(
            "input_unit", "input of one record in another unit", "{} times", (1000.0, 25.4, 10.0), _scale_input, ("unit",),
            one=True,
        ),
        Fault(
            "response_unit", "response of one record in another unit", "{} times", (1000.0, 9.81, 4.448), _scale_response,
            ("unit",), one=True,
        ),
        Fault("lag", "response late in all records", "{} samples", (5.0, 3.0, 2.0, 1.0), _delay, ("clock_skew",), ("delay",)),
        Fault("position_noise", "noise in the input", _OF_RANGE, _RESOLUTIONS, _add_noise, ("position_noise",)),
        Fault("position_step", "input in steps", _OF_RANGE, _RESOLUTIONS, _round, ("position_step",)),
    )
}  # fmt: skip
"""By name."""
