"""The first things a reader asks of a diagnosis: what is missing, how sure that is, and every candidate on a card."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from lumbar.publishing.explorer.shown import model_key
from lumbar.publishing.figures.comparison_figures import signature_thumbnail
from lumbar.publishing.pages.diagnosis_page import role_of
from lumbar.publishing.pages.html import picture, table
from lumbar.tables.words import unit_in_print
from lumbar.tissue.diagnosis.evidence.discrimination import separation_sentence
from lumbar.tissue.diagnosis.evidence.evidence import Evidence
from lumbar.tissue.diagnosis.residuals.residual import probability
from lumbar.tissue.diagnosis.selection.thresholds import LEVEL
from lumbar.tissue.diagnosis.selection.verdict import (
    Ranked,
    Verdict,
    distinguishing_digits,
    effects_text,
    readable,
    runner_up,
)
from lumbar.tissue.effects.signature import pictured_form
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.printing import equation_svg

if TYPE_CHECKING:
    from markupsafe import Markup


_MANY = 6
"""Parameters from which on a card folds their table."""


@dataclass(frozen=True)
class Card:
    """One candidate."""

    key: str
    """See `lumbar.publishing.explorer.shown.model_key`."""
    title: str
    role: str
    error: str
    mechanism: str
    settles: str
    """`title`, `role`, `error`, `mechanism`, `settles`: role: selected, tied with it, runner-up, or nothing; `settles`:
    the experiment that would."""
    effects: list[str]
    forms: list[Markup]
    """Equations."""
    parameters: Markup | str
    """Table of the effects' parameters; empty where they have none."""
    long: bool
    """Whether they are many."""
    signature: Markup | str
    """Picture of the effect on a standard motion; empty where none can be drawn."""


def how_sure(diagnosis: Verdict, evidence: Evidence) -> list[str]:
    """Sentences on chance, on what explains the records as well, and on what would settle it."""
    lines = [_chance(diagnosis)]
    if diagnosis.verdict == "tied":
        others = ", ".join(effects_text(item.effects) for item in diagnosis.tied_with)
        lines.append(f"As good an explanation of these records: {others}.")
    elif diagnosis.selected and runner_up(diagnosis) is not None:
        lines.append(_next_best(diagnosis))
    if evidence.separation is not None:
        lines.append(separation_sentence(evidence.separation, diagnosis))
    if diagnosis.experiment.floor is None:
        lines.append(
            "No record repeats: how much of the error is noise is unknown, and so is whether all is found."
        )
    return lines


def _chance(diagnosis: Verdict) -> str:
    if not diagnosis.ranking:
        return "No effect of the catalogue could be fitted to these records."
    found = diagnosis.ranking[0]
    if not diagnosis.selected:
        return (
            f"The best of all candidates, {effects_text(found.candidate.effects)}, gains what chance gains where nothing is "
            f"missing ({probability(found.p_value)}; {LEVEL:g} would be needed) or does not lower the error on unseen records."
        )
    return (
        f"Where nothing is missing, the best of all candidates gains as much as {effects_text(diagnosis.selected)} here by "
        f"chance: {probability(found.p_value)}."
    )


def _next_best(diagnosis: Verdict) -> str:
    second, unit = runner_up(diagnosis).candidate, diagnosis.experiment.output_unit
    own, other = distinguishing_digits([diagnosis.model.test_rms, second.test_rms], 3)
    return f"The next best, {effects_text(second.effects)}, leaves {other} {unit} on unseen records instead of {own} {unit}."


def cards(diagnosis: Verdict, catalogue: dict[str, Effect]) -> list[Card]:
    """One card per ranked candidate, the best first."""
    pictures: dict[str, Markup | str] = {}
    return [_card(item, diagnosis, catalogue, pictures) for item in diagnosis.ranking]


def _card(item: Ranked, diagnosis: Verdict, catalogue: dict[str, Effect], pictures: dict) -> Card:
    candidate = item.candidate
    effects = list(candidate.effects)
    tied = [set(other.effects) for other in diagnosis.tied_with]
    forms = candidate.fit.structure.forms
    unit, system = diagnosis.experiment.output_unit, candidate.fit.structure.base.system
    before, after = distinguishing_digits([diagnosis.base.test_rms, candidate.test_rms], 3)
    new = [name for name in effects if name not in diagnosis.selected] or effects
    return Card(
        key=model_key(effects),
        title=effects_text(effects).capitalize(),
        role=role_of(item, diagnosis),
        error=f"Error on unseen records: {before} → {after} {unit}; {probability(item.p_value)}.",
        mechanism=" ".join(f"{catalogue[name].mechanism} {catalogue[name].sensors}".rstrip() for name in new),
        settles="; ".join(catalogue[name].experiment for name in new) if set(effects) in tied else "",
        effects=effects,
        forms=[picture(equation_svg(form.latex), form.latex, "equation") for form in forms],
        parameters=_parameters(item),
        long=sum(bool(found.effect) for found in item.estimates) > _MANY,
        signature=_signature(catalogue[new[-1]], system, pictures),
    )


def _parameters(item: Ranked) -> Markup | str:
    rows = [
        (readable(found.name), f"{found.value:.4g}", _interval(found), unit_in_print(found.unit))
        for found in item.estimates
        if found.effect
    ]
    return table(("parameter", "value", "95 % interval", "unit"), rows) if rows else ""


def _interval(found) -> str:
    return "not estimated" if found.low is None else f"{found.low:.4g} to {found.high:.4g}"


def _signature(effect: Effect, system: str, pictures: dict[str, Markup | str]) -> Markup | str:
    if effect.name not in pictures:
        words = f"{readable(effect.name)}: force over position on a standard motion, with it (solid) and without (dashed)"
        drawable = pictured_form(effect) is not None
        pictures[effect.name] = picture(signature_thumbnail(effect, system), words) if drawable else ""
    return pictures[effect.name]
