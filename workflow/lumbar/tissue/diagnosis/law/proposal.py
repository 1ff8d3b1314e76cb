"""Propose a law for what is missing, or say that no short formula was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.law.blocks import alternate
from lumbar.tissue.diagnosis.law.checks import (
    STRETCH,
    Extrapolation,
    extrapolation,
    is_dissipative,
    motions,
    stays_bounded,
)
from lumbar.tissue.diagnosis.law.law_form import form_of
from lumbar.tissue.diagnosis.law.search import Law, Search
from lumbar.tissue.diagnosis.law.surface import Surface, surfaces
from lumbar.tissue.diagnosis.law.terms import Term, knows, library
from lumbar.tissue.diagnosis.law.thinning import thinned
from lumbar.tissue.diagnosis.selection.forward_selection import (
    Candidate,
    evaluate,
    is_adequate,
    likelihood_ratio,
    unseen_improvement,
)
from lumbar.tissue.diagnosis.selection.null_distribution import shipped
from lumbar.tissue.diagnosis.selection.thresholds import COMPLETE, LEVEL

NAME = "proposed_law"
CONFIRMED = 3.09
"""Standard errors by which the loss must fall on unseen seconds that no choice has looked at (one-sided 0.1 %: a few laws are
tried)."""
LEAST_SHARE = 0.75
"""Share of what the best model of the catalogue leaves to explain of them that a law must remove: the error then halves."""
_NEARLY = 1.05
"""Error beside that of a law on the catalogue's best model, up to which the law on the base alone is preferred."""


@dataclass(frozen=True)
class Range:
    """Where a law was found."""

    low: float
    high: float
    """`low`, `high`: position, in the input's unit."""
    speed: float
    """Largest, in the input's unit per second."""


@dataclass(frozen=True, eq=False)
class Tried:
    """A law that was looked at, and why it is not proposed; empty where it is."""

    law: Law
    refused: str


@dataclass(frozen=True, eq=False)
class Proposal:
    """A law for what is missing, or none."""

    experiment: Experiment
    base: Candidate
    before: Candidate
    """`base`, `before`: the base alone; the best model that the catalogue gave."""
    law: Law | None
    """Its candidate is judged on all unseen records."""
    tried: list[Tried]
    """Every law that came so far as to be tested, with what it failed."""
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
    def left_by(self) -> Candidate:
        """The model that the law is added to; without a law the catalogue's best."""
        return self.before if self.law is None else self.law.start

    @cached_property
    def surfaces(self) -> list[Surface]:
        """What `left_by` leaves, without a formula, the pair of coordinates that explains most first."""
        return surfaces(self.left_by.fit, self.experiment)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Terms of the law; none where none is proposed."""
        return () if self.law is None else self.law.terms

    @property
    def accumulates(self) -> bool:
        """Whether the law grows with time or path from each record's start."""
        return bool(knows(self.terms) & {"time", "path"})


def propose(
    experiment: Experiment,
    base: Candidate,
    before: Candidate | None = None,
    system: str = "tissue",
    terms: Sequence[Term] | None = None,
) -> Proposal:
    """Look for a short formula for what a model is missing.

    Parameters
    ----------
    base : Candidate
        The base alone, judged on the experiment.
    before : Candidate, optional
        The best model that the catalogue gave; default the base.
    system : str
        What the base is a model of.
    terms : sequence of Term, optional
        Default the whole library.

    Returns
    -------
    Proposal
        Without a law where nothing is missing, and where no formula passes.
    """
    before = before or base
    none = Proposal(experiment, base, before, None, [], 0.0, 0.0, None, _range(experiment))
    return _searched(none, library() if terms is None else terms, system) if none.is_needed else none


def _searched(none: Proposal, terms: Sequence[Term], system: str) -> Proposal:
    """The proposal with what a search finds, beside the base and beside the catalogue's best model."""
    experiment, base, before = none.experiment, none.base, none.before
    chosen_on, confirmed_on = alternate(experiment)
    lower = thinned(experiment)
    search = Search(chosen_on if lower is experiment else alternate(lower)[0], terms)
    starts = [base] if before.effects == base.effects else [base, before]
    test = _Test(experiment, confirmed_on, before, len(terms), system)
    tried, passed = [], []
    for start in starts:
        for law in reversed(search.laws(_restarted(start, search.experiment))):
            law = _settled(law, start, experiment)
            refused = test.refuses(law)
            tried.append(Tried(law, refused))
            if not refused:
                passed.append(law)
                break
        if passed and is_adequate(passed[0].candidate, experiment):
            break  # on the base alone it leaves but noise: none beside effects is preferred to it
    if not passed:
        return replace(none, tried=tried)
    law = passed[0]
    if len(passed) > 1 and passed[1].candidate.test_rms * _NEARLY < law.candidate.test_rms:
        law = passed[1]
    return replace(
        none,
        law=law,
        tried=tried,
        share_removed=test.share_removed(law.fit),
        certainty=test.certainty(law),
        extrapolation=extrapolation(law.fit, experiment),
    )


def _restarted(start: Candidate, experiment: Experiment) -> Candidate:
    """The same model fitted to the training record of another experiment."""
    return evaluate(fit(start.fit.structure, experiment.training, start.fit.nonlinear), experiment)


def _settled(law: Law, start: Candidate, experiment: Experiment) -> Law:
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
    system: str

    def refuses(self, law: Law) -> str:
        """What a law fails; empty where it passes."""
        p_value = shipped(self.system).p_value(
            likelihood_ratio(law.start, law.candidate, self.experiment), self.terms
        )
        share = self.share_removed(law.fit)
        if p_value > LEVEL:
            return f"noise alone gives as much (p = {p_value:.2g})"
        if self.certainty(law) <= CONFIRMED:
            return f"it is not surely better on unseen records ({self.certainty(law):.1f} standard errors)"
        if share < LEAST_SHARE:
            return f"it removes {100 * share:.0f} % of what is missing on unseen records, less than three quarters"
        if not stays_bounded(law.fit, self.experiment):
            return f"its force runs away on motions {STRETCH:g} times as large or as fast"
        passive = self.system == "tissue" and "time" not in knows(law.terms)
        if passive and not is_dissipative(law.fit, self.experiment.training):
            return "it gives energy away in closed cycles"
        return ""

    def certainty(self, law: Law) -> float:
        """Standard errors by which the loss falls below that of the catalogue's best model."""
        return unseen_improvement(self.before, law.candidate, self.unseen)

    def share_removed(self, found: Fit) -> float:
        """Share of what the catalogue's best model leaves to explain."""
        noise = 0.0 if self.experiment.floor is None else self.experiment.floor.rms**2
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
