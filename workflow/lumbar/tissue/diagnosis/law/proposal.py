"""Propose a law for what is missing, or say that no short formula was found: in words, and as the file of an own effect."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.law.law_form import form_of
from lumbar.tissue.diagnosis.law.search import Law, Search
from lumbar.tissue.diagnosis.law.terms import Term, knows, library
from lumbar.tissue.diagnosis.law.validation import (
    INNER,
    STRETCH,
    Extrapolation,
    alternate,
    extrapolation,
    is_dissipative,
    motions,
    stays_bounded,
    thin,
)
from lumbar.tissue.diagnosis.selection.candidate import (
    Candidate,
    evaluate,
    is_adequate,
    likelihood_ratio,
    refit,
    unseen_improvement,
)
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult, Status
from lumbar.tissue.diagnosis.selection.thresholds import COMPLETE, LEVEL, null_distribution
from lumbar.tissue.models.form import Form
from lumbar.tissue.models.model_data import unit_of
from lumbar.tissue.models.parameter import NonlinearParameter, Parameter

NAME = "proposed_law"
CONFIRMED = 3.09
"""Standard errors by which the loss must fall on unseen seconds that no choice has looked at (one-sided 0.1 %: a few laws are
tried)."""
LEAST_SHARE = 0.75
"""Share of what the best model of the catalogue leaves to explain of them that a law must remove: the error then halves."""
_NEARLY = 1.05
"""Error beside that of a law on the catalogue's best model, up to which the law on the base alone is preferred."""
MARK = "found in these data, not known physics"
_SIGNS = {1: "positive", -1: "negative", 0: "any"}
_AROUND = 1.5
"""Factor below and above the value found within which another fit of the law begins."""
_FEW = 2
"""Nonlinear parameters that a fit can begin with at several values each; with more it begins with those found."""
_REACH = (0.2, 5.0)
_CLEARLY = 0.5
"""Error of a law on the base alone beside that of the effects selected, up to which they are but a likeness of it."""


@dataclass(frozen=True)
class Range:
    """Where a law was found."""

    low: float
    high: float
    """`low`, `high`: position, in the input's unit."""
    speed: float
    """Largest, in the input's unit per second."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """A law for what is missing, or none."""

    experiment: Experiment
    base: Candidate
    before: Candidate
    """`base`, `before`: the base alone; the best model that the catalogue gave."""
    law: Law | None
    """Its candidate is judged on all unseen records."""
    tried: list[tuple[Law, str]]
    """Every law that came so far as to be tested, with what it failed; empty where it is proposed."""
    share_removed: float
    """Share of what `before` leaves to explain, on unseen seconds that no choice has looked at, that the law removes."""
    certainty: float
    """Standard errors by which the loss falls there."""
    extrapolation: Extrapolation | None
    range: Range

    @property
    def is_needed(self) -> bool:
        """Whether something is missing beyond the catalogue."""
        return not is_adequate(self.before, self.experiment, COMPLETE)

    @property
    def start(self) -> Candidate:
        """The model that the law is added to; without a law the catalogue's best."""
        return self.before if self.law is None else self.law.start

    @property
    def terms(self) -> tuple[Term, ...]:
        """Terms of the law; none where none is proposed."""
        return () if self.law is None else self.law.terms

    @property
    def accumulates(self) -> bool:
        """Whether the law grows with time or path from each record's start."""
        return bool(knows(self.terms) & {"time", "path"})

    @property
    def form(self) -> Form:
        """The form of the proposed law."""
        return self.law.fit.structure.forms[-1]

    @property
    def words(self) -> str:
        """What the law consists of."""
        return "; ".join(term.words for term in self.terms)

    @property
    def validity(self) -> str:
        """Where the law was found, and what is known of it beyond."""
        tried, force, unit = self.extrapolation, self.experiment.output_unit, self.experiment.input_unit
        fitted = f"z from {self.range.low:.3g} to {self.range.high:.3g} {unit}, |v| up to {self.range.speed:.3g} {unit}/s"
        if tried is None:
            return f"{fitted}; beyond that range it was not tried, because the records are too short"
        outside = (
            f"; fitted to the inner {100 * INNER:.0f} % of that range its error outside is {tried.inner_rms:.3g} {force}, "
            f"compared with {tried.all_rms:.3g} {force} if fitted to all"
        )
        if tried.beyond_rms is not None:
            outside += f", and {tried.beyond_rms:.3g} {force} on unseen samples beyond the range"
        return f"{fitted}{outside}{'; farther out it is a guess' if tried.holds else ': it does not extrapolate'}"

    @property
    def sentences(self) -> list[str]:
        """The proposal, in plain English."""
        unit, floor, before = self.experiment.output_unit, self.experiment.floor, self.before
        noise = "" if floor is None else f", noise floor {floor.rms:.3g} {unit}"
        base = before.fit.structure.base.name
        name, unseen = "+".join([base, *before.effects]), f"unseen error {before.test_rms:.3g} {unit}{noise}"
        if not self.is_needed:
            return [f"No law is needed: {name} leaves only noise ({unseen})."]
        if self.law is None:
            tried = [(" + ".join(term.name for term in law.terms), refused) for law, refused in self.tried]
            return [
                f"No short formula was found for the error that {name} leaves ({unseen}).",
                *(f"Not proposed: {terms}: {refused}." for terms, refused in tried),
            ]
        states = "".join(f", d{symbol}/dt = {rate}" for symbol, rate in self.form.state)
        return [
            f"Proposed for {'+'.join([base, *self.start.effects])}: F = {self.form.equation}{states} ({self.words}); {MARK}.",
            f"The unseen error falls from {before.test_rms:.3g} to {self.law.candidate.test_rms:.3g} {unit}{noise}; "
            f"{100 * self.share_removed:.0f} % of the explainable error is removed on unseen seconds that no choice has used "
            f"({self.certainty:.1f} standard errors).",
            f"It was found for {self.validity}.",
        ]

    @property
    def finding(self) -> Finding:
        """The proposal as a finding of ``diagnosis.json``: its value is the unseen error that is left."""
        left = self.before if self.law is None else self.law.candidate
        words = " ".join(self.sentences)
        return Finding("proposed_law", words, left.test_rms, self.experiment.output_unit)


