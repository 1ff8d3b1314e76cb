"""Proposal of a law for the missing force, in plain English and as the file of a user-defined effect."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lumbar.base.formats import percent
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.joint_fit import fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.law import law_validation
from lumbar.tissue.diagnosis.law.law_form import form_of
from lumbar.tissue.diagnosis.law.search import Law, Search
from lumbar.tissue.diagnosis.law.terms import Term, knows, library
from lumbar.tissue.diagnosis.residuals.residual import probability
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
from lumbar.tissue.models.parameter import NonlinearParameter

NAME = "proposed_law"
CONFIRMED = 3.09
"""Smallest fall of the loss in standard errors, on unseen blocks that no choice has used (one-sided 0.1 %, because a few laws
are tried)."""
MIN_SHARE = 0.75
"""Smallest share of the explainable error of the catalogue's best model that a law must remove on these blocks."""
_MAX_BASE_ERROR_RATIO = 1.05
"""Largest ratio of the error of a law on the base to that of a law on the catalogue's best model if the former is preferred."""
MARK = "found in these data, not known physics"
_SIGNS = {1: "positive", -1: "negative", 0: "any"}
_START_FACTOR = 1.5
"""Factor on the fitted value, up and down, for the starting values of another fit of the law."""
_MAX_STARTED_PARAMETERS = 2
"""Largest number of nonlinear parameters with several starting values each; with more, a fit begins at the fitted values."""
_BOUND_FACTORS = (0.2, 5.0)
_MAX_IMITATION_RATIO = 0.5
"""Largest ratio of the error of a law on the base to that of the selected effects, if the effects only imitate the law."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """Result of the search of a law for a missing force."""

    experiment: Experiment
    base: Candidate
    """Base without effects."""
    before: Candidate
    """Best model of the catalogue."""
    law: Law | None = None
    """The proposed law, with its candidate judged on all unseen records; None if no law passes."""
    tried: Sequence[tuple[Law, str]] = ()
    """Every law that was tested, with the test that it failed; empty text for a law that passed."""
    share_removed: float = 0.0
    """Share of the explainable error of `before` that the law removes, on unseen blocks that no choice has used."""
    certainty: float = 0.0
    """Fall of the loss in standard errors, on unseen blocks that no choice has used."""
    extrapolation: law_validation.Extrapolation | None = None

    @property
    def is_needed(self) -> bool:
        """True if a law is needed: the catalogue's best model leaves more than noise."""
        return not is_adequate(self.before, self.experiment, COMPLETE)

    @property
    def start(self) -> Candidate:
        """The model that the law is added to; without a law the catalogue's best model."""
        return self.before if self.law is None else self.law.start

    @property
    def terms(self) -> tuple[Term, ...]:
        """Terms of the law; empty without a law."""
        return () if self.law is None else self.law.terms

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
        """Range of the law, and its error outside that range."""
        tried, force, unit = self.extrapolation, self.experiment.output_unit, self.experiment.input_unit
        # Position and speed of the training record, which the law is fitted to.
        every = law_validation.motions(self.experiment.training)
        low, high = min(item.position.min() for item in every), max(item.position.max() for item in every)
        speed = max(np.abs(item.velocity).max() for item in every)
        fitted = f"z from {low:.3g} to {high:.3g} {unit}, |v| up to {speed:.3g} {unit}/s"
        if tried is None:
            return f"{fitted}; beyond that range it was not tried, because the records are too short"
        outside = (
            f"; fitted to the inner {100 * law_validation.INNER:.0f} % of that range its error outside is {tried.inner_rms:.3g} "
            f"{force}, compared with {tried.all_rms:.3g} {force} if fitted to all"
        )
        if tried.beyond_rms is not None:
            outside += f", and {tried.beyond_rms:.3g} {force} on unseen samples beyond the range"
        return f"{fitted}{outside}{'; farther out it is a guess' if tried.holds else ': it does not extrapolate'}"

    @property
    def is_imitated(self) -> bool:
        """True if the catalogue's best effects only imitate the law: added to the base, the law leaves a far smaller error."""
        error = np.inf if self.law is None or self.start.effects else self.law.candidate.test_rms
        return bool(self.before.effects) and error < _MAX_IMITATION_RATIO * self.before.test_rms

    @property
    def sentences(self) -> list[str]:
        """The proposal, in plain English."""
        unit, floor, before = self.experiment.output_unit, self.experiment.floor, self.before
        noise = "" if floor is None else f", noise floor {floor.rms:.3g} {unit}"
        base = before.fit.structure.base.name
        name, tested = "+".join([base, *before.effects]), f"error on {self.experiment.test_data}"
        unseen = f"{tested} {before.test_rms:.3g} {unit}{noise}"
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
            f"The {tested} falls from {before.test_rms:.3g} to {self.law.candidate.test_rms:.3g} {unit}{noise}; "
            f"{percent(self.share_removed)} of the explainable error is removed on unseen seconds that no choice has used "
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
    """Search a short formula for the force that a model is missing, added to the base or to the catalogue's best model.

    The proposal has no law if nothing is missing or if no formula passes the tests.

    Parameters
    ----------
    experiment : Experiment
        Prepared records.
    base : Candidate
        Base without effects, judged on the experiment.
    before : Candidate, optional
        Best model of the catalogue; default the base.
    terms : sequence of Term, optional
        Terms of the search; default the whole library.

    Returns
    -------
    Proposal
    """
    proposal = Proposal(experiment, base, before or base)
    return search_law(proposal, library() if terms is None else terms) if proposal.is_needed else proposal


