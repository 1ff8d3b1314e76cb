"""A proposed law as the YAML file of an own effect, with what is known of it, and in words."""

from __future__ import annotations

import json

from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.law.checks import INNER
from lumbar.tissue.diagnosis.law.proposal import NAME, Proposal
from lumbar.tissue.models.form import Form
from lumbar.tissue.models.model_data import unit_of
from lumbar.tissue.models.parameter import NonlinearParameter

MARK = "found in these data, not known physics"
_SIGNS = {1: "positive", -1: "negative", 0: "any"}
_AROUND = 1.5
"""Factor below and above the value found within which another fit of the law begins."""
_FEW = 2
"""Nonlinear parameters that a fit can begin with at several values each; with more it begins with those found."""
_REACH = (0.2, 5.0)


def form_found(proposal: Proposal) -> Form:
    """The form of a proposed law."""
    return proposal.law.fit.structure.forms[-1]


def words(proposal: Proposal) -> str:
    """What the law consists of."""
    return "; ".join(term.words for term in proposal.law.terms)


def range_words(proposal: Proposal) -> str:
    """Where the law was found."""
    found, unit = proposal.range, proposal.experiment.input_unit
    return f"z from {found.low:.3g} to {found.high:.3g} {unit}, |v| up to {found.speed:.3g} {unit}/s"


def extrapolation_words(proposal: Proposal) -> str:
    """What is known of the law beyond the range it was found in."""
    tried = proposal.extrapolation
    if tried is None:
        return "whether it holds beyond that range was not tried: the records are too short"
    unit = proposal.experiment.output_unit
    said = (
        f"fitted to the inner {100 * INNER:.0f} % of that range it errs by {tried.inner_rms:.3g} {unit} outside, beside "
        f"{tried.all_rms:.3g} {unit} when fitted to all"
    )
    if tried.beyond_rms is not None:
        said += f", and by {tried.beyond_rms:.3g} {unit} on unseen samples beyond the range"
    return f"{said}; farther on it is a guess" if tried.holds else f"{said}: it does not extrapolate"


def sentences(proposal: Proposal) -> list[str]:
    """The proposal, in plain English."""
    unit, floor = proposal.experiment.output_unit, proposal.experiment.floor
    beside = "" if floor is None else f", noise floor {floor.rms:.3g} {unit}"
    before = proposal.before
    said = f"unseen error {before.test_rms:.3g} {unit}{beside}"
    name = "+".join([before.fit.structure.base.name, *before.effects])
    if not proposal.is_needed:
        return [f"No law is needed: {name} leaves nothing but noise ({said})."]
    best = proposal.surfaces[0]
    on = "+".join([before.fit.structure.base.name, *proposal.left_by.effects])
    seen = (
        f"Without a formula, the best smooth function of {best.first.words} and {best.second.words} explains "
        f"{100 * best.share:.0f} % of what {on} leaves to explain."
    )
    if proposal.law is None:
        refused = [f"{_tried_words(item.law)}: {item.refused}" for item in proposal.tried]
        return [
            f"No short formula found for what {name} leaves ({said}).",
            seen,
            *(f"Not proposed: {one}." for one in refused),
        ]
    law, form = proposal.law, form_found(proposal)
    states = "".join(f", d{symbol}/dt = {rate}" for symbol, rate in form.state)
    return [
        f"Proposed for {on}: F = {form.equation}{states} ({words(proposal)}); {MARK}.",
        f"The unseen error falls from {before.test_rms:.3g} to {law.candidate.test_rms:.3g} {unit}{beside}; "
        f"{100 * proposal.share_removed:.0f} % of what was missing is gone on unseen seconds that no choice has looked at "
        f"({proposal.certainty:.1f} standard errors).",
        seen,
        f"It was found for {range_words(proposal)}; {extrapolation_words(proposal)}.",
    ]


def _tried_words(law) -> str:
    return " + ".join(term.name for term in law.terms)


def finding(proposal: Proposal) -> Finding:
    """The proposal as a finding of ``diagnosis.json``: its value is the unseen error that is left."""
    left = proposal.before if proposal.law is None else proposal.law.candidate
    words = " ".join(sentences(proposal))
    return Finding("proposed_law", words, left.test_rms, proposal.experiment.output_unit)


def effect_text(proposal: Proposal, name: str = NAME, data: str = "") -> str:
    """The YAML file of a proposed law: `lumbar.tissue.effects.notation.load_effects` reads it."""
    law, form, experiment = proposal.law, form_found(proposal), proposal.experiment
    offset = len(law.start.fit.linear), len(law.start.fit.nonlinear)
    linear = list(zip(form.linear, law.fit.linear[offset[0] :], strict=True))
    nonlinear = list(zip(form.nonlinear, law.fit.nonlinear[offset[1] :], strict=True))
    units = experiment.input_unit, experiment.output_unit
    entries = [
        *(_linear_entry(item, value, units) for item, value in linear),
        *(
            _nonlinear_entry(
                item, value, experiment.training.scale(item.scale), 3 if len(nonlinear) <= _FEW else 1, units
            )
            for item, value in nonlinear
        ),
    ]
    mechanism = f"{MARK[0].upper()}{MARK[1:]}: {words(proposal)}."
    source = f"lumbar propose{f' on {data}' if data else ''}: {range_words(proposal)}; {extrapolation_words(proposal)}"
    lines = [
        *(f"# {line}" for line in sentences(proposal)),
        f"name: {name}",
        f"mechanism: {_quoted(mechanism)}",
        f"source: {_quoted(source)}",
        f"experiment: {_quoted('repeat it beyond the range of position and speed given above')}",
        *(["accumulates: true"] if proposal.accumulates else []),
        *(["place: output"] if form.place == "output" else []),
        f"equation: {_quoted(form.equation)}",
        *(["state:", *(f"  {symbol}: {_quoted(rate)}" for symbol, rate in form.state)] if form.state else []),
        "parameters:",
        *entries,
    ]
    if form.constants:
        lines += ["constants:"]
        lines += [
            f'  {item.symbol}: {{value: {item.value:g}, unit: "{item.unit}"}}' for item in form.constants
        ]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _linear_entry(item, value: float, units: tuple[str, str]) -> str:
    return (
        f'  {item.symbol}: {{name: {item.name}, unit: "{item.unit}", sign: {_SIGNS[item.sign]}}}'
        f"  # {value:.4g} {unit_of(item.unit, *units)}"
    )


def _nonlinear_entry(
    item: NonlinearParameter, value: float, scale: float, points: int, units: tuple[str, str]
) -> str:
    """Its fit begins around the value that was found."""
    around = _AROUND if points > 1 else 1.0
    low, high = value / scale / around, value / scale * around
    return (
        f'  {item.symbol}: {{name: {item.name}, unit: "{item.unit}", start: [{low:.6g}, {high:.6g}], scale: {item.scale}, '
        f"points: {points}, reach: [{_REACH[0]:g}, {_REACH[1]:g}]}}  # {value:.4g} {unit_of(item.unit, *units)}"
    )