def propose(
    experiment: Experiment,
    base: Candidate,
    before: Candidate | None = None,
    terms: Sequence[Term] | None = None,
) -> Proposal:
    """Look for a short formula for what a model is missing.

    The proposal is without a law where nothing is missing, and where no formula passes.

    Parameters
    ----------
    base : Candidate
        The base alone, judged on the experiment.
    before : Candidate, optional
        The best model that the catalogue gave; default the base.
    terms : sequence of Term, optional
        Default the whole library.
    """
    before = before or base
    none = Proposal(experiment, base, before, None, [], 0.0, 0.0, None, _range(experiment))
    return _search(none, library() if terms is None else terms) if none.is_needed else none


def _search(none: Proposal, terms: Sequence[Term]) -> Proposal:
    """The proposal with what a search finds, beside the base and beside the catalogue's best model."""
    experiment, base, before = none.experiment, none.base, none.before
    chosen_on, confirmed_on = alternate(experiment)
    lower = thin(experiment)
    search = Search(chosen_on if lower is experiment else alternate(lower)[0], terms)
    starts = [base] if before.effects == base.effects else [base, before]
    test = _Test(experiment, confirmed_on, before, len(terms))
    tried, passed = [], []
    for start in starts:
        for law in reversed(search.laws(refit(start.fit.structure, start.fit.nonlinear, search.experiment))):
            law = _on_all(law, start, experiment)
            refused = test.refuses(law)
            tried.append((law, refused))
            if not refused:
                passed.append(law)
                break
        if passed and is_adequate(passed[0].candidate, experiment):
            break  # on the base alone it leaves but noise: none beside effects is preferred to it
    law = min(passed, key=lambda item: item.candidate.test_rms, default=None)
    if passed and passed[0].candidate.test_rms <= law.candidate.test_rms * _NEARLY:
        law = passed[0]
    if law is None:
        return replace(none, tried=tried)
    return replace(
        none,
        law=law,
        tried=tried,
        share_removed=test.share_removed(law.fit),
        certainty=test.certainty(law),
        extrapolation=extrapolation(law.fit, experiment),
    )


def _on_all(law: Law, start: Candidate, experiment: Experiment) -> Law:
    """The law refitted to the whole training record, its amplitudes with the signs that were found, judged on all records."""
    own = law.fit.linear[len(start.fit.linear) :]
    signs = tuple(int(np.sign(value)) for value in own) or None
    structure = start.fit.structure.with_form(form_of(law.terms, NAME, signs, law.shared))
    found = fit(structure, experiment.training, law.fit.nonlinear)
    return Law(start, law.terms, evaluate(found, experiment), law.shared)


