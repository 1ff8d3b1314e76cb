"""Search of a short formula: terms of the library added one by one, each time refitted jointly with the base.

Every term at every starting value is screened by the part of the residual that it explains beyond the tangent space of the model
(the first-order effect of a refit). The best terms are refitted and judged on the training record and on every other block of the
unseen records. The two best laws are lengthened (orthogonal forward regression with a beam: Chen, Billings and Luo, Int. J.
Control 50 (1989) 1873-1896).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from lumbar.tissue.diagnosis.fitting.fit_data import JointData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, fit, nonlinear_starts, shape_bounds, solve_linear
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import added_forces, project_out, tangent_basis
from lumbar.tissue.diagnosis.law.law_form import distinct, form_of, symbols_of
from lumbar.tissue.diagnosis.law.terms import Term
from lumbar.tissue.diagnosis.selection.candidate import Candidate, evaluate, is_adequate, unseen_improvement
from lumbar.tissue.diagnosis.selection.thresholds import UNSEEN, WORTHWHILE
from lumbar.tissue.models.form import Place
from lumbar.tissue.models.structure import Structure, forces_of

_MAX_STATES = 4
"""Largest number of states of a law."""
MAX_TERMS = 3
"""Largest number of terms of a law, so that its formula is short."""
REFITTED = 6
"""Number of terms that are refitted after screening."""
STARTS = 2
"""Number of starting values that are refined per term."""
BEAM = 2
"""Number of laws of one length that are lengthened."""
_STEPS = tuple(np.geomspace(1 / reach, reach, 31) for reach in (1.25, 1.015))
"""Factors by which a parameter is multiplied, first coarse and then fine, in a search across steps of the error."""
_BOUND_DISTANCE = 0.01
"""Relative distance from a bound within which a parameter counts as at the bound."""
_SAME_ERROR = 1e-6
"""Largest relative difference of errors on the same step."""
_MIN_NOISE_SHARE = 0.1
"""Smallest share of the noise's variance that a further term must remove."""
_SEARCHED_PERIODS = 3
"""Number of periods that the search uses if the training record only repeats."""


@dataclass(frozen=True, eq=False)
class Law:
    """Terms added to a model, fitted jointly with it."""

    start: Candidate
    """Model that the terms are added to."""
    terms: tuple[Term, ...]
    candidate: Candidate
    """Model with the terms, judged on the blocks that are used for choices."""
    shared: bool = False
    """True if terms share parameters with the same meaning."""

    @property
    def fit(self) -> Fit:
        """Fit of the model with the terms."""
        return self.candidate.fit

    @property
    def term_parameters(self) -> np.ndarray:
        """Nonlinear parameters of the terms."""
        return self.fit.nonlinear[len(self.start.fit.nonlinear) :]


