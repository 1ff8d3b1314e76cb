"""Propose a law for the missing force, in plain English and as the file of a user-defined effect, or report that none passes."""

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
from lumbar.tissue.diagnosis.selection.thresholds import COMPLETE, LEVEL, null_distribution
from lumbar.tissue.models.form import Form
from lumbar.tissue.models.model_data import unit_of
from lumbar.tissue.models.parameter import NonlinearParameter, Parameter

NAME = "proposed_law"
CONFIRMED = 3.09
"""Standard errors by which the loss must fall on unseen seconds that no choice has used (one-sided 0.1 %: a few laws are
tried)."""
LEAST_SHARE = 0.75
"""Share of the explainable error of the catalogue's best model that a law must remove there: the error is then halved."""
_NEARLY = 1.05
"""A law on the base is preferred up to this ratio of its error to that of a law on the catalogue's best model."""
MARK = "found in these data, not known physics"
_SIGNS = {1: "positive", -1: "negative", 0: "any"}
_AROUND = 1.5
"""Factor below and above the fitted value, within which another fit of the law begins."""
_FEW = 2
"""Most nonlinear parameters with several starting values each; with more, a fit begins at the fitted values."""
_REACH = (0.2, 5.0)
_MAX_IMITATION_RATIO = 0.5
"""Ratio of the error of a law on the base to that of the selected effects, up to which these only imitate the law."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """A law for what is missing, or none."""

    experiment: Experiment
    base: Candidate
    """The base by itself."""
    before: Candidate
    """The best model of the catalogue."""
    law: Law | None = None
    """The proposed law; its candidate is judged on all unseen records."""
    tried: Sequence[tuple[Law, str]] = ()
    """Every law that was tested, with the test that it failed; empty text for the proposed one."""
    share_removed: float = 0.0
    """Share of the explainable error of `before` that the law removes, on unseen seconds that no choice has used."""
    certainty: float = 0.0
    """Standard errors by which the loss falls there."""
    extrapolation: Extrapolation | None = None

    @property
    def is_needed(self) -> bool:
        """True if the catalogue's best model leaves more than noise."""
        return not is_adequate(self.before, self.experiment, COMPLETE)

    @property
    def start(self) -> Candidate:
        """The model that the law is added to; without a law the catalogue's best."""
        return self.before if self.law is None else self.law.start

    @property
    def terms(self) -> tuple[Term, ...]:
        """Terms of the law; empty without one."""
        return () if self.law is None else self.law.terms

    @property
    def accumulates(self) -> bool:
        """True if the law grows with time or path from the start of each record."""
        return bool(knows(self.terms) & {"time", "path"})

    @property
    def form(self) -> Form:
        """The form of the proposed law."""
        return self.law.fit.structure.forms[-1]

    @property
    def meaning(self) -> str:
        """The law's terms in plain English."""
        return "; ".join(term.words for term in self.terms)

    @property
    def validity(self) -> str:
        """Range of the law, and its error outside of it."""
        tried, force, unit = self.extrapolation, self.experiment.output_unit, self.experiment.input_unit
        # Position and speed of the training record, which the law is fitted to.
        every = motions(self.experiment.training)
        low, high = min(item.position.min() for item in every), max(item.position.max() for item in every)
        speed = max(np.abs(item.velocity).max() for item in every)
        fitted = f"z from {low:.3g} to {high:.3g} {unit}, |v| up to {speed:.3g} {unit}/s"
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
    def is_imitated(self) -> bool:
        """True if the law, added to the base, leaves far less than the catalogue's best effects: they only imitate it."""
        error = np.inf if self.law is None or self.start.effects else self.law.candidate.test_rms
        return bool(self.before.effects) and error < _MAX_IMITATION_RATIO * self.before.test_rms

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
            f"Proposed for {'+'.join([base, *self.start.effects])}: F = {self.form.equation}{states} ({self.meaning}); {MARK}.",
            f"The unseen error falls from {before.test_rms:.3g} to {self.law.candidate.test_rms:.3g} {unit}{noise}; "
            f"{100 * self.share_removed:.0f} % of the explainable error is removed on unseen seconds that no choice has used "
            f"({self.certainty:.1f} standard errors).",
            f"It was found for {self.validity}.",
        ]

    @property
    def finding(self) -> Finding:
        """The proposal as a finding of ``diagnosis.json``; its value is the remaining unseen error."""
        best = self.before if self.law is None else self.law.candidate
        return Finding("proposed_law", " ".join(self.sentences), best.test_rms, self.experiment.output_unit)