@dataclass(frozen=True, eq=False)
class _Test:
    """What a law must pass: judged on seconds of the unseen records that no choice has looked at."""

    experiment: Experiment
    unseen: Experiment
    before: Candidate
    terms: int

    def refuses(self, law: Law) -> str:
        """What a law fails; empty where it passes."""
        gain = likelihood_ratio(law.start, law.candidate, self.experiment)
        p_value = null_distribution().p_value(gain, self.terms)
        share = self.share_removed(law.fit)
        if p_value > LEVEL:
            return f"noise alone gives as much (p = {p_value:.2g})"
        if self.certainty(law) <= CONFIRMED:
            return f"it is not surely better on unseen records ({self.certainty(law):.1f} standard errors)"
        if share < LEAST_SHARE:
            return f"it removes {100 * share:.0f} % of what is missing on unseen records, less than three quarters"
        if not stays_bounded(law.fit, self.experiment):
            return f"its force runs away on motions {STRETCH:g} times as large or as fast"
        if "time" not in knows(law.terms) and not is_dissipative(law.fit, self.experiment.training):
            return "it gives energy away in closed cycles"
        return ""

    def certainty(self, law: Law) -> float:
        """Standard errors by which the loss falls below that of the catalogue's best model."""
        return unseen_improvement(self.before, law.candidate, self.unseen)

    def share_removed(self, found: Fit) -> float:
        """Share of what the catalogue's best model leaves to explain."""
        noise = self.experiment.noise**2
        left = self.before.fit.rms(*self.unseen.tests) ** 2
        return float((left - found.rms(*self.unseen.tests) ** 2) / max(left - noise, 1e-300))


def _range(experiment: Experiment) -> Range:
    """Position and speed of the training record: what the law is fitted to."""
    every = motions(experiment.training)
    return Range(
        min(float(motion.position.min()) for motion in every),
        max(float(motion.position.max()) for motion in every),
        max(float(np.abs(motion.velocity).max()) for motion in every),
    )


def effect_text(proposal: Proposal, name: str = NAME, source_label: str = "") -> str:
    """The YAML file of a proposed law: `lumbar.tissue.effects.catalogue.load_effects` reads it."""
    law, form, experiment = proposal.law, proposal.form, proposal.experiment
    offset = len(law.start.fit.linear), len(law.start.fit.nonlinear)
    linear = zip(form.linear, law.fit.linear[offset[0] :], strict=True)
    nonlinear = zip(form.nonlinear, law.fit.nonlinear[offset[1] :], strict=True)
    points = 3 if len(form.nonlinear) <= _FEW else 1
    entries = [
        *(_entry(item, value, f"sign: {_SIGNS[item.sign]}", experiment) for item, value in linear),
        *(
            _entry(
                item, value, _start(item, value / experiment.training.scale(item.scale), points), experiment
            )
            for item, value in nonlinear
        ),
    ]
    mechanism = f"{MARK[0].upper()}{MARK[1:]}: {proposal.words}."
    source = f"lumbar propose{f' on {source_label}' if source_label else ''}: {proposal.validity}"
    lines = [
        *(f"# {line}" for line in proposal.sentences),
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


def _entry(item: Parameter, value: float, how: str, experiment: Experiment) -> str:
    unit = unit_of(item.unit, experiment.input_unit, experiment.output_unit)
    return f'  {item.symbol}: {{name: {item.name}, unit: "{item.unit}", {how}}}  # {value:.4g} {unit}'


def _start(item: NonlinearParameter, scaled: float, points: int) -> str:
    """A fit begins around the value that was found."""
    around = _AROUND if points > 1 else 1.0
    return (
        f"start: [{scaled / around:.6g}, {scaled * around:.6g}], scale: {item.scale}, points: {points}, "
        f"reach: [{_REACH[0]:g}, {_REACH[1]:g}]"
    )


def with_law(verdict: DiagnosisResult, proposal: Proposal | None) -> DiagnosisResult:
    """Return the verdict with the law among its findings, where there is one.

    Where the law stands on the base alone and leaves far less than the effects that were selected, these are but its likeness:
    nothing of the catalogue explains the records.
    """
    if proposal is None or proposal.law is None:
        return verdict
    found = replace(verdict, findings=(*verdict.findings, proposal.finding))
    alone = not proposal.start.effects
    if alone and verdict.selected and proposal.law.candidate.test_rms < _CLEARLY * verdict.model.test_rms:
        return replace(found, status=Status.UNEXPLAINED, tied_with=[])
    return found