class Search:
    """One search in a library of terms; choices are made with the tests of the experiment."""

    def __init__(self, experiment: Experiment, library):
        training, floor = experiment.training, experiment.floor
        if floor is not None and floor.structured_rms <= 0 and not isinstance(training, JointData):
            # The record only repeats: a few of its periods are enough.
            time = training.drop_history(training.motion.time)
            share = _SEARCHED_PERIODS * floor.period / (time[-1] - time[0])
            training = training.split(share)[0] if share < 1 else training
        self.experiment = replace(experiment, training=training)
        self.library = tuple(library)

    @cached_property
    def columns(self) -> list[tuple]:
        """Every term at every starting value, with its whitened forces on the record for screening."""
        data, columns = self.experiment.training, []
        zeros = np.zeros(len(data.force))
        for term in self.library:
            if term.place is Place.OUTPUT:
                continue
            form = form_of((term,))
            for start in nonlinear_starts(form, data, zeros):
                with np.errstate(all="ignore"):
                    forces = data.whiten(forces_of(form, data.motion, start))
                if np.isfinite(forces).all():
                    columns.append((term, start, forces.astype(np.float32)))
        return columns

    def screen(self, model: Fit, with_output: bool) -> list[tuple[float, Term, np.ndarray]]:
        """Return the squares of the residual that every term explains at every starting value, the largest first."""
        data, columns = self.experiment.training, list(self.columns)
        basis, error = tangent_basis(model, [data]), data.force - model.simulate(data.motion)
        if with_output:
            for term in self.library:
                if term.place is Place.OUTPUT:
                    form = form_of((term,))
                    for start in nonlinear_starts(form, data, error):
                        columns.append((term, start, added_forces(model, form, data, start)))
        residual = project_out(basis, data.whiten(error))
        screened = ((project_out(basis, forces), term, start) for term, start, forces in columns)
        explained = [(_explained(forces, residual), term, start) for forces, term, start in screened]
        return sorted(explained, key=lambda item: -item[0])

    def lengthen(self, law: Law) -> list[Law]:
        """Return the best laws with one more term, best first."""
        bare = not law.terms
        if not bare and law.terms[0].place is Place.OUTPUT:
            return []
        starts: dict[str, list] = {}
        for _, term, start in self.screen(law.fit, bare):
            states = sum(len(item.state) for item in (*law.terms, term))
            if states <= _MAX_STATES and all(item.name != term.name for item in law.terms):
                known = starts.setdefault(term.name, [])
                if len(known) < STARTS:
                    known.append((term, start))
            if sum(len(item) == STARTS for item in starts.values()) >= REFITTED and len(starts) >= REFITTED:
                break
        longer = [
            self.refit(law, (*law.terms, term), np.concatenate([law.term_parameters, start]))
            for group in list(starts.values())[:REFITTED]
            for term, start in group
        ]
        best: dict[str, Law] = {}
        for item in sorted(filter(None, longer), key=lambda item: item.candidate.score):
            best.setdefault(item.terms[-1].name, item)
        return list(best.values())

    def refit(
        self, law: Law, terms: tuple[Term, ...], nonlinear: np.ndarray, shared: bool = False
    ) -> Law | None:
        """Fit terms jointly with the model; None if the fit fails or ends at a bound, at which a term becomes another."""
        structure = law.start.fit.structure.with_form(form_of(terms, shared=shared))
        before = law.fit.nonlinear[: len(law.start.fit.nonlinear)]
        start = np.concatenate([before, nonlinear])
        if any("where" in text for term in terms for text in term.parts):
            start = self.refine_derivative_free(structure, start, len(before))
        fitted = fit(structure, self.experiment.training, start)
        if not np.isfinite(fitted.squared_error):
            return None
        values = fitted.nonlinear
        low, high = shape_bounds(fitted.structure, self.experiment.training, values)
        at_bound = (values <= low * (1 + _BOUND_DISTANCE)) | (values >= high * (1 - _BOUND_DISTANCE))
        if at_bound[len(before) :].any():
            return self.limiting_law(law, terms, values[len(before) :], shared)
        candidate = evaluate(fitted, self.experiment)
        return Law(law.start, terms, candidate, shared) if np.isfinite(candidate.score) else None

    def limiting_law(
        self, law: Law, terms: tuple[Term, ...], nonlinear: np.ndarray, shared: bool
    ) -> Law | None:
        """Replace exponential terms by their limit; None without exponential terms, or if the law already has the limit."""
        names = [term.becomes or term.name for term in terms]
        plain = tuple(item for name in names for item in self.library if item.name == name)
        if names == [term.name for term in terms] or len(set(names)) < len(terms) or len(plain) < len(terms):
            return None
        value = dict(zip(symbols_of(terms, shared), nonlinear, strict=True))
        left = [
            value[renamed.symbol]
            for term, renamed_term in zip(terms, distinct(terms, shared), strict=True)
            for item, renamed in zip(term.nonlinear, renamed_term.nonlinear, strict=True)
            if not (term.becomes and item.symbol == "z_e")
        ]
        each = [item.symbol for term in distinct(plain, shared) for item in term.nonlinear]
        return self.refit(law, plain, np.array(list(dict(zip(each, left, strict=True)).values())), shared)

    def exchange(self, law: Law) -> Law:
        """Replace each term in turn by the term that fits best instead of it, as long as the score improves."""
        for term in law.terms[: len(law.terms) if len(law.terms) > 1 else 0]:
            rest = tuple(item for item in law.terms if item.name != term.name)
            if len(rest) == len(law.terms):
                continue
            is_left = [item.name != term.name for item in law.terms for _ in item.nonlinear]
            shorter = self.refit(law, rest, law.term_parameters[np.array(is_left, dtype=bool)])
            longer = [] if shorter is None else self.lengthen(shorter)
            if longer and longer[0].candidate.score < law.candidate.score - 1.0:
                law = longer[0]
        return law

    def simplify(self, law: Law) -> Law:
        """Share parameters with the same meaning between terms if the score improves."""
        value = dict(zip(symbols_of(law.terms), law.term_parameters, strict=True))
        joined = symbols_of(law.terms, shared=True)
        if len(joined) == len(value):
            return law
        start = np.array([value[symbol] for symbol in joined])
        shared = self.refit(law, law.terms, start, shared=True)
        return law if shared is None or shared.candidate.score > law.candidate.score else shared

    def refine_derivative_free(self, structure: Structure, nonlinear: np.ndarray, first: int) -> np.ndarray:
        """Improve nonlinear parameters one by one without derivatives, because the error has steps if a force switches."""
        data = self.experiment.training
        force = data.whiten(data.force)

        def squared_error(point: np.ndarray) -> float:
            design = data.whiten(structure.design(data.motion, point))
            return float(np.sum((force - design @ solve_linear(design, force, structure.signs)) ** 2))

        best = nonlinear.copy()
        for index, factors in product(range(first, len(nonlinear)), _STEPS):
            tried = best[index] * factors
            here = np.arange(len(best)) == index
            errors = np.array([squared_error(np.where(here, value, best)) for value in tried])
            # All values of a step fit equally well; take its middle.
            best[index] = np.median(tried[errors <= errors.min() * (1 + _SAME_ERROR)])
        return best

    def laws(self, start: Candidate) -> list[Law]:
        """Return the best law of every worthwhile length, the shortest first."""
        noise = self.experiment.noise**2
        least = max(WORTHWHILE * max(start.train_rms**2 - noise, 0.0), _MIN_NOISE_SHARE * noise)
        beam, best, model = [Law(start, (), start)], [], start
        for _ in range(MAX_TERMS):
            # One more term must explain a notable share of the training record and improve unseen blocks.
            longer = [
                item
                for law in beam
                for item in self.lengthen(law)
                if model.train_rms**2 - item.candidate.train_rms**2 >= least
                and unseen_improvement(model, item.candidate, self.experiment) > UNSEEN
            ]
            if not longer:
                break
            beam = sorted(longer, key=lambda item: item.candidate.score)[:BEAM]
            best.append(self.simplify(self.exchange(beam[0])))
            model = best[-1].candidate
            if is_adequate(model, self.experiment):
                break
        return best


def _explained(columns: np.ndarray, residual: np.ndarray) -> float:
    """Return the squares of the residual that columns explain."""
    size = np.sqrt(np.sum(columns**2, axis=0))
    if not size.min() > 1e-12 * size.max():
        return 0.0
    scaled = (columns / size).astype(float)
    if scaled.shape[1] == 1:
        return float((scaled[:, 0] @ residual) ** 2)
    fitted = scaled @ np.linalg.lstsq(scaled, residual, rcond=1e-6)[0]
    return float(fitted @ fitted)