def propose(
    experiment: Experiment,
    base: Candidate,
    before: Candidate | None = None,
    terms: Sequence[Term] | None = None,
) -> Proposal:
    """Search a short formula for the force that a model is missing.

    The proposal has no law if nothing is missing or if no formula passes the tests.

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
    nothing = Proposal(experiment, base, before)
    return search_law(nothing, library() if terms is None else terms) if nothing.is_needed else nothing


def search_law(nothing: Proposal, terms: Sequence[Term]) -> Proposal:
    """Search a law to add to the base or to the catalogue's best model, whichever leaves less; start without a law."""
    experiment, base, before = nothing.experiment, nothing.base, nothing.before
    # Choices are made on every other second of the unseen records, and tested on the others.
    chosen_on, tested_on = alternate(experiment)
    lower = thin(experiment)
    search = Search(chosen_on if lower is experiment else alternate(lower)[0], terms)
    test = _Test(experiment, tested_on, before, len(terms))
    tried, passed = [], []
    for start in [base] if before.effects == base.effects else [base, before]:
        for law in reversed(search.laws(refit(start.fit.structure, start.fit.nonlinear, search.experiment))):
            # Refit to the whole training record, with the signs of the amplitudes, and judge on all records.
            signs = tuple(int(np.sign(value)) for value in law.fit.linear[len(start.fit.linear) :]) or None
            structure = start.fit.structure.with_form(form_of(law.terms, NAME, signs, law.shared))
            fitted = fit(structure, experiment.training, law.fit.nonlinear)
            law = Law(start, law.terms, evaluate(fitted, experiment), law.shared)
            failure = test.failure(law)
            tried.append((law, failure))
            if not failure:
                passed.append(law)
                break
        if passed and is_adequate(passed[0].candidate, experiment):
            break  # on the base by itself it leaves only noise: no law with effects is preferred to it
    if not passed:
        return replace(nothing, tried=tried)
    law = min(passed, key=lambda item: item.candidate.test_rms)
    if passed[0].candidate.test_rms <= law.candidate.test_rms * _NEARLY:
        law = passed[0]
    outside = extrapolation(law.fit, experiment)
    share, certainty = test.share_removed(law.fit), test.certainty(law)
    return Proposal(experiment, base, before, law, tried, share, certainty, outside)


@dataclass(frozen=True, eq=False)
class _Test:
    """Tests of a law on seconds of the unseen records that no choice has used."""

    experiment: Experiment
    unseen: Experiment
    before: Candidate
    terms: int

    def failure(self, law: Law) -> str:
        """Name the first test that a law fails; empty if it passes all."""
        gain = likelihood_ratio(law.start, law.candidate, self.experiment)
        p_value = null_distribution().p_value(gain, self.terms)
        share = self.share_removed(law.fit)
        if p_value > LEVEL:
            return f"noise alone gives as much (p = {p_value:.2g})"
        if self.certainty(law) <= CONFIRMED:
            return f"it is not significantly better on unseen records ({self.certainty(law):.1f} standard errors)"
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

    def share_removed(self, fitted: Fit) -> float:
        """Share of the explainable error of the catalogue's best model."""
        noise = self.experiment.noise**2
        left = self.before.fit.rms(*self.unseen.tests) ** 2
        return float((left - fitted.rms(*self.unseen.tests) ** 2) / max(left - noise, 1e-300))


def effect_text(proposal: Proposal, name: str = NAME, source_label: str = "") -> str:
    """Return the YAML file of a proposed law, which `lumbar.tissue.effects.catalogue.load_effects` reads."""
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
    mechanism = f"{MARK[0].upper()}{MARK[1:]}: {proposal.meaning}."
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
    """Return the entries that start a fit around the fitted value."""
    around = _AROUND if points > 1 else 1.0
    return (
        f"start: [{scaled / around:.6g}, {scaled * around:.6g}], scale: {item.scale}, points: {points}, "
        f"reach: [{_REACH[0]:g}, {_REACH[1]:g}]"
    )
