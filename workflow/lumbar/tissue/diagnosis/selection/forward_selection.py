"""Which effects are missing: forward selection with look-ahead over pairs and a backward pass.

Every candidate is refitted jointly with base and effects. Candidates are compared by the likelihood of the training
record and of the unseen records together: a wrong effect also lowers the training error, but not the others'.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np

from lumbar.base.progress import track
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, screen
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates
from lumbar.tissue.diagnosis.selection.candidate import (
    Candidate,
    add_form,
    best_by_effect,
    by_score,
    contradictions,
    drop_effect,
    is_adequate,
    is_worthwhile,
    later_improvement,
    likelihood_ratio,
    refit,
    refit_from_starts,
    unseen_improvement,
    with_forms,
)
from lumbar.tissue.diagnosis.selection.result import DiagnosisState, Ranked, Status
from lumbar.tissue.diagnosis.selection.thresholds import (
    BLIND,
    COMPLETE,
    EXPLAINS,
    LEVEL,
    MOST_OF_REST,
    STRUCTURED,
    TIED,
    UNSEEN,
    null_distribution,
    number_of_forms,
)
from lumbar.tissue.models.form import Effect, Form

LOOK_AHEAD = 3
"""Number of first effects that are tried with a second one."""
REFITTED = 5
"""Number of effects that are refitted after screening; the first round refits all."""
EXCHANGED = 3
"""Number of effects that are tried, in all their forms, instead of one that is taken out."""
_MORE_FITS = 3
"""Largest number of times that the fit of a selected model is continued if it has not converged."""
_AKAIKE = 2.0
_SHOWN = 10
"""Number of sets of effects in a ranking."""


def extend(
    model: Candidate,
    catalogue: dict[str, Effect],
    experiment: Experiment,
    most: int | None = None,
    all_forms: bool = True,
) -> list[Candidate]:
    """Add each effect of the catalogue that the model does not have; every refitted form is returned, best first.

    Parameters
    ----------
    most : int or None
        Refit only this many effects, those with the best screening; None refits all.
    all_forms : bool
        Refit all forms of an effect, or only the one with the best screening. With all forms, general ones are tried if
        simpler ones fail, if they remove `MOST_OF_REST` of what these leave.
    """
    every = [
        form for effect in catalogue.values() if effect.name not in model.effects for form in effect.forms
    ]
    forms = [form for form in every if not form.general]
    if most is not None:
        forms = _promising(model.fit, forms, experiment, most, all_forms)
    tried = track(
        forms,
        f"forms of effects fitted beside {' and '.join([model.fit.structure.base.name, *model.effects])}",
    )
    found = [add_form(model, form, experiment) for form in tried]
    if all_forms:
        # General forms may stand in for the best effects; for all where none of these leaves only noise: the simpler forms of
        # what is right may be far from it.
        ranked = best_by_effect(found)
        enough = any(is_adequate(item, experiment) for item in ranked[:LOOK_AHEAD])
        simpler = {item.effects[-1]: item for item in (ranked[:LOOK_AHEAD] if enough else ranked)}
        for form in every:
            best = simpler.get(form.effect)
            if form.general and best is not None and not is_adequate(best, experiment):
                general = add_form(model, form, experiment)
                rest = max(best.train_rms**2 - experiment.noise**2, 0.0)
                if best.train_rms**2 - general.train_rms**2 >= MOST_OF_REST * rest:
                    found.append(general)
    return sorted(found, key=lambda item: item.score)


def _promising(fit: Fit, forms: list[Form], experiment: Experiment, most: int, all_forms: bool) -> list[Form]:
    """Forms of the effects that screening ranks first."""
    screened = {form.key: screen(fit, form, experiment.training)[0][0] for form in forms}
    ranked = sorted(forms, key=lambda item: screened[item.key])
    first: dict[str, Form] = {}
    for form in ranked:
        first.setdefault(form.effect, form)
    effects = list(first)[:most]
    return [form for form in forms if form.effect in effects and (all_forms or form is first[form.effect])]


def pairs(
    singles: list[Candidate],
    catalogue: dict[str, Effect],
    experiment: Experiment,
    polished: Callable[[list[Candidate]], list[Candidate]],
) -> list[Candidate]:
    """Pairs of effects that begin with one of the best single ones, best first.

    Further first effects are not tried once a pair leaves nothing but noise; `exchange` looks for others like it. `polished`
    fits candidates on, the best one first, where a search holds something fixed.
    """
    found: list[Candidate] = []
    for first in best_by_effect(singles)[:LOOK_AHEAD]:
        found += polished(extend(polished([first])[0], catalogue, experiment, REFITTED, all_forms=False))
        if any(is_adequate(pair, experiment) for pair in found):
            break
    return sorted(found, key=lambda item: item.score)


def exchange(
    model: Candidate,
    catalogue: dict[str, Effect],
    experiment: Experiment,
    polished: Callable[[list[Candidate]], list[Candidate]] = list,
) -> Candidate:
    """Take out each effect in turn and put back whatever then fits best: another form, another effect or it itself."""
    for name in model.effects:
        found = extend(drop_effect(model, name, experiment), catalogue, experiment, EXCHANGED)
        best = min(polished(found), key=lambda item: item.score)
        if best.score < model.score - 1.0:
            model = best
    return model


class Selection:
    """One diagnosis under way: the candidates tried so far and what was selected."""

    def __init__(
        self,
        experiment: Experiment,
        base: Candidate,
        settings: DiagnosisSettings,
        singles: list[Candidate] | None = None,
    ):
        self.experiment = experiment
        self.base = base
        self.settings = settings
        self.null = null_distribution(settings.system)
        self.forms = number_of_forms(settings.catalogue)
        self.singles = extend(base, settings.catalogue, experiment) if singles is None else singles
        self.tried = list(self.singles)
        self.contradicting: dict[Candidate, bool] = {}

    def fitted_path(self) -> list[Candidate]:
        """Select effects and return the path from the base to the model, its last fit continued to the optimum."""
        *before, model = self.selected_path
        return [*before, self.converge(model)]

    def polished(self, models: list[Candidate]) -> list[Candidate]:
        """Return models, the best first, some refitted with what their base keeps fixed; along one axis nothing is fixed."""
        return models

    def converge(self, model: Candidate) -> Candidate:
        """Continue the fit of a model that has not converged; take the fit from another start if that is better."""
        if model is self.base:
            return model
        for _ in range(_MORE_FITS):
            if model.fit.converged:
                break
            model = self.continue_fit(model)
        return refit_from_starts(model, self.experiment)

    def continue_fit(self, model: Candidate) -> Candidate:
        """Continue the fit of a model."""
        return refit(model.fit.structure, model.fit.nonlinear, self.experiment)

    def p_value(self, before: Candidate, after: Candidate) -> float:
        """Return the probability that the best of all forms gains as much if nothing is missing."""
        return self.null.p_value(likelihood_ratio(before, after, self.experiment), self.forms)

    def passes(self, before: Candidate, after: Candidate) -> bool:
        """Whether an effect may be selected: no false alarm in training, significantly better on unseen records, consistent."""
        experiment = self.experiment
        largest = before.test_rms if experiment.floor else BLIND * before.test_rms
        if after.test_rms >= largest or self.p_value(before, after) > LEVEL:
            return False
        if unseen_improvement(before, after, experiment) <= UNSEEN:
            # An effect that accumulates hardly shows in short records: the later part of the training record counts.
            added = set(after.effects) - set(before.effects)
            accumulating = any(self.settings.candidates[name].accumulates for name in added)
            if not accumulating or later_improvement(before, after, experiment) <= UNSEEN:
                return False
        if after not in self.contradicting:
            self.contradicting[after] = bool(contradictions(after.fit, experiment))
        return not self.contradicting[after]

    def is_further(self, before: Candidate, after: Candidate) -> bool:
        """Return whether an effect passes and explains more than the slight error of the smaller model's form."""
        return self.passes(before, after) and is_worthwhile(self.base, before, after, self.experiment)

    @cached_property
    def selected_path(self) -> list[Candidate]:
        """Select effects one after the other; return the path from the base to the model."""
        single = next((item for item in self.singles if self.passes(self.base, item)), None)
        path = [self.base] if single is None else [self.base, single]
        if is_adequate(path[-1], self.experiment) or self.settings.most_effects < 2:
            return path
        pair = self.best_pair(path[-1])
        return path if pair is None else self.further_path(pair)

    def best_pair(self, before: Candidate) -> Candidate | None:
        """Return the best pair if it is worth a second effect; pairs are tried even where no single effect passes."""
        found = pairs(self.singles, self.settings.catalogue, self.experiment, self.polished)
        self.tried += found
        found = [item for item in found if self.is_further(before, item)]
        if not found:
            return None
        best = exchange(found[0], self.settings.catalogue, self.experiment, self.polished)
        return best if best.test_rms <= found[0].test_rms * 1.001 else found[0]

    def further_path(self, pair: Candidate) -> list[Candidate]:
        """Add effects to a pair while they are worth it, drop what has become needless, order what is left."""
        model = pair
        while len(model.effects) < self.settings.most_effects and not is_adequate(model, self.experiment):
            more = extend(model, self.settings.catalogue, self.experiment, most=4)
            self.tried += more
            best = next((item for item in more if self.is_further(model, item)), None)
            if best is None:
                break
            model = best
        return self.ordered_path(model)

    def ordered_path(self, model: Candidate) -> list[Candidate]:
        """Models from the base to the model: each adds the effect that helps most; needless ones are dropped."""
        forms = list(model.fit.structure.forms)
        path = [self.base]
        while forms:
            found = [add_form(path[-1], form, self.experiment) for form in forms]
            best = min(found, key=lambda item: item.score)
            forms = [form for form in forms if form.effect != best.effects[-1]]
            if not forms and best.score > model.score:
                # The last one is the model itself, with its effects in the order in which they help.
                own = {form.effect: form for form in model.fit.structure.forms}
                best = replace(model, fit=with_forms(model.fit, [own[name] for name in best.effects]))
            path.append(best)
        while len(path) > 2 and not self.passes(path[-2], path[-1]):
            path.pop()
        return path

    def ties(self, model: Candidate) -> list[Candidate]:
        """Other sets of as many effects that explain all records as well."""
        if model is self.base:
            return []
        return [
            item
            for item in best_by_effect([*self.tried, model])
            if set(item.effects) != set(model.effects)
            and len(item.effects) <= len(model.effects)
            and self.lead(model, item) < TIED
        ]

    def lead(self, model: Candidate, other: Candidate) -> float:
        """By how much a model is more likely than another one, in twice the log-likelihood.

        Each parameter that the other one has more counts 2 (Akaike, IEEE Trans. Autom. Control 19 (1974) 716-723), not the
        logarithm of the records' size: how often the sensors are read must not tell apart what explains all records alike.
        """
        more = max(other.parameters - model.parameters, 0)
        return other.score - model.score - more * (float(np.log(self.experiment.size)) - _AKAIKE)

    def share_removed(self, model: Candidate) -> float:
        """Share of the base's variance on unseen records, that of known noise aside, that the effects remove."""
        explainable = max(self.base.test_rms**2 - self.experiment.noise**2, 0.0)
        removed = max(self.base.test_rms**2 - model.test_rms**2, 0.0)
        return float(min(removed / explainable, 1.0)) if explainable > removed else float(removed > 0)

    def status(self, model: Candidate, tied: list[Candidate], share: float) -> Status:
        """Status of the base."""
        if model is self.base:
            lacking = self.periods_differ or not is_adequate(self.base, self.experiment)
            return Status.UNEXPLAINED if lacking else Status.ADEQUATE
        if not model.fit.converged or (share < EXPLAINS and not is_adequate(model, self.experiment)):
            return Status.UNEXPLAINED
        return Status.TIED if tied else Status.NAMED

    @property
    def periods_differ(self) -> bool:
        """Whether periods differ by more than noise: something is missing, even where it raises the floor."""
        floor = self.experiment.floor
        return floor is not None and floor.certain_structure_rms > STRUCTURED * floor.rms

    def further(self, model: Candidate) -> Candidate | None:
        """Diagnose the refined model: what one more step of the search would add, however many effects it has.

        Nothing is looked for beyond a model that leaves only noise, nor beyond the base, whose every single effect has
        been tried. A step that the search has made from this very model is not made again.
        """
        if model is self.base or is_adequate(model, self.experiment):
            return None
        forms = {form.key for form in model.fit.structure.forms}
        made = [item for item in self.tried if {form.key for form in item.fit.structure.forms[:-1]} == forms]
        found = made or extend(model, self.settings.catalogue, self.experiment, REFITTED)
        found = [item for item in found if self.is_further(model, item)]
        return min(found, key=lambda item: item.score, default=None)

    def refined_status(self, model: Candidate, further: Candidate | None) -> Status:
        """Status of the refined model."""
        if further is not None:
            return Status.NAMED
        if self.periods_differ and not any(self.settings.candidates[name].changes for name in model.effects):
            return Status.UNEXPLAINED  # an effect of time or path is missing
        return Status.ADEQUATE if is_adequate(model, self.experiment, COMPLETE) else Status.UNEXPLAINED

    def best_sets(self, model: Candidate) -> list[Candidate]:
        """Return the selected set, then the other sets tried, best first."""
        chosen = [] if model is self.base else [model]
        sets = by_score(best_by_effect([*self.tried, *chosen]))
        return [*chosen, *(item for item in sets if set(item.effects) != set(model.effects))][:_SHOWN]

    def ranking(self, model: Candidate) -> list[Ranked]:
        """Return `best_sets` with p-values and parameters."""
        training, units = self.experiment.training, (self.experiment.input_unit, self.experiment.output_unit)
        return [
            Ranked(item, self.p_value(self.base, item), estimates(item.fit, training, *units))
            for item in self.best_sets(model)
        ]