def search_law(proposal: Proposal, terms: Sequence[Term]) -> Proposal:
    """Search a law to add to the base or to the catalogue's best model, whichever leaves the smaller error."""
    experiment, base, before = proposal.experiment, proposal.base, proposal.before
    # Choices are made on every other second of the unseen records, and tested on the others.
    chosen_on, tested_on = law_validation.alternate(experiment)
    lower = law_validation.thin(experiment)
    search = Search(chosen_on if lower is experiment else law_validation.alternate(lower)[0], terms)
    left = before.fit.rms(*tested_on.tests) ** 2
    tried, passed = [], []
    for start in [base] if before.effects == base.effects else [base, before]:
        for law in reversed(search.laws(refit(start.fit.structure, start.fit.nonlinear, search.experiment))):
            # Refit to the whole training record, with the signs of the amplitudes, and judge on all records.
            signs = tuple(int(np.sign(value)) for value in law.fit.linear[len(start.fit.linear) :]) or None
            structure = start.fit.structure.with_form(form_of(law.terms, NAME, signs, law.shared))
            fitted = fit(structure, experiment.training, law.fit.nonlinear)
            law = Law(start, law.terms, evaluate(fitted, experiment), law.shared)
            share = (left - fitted.rms(*tested_on.tests) ** 2) / max(left - experiment.noise**2, 1e-300)
            certainty = unseen_improvement(before, law.candidate, tested_on)
            failure = _failed_test(law, experiment, share, certainty, len(terms))
            tried.append((law, failure))
            if not failure:
                passed.append((law, float(share), certainty))
                break
        if passed and is_adequate(passed[0][0].candidate, experiment):
            break  # on the base by itself it leaves only noise: no law with effects is preferred to it
    if not passed:
        return Proposal(experiment, base, before, tried=tried)
    best = min(passed, key=lambda item: item[0].candidate.test_rms)
    if passed[0][0].candidate.test_rms <= best[0].candidate.test_rms * _MAX_BASE_ERROR_RATIO:
        best = passed[0]
    law, share, certainty = best
    outside = law_validation.extrapolation(law.fit, experiment)
    return Proposal(experiment, base, before, law, tried, share, certainty, outside)


def _failed_test(law: Law, experiment: Experiment, share: float, certainty: float, terms: int) -> str:
    """Return the first test that a law fails; an empty text if it passes all tests."""
    gain = likelihood_ratio(law.start, law.candidate, experiment)
    p_value = null_distribution().p_value(gain, terms)
    if p_value > LEVEL:
        return f"noise alone gives as much ({probability(p_value)})"
    if certainty <= CONFIRMED:
        return f"it is not significantly better on unseen records ({certainty:.1f} standard errors)"
    if share < MIN_SHARE:
        return f"it removes {percent(share)} of what is missing on unseen records, less than three quarters"
    if not law_validation.stays_bounded(law.fit, experiment):
        return f"its force runs away on motions {law_validation.STRETCH:g} times as large or as fast"
    if "time" not in knows(law.terms) and not law_validation.is_dissipative(law.fit, experiment.training):
        return "it gives energy away in closed cycles"
    return ""


def effect_text(proposal: Proposal, name: str = NAME, source_label: str = "") -> str:
    """Return the YAML file of a proposed law, which `lumbar.tissue.effects.catalogue.load_effects` reads."""
    law, form, experiment = proposal.law, proposal.form, proposal.experiment

    def quoted(text: str) -> str:
        return json.dumps(text, ensure_ascii=False)

    entries, start = [], law.start.fit
    values = [*law.fit.linear[len(start.linear) :], *law.fit.nonlinear[len(start.nonlinear) :]]
    for item, value in zip((*form.linear, *form.nonlinear), values, strict=True):
        if isinstance(item, NonlinearParameter):
            # Another fit starts around the fitted value.
            points = 3 if len(form.nonlinear) <= _MAX_STARTED_PARAMETERS else 1
            factor = _START_FACTOR if points > 1 else 1.0
            scaled = value / experiment.training.scale(item.scale)
            fields = (
                f"start: [{scaled / factor:.6g}, {scaled * factor:.6g}], scale: {item.scale}, points: {points}, "
                f"reach: [{_BOUND_FACTORS[0]:g}, {_BOUND_FACTORS[1]:g}]"
            )
        else:
            fields = f"sign: {_SIGNS[item.sign]}"
        unit = unit_of(item.unit, experiment.input_unit, experiment.output_unit)
        entries.append(
            f'  {item.symbol}: {{name: {item.name}, unit: "{item.unit}", {fields}}}  # {value:.4g} {unit}'
        )
    mechanism = f"{MARK[0].upper()}{MARK[1:]}: {proposal.meaning}."
    source = f"lumbar propose{f' on {source_label}' if source_label else ''}: {proposal.validity}"
    lines = [
        *(f"# {line}" for line in proposal.sentences),
        f"name: {name}",
        f"mechanism: {quoted(mechanism)}",
        f"source: {quoted(source)}",
        f"experiment: {quoted('repeat it beyond the range of position and speed given above')}",
        *(["accumulates: true"] if knows(proposal.terms) & {"time", "path"} else []),
        *(["place: output"] if form.place == "output" else []),
        f"equation: {quoted(form.equation)}",
        *(["state:"] if form.state else []),
        *(f"  {symbol}: {quoted(rate)}" for symbol, rate in form.state),
        "parameters:",
        *entries,
        *(["constants:"] if form.constants else []),
        *(f'  {item.symbol}: {{value: {item.value:g}, unit: "{item.unit}"}}' for item in form.constants),
    ]
    return "\n".join(lines) + "\n"
