"""What a blind diagnosis makes of an effect that is in the records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from lumbar.base.errors import InputError, NumericalError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.selection.sentences import effects_text
from lumbar.tissue.diagnosis.selection.verdict import Verdict

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


def diagnosed(records: list[Record], most_effects: int, diagnose: Diagnose) -> Verdict | str:
    """Diagnose records; return the message where they are refused."""
    try:
        return diagnose(records, most_effects)
    except (InputError, NumericalError) as error:
        return str(error)


def judge_effect(found: Verdict | str, effect: str, before: tuple[str, ...], base_before: str) -> Outcome:
    """Say what became of one effect that was put into records beside those that are in them.

    Parameters
    ----------
    found : Verdict or str
        Of the records with it, or the message of their refusal.
    before : tuple of str
        Effects that are in the records beside it.
    base_before : str
        Name of the base that is in them.
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