def select_effects(state: DiagnosisState) -> DiagnosisState:
    """Select the effects that the base lacks, by forward selection."""
    result = state.result
    return after_selection(state, Selection(result.experiment, result.base, state.settings))


def after_selection(
    state: DiagnosisState, selection: Selection, step: str = "select effects", **changes
) -> DiagnosisState:
    """Return the state with the path that a selection has found, and other changes."""
    path = selection.fitted_path()
    changes |= {
        "experiment": selection.experiment,
        "base": selection.base,
        "selection": selection,
        "path": path,
    }
    return state.next(step, _selection_reason(selection, path), **changes)


def _selection_reason(selection: Selection, path: list[Candidate]) -> str:
    """Say which effects were selected and how the error fell, or how near the best of them came."""
    unit, base, model = selection.experiment.output_unit, path[0], path[-1]
    if model.effects:
        errors = f"from {base.test_rms:.4g} to {model.test_rms:.4g} {unit}"
        return f"selected: {' and '.join(model.effects)}; the error on unseen records falls {errors}"
    if not selection.tried:
        return "no effect passes"
    best = min(selection.tried, key=lambda item: item.score)
    chance = f"p = {selection.p_value(base, best):.2g}, at most {LEVEL:g} is needed"
    return f"no effect passes; the best, {' and '.join(best.effects)}, leaves {best.test_rms:.4g} {unit} unseen ({chance})"


def find_ties(state: DiagnosisState) -> DiagnosisState:
    """Compare the selected model with all other sets that were tried, and judge the base and the model."""
    selection, model = state.selection, state.result.model
    tied, share = selection.ties(model), selection.share_removed(model)
    status, further = selection.status(model, tied, share), selection.further(model)
    others = ", ".join(" and ".join(item.effects) for item in tied)
    removed = f"{100 * share:.3g} % of what a model could explain is removed"
    return state.next(
        "find ties",
        f"{removed}; as likely: {others}" if others else f"{removed}; no other set of effects is as likely",
        status=status,
        refined_status=status if model is selection.base else selection.refined_status(model, further),
        tied_with=tied,
        explainable_share_removed=share,
        further=further,
        ranking=selection.ranking(model),
    )
