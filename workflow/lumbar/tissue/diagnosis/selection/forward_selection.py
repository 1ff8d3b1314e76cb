"""Selection of missing effects: forward selection with look-ahead over pairs and a backward pass.

Every candidate is refitted jointly with base and effects. Candidates are compared by the likelihood of the training
record and of the unseen records together: a wrong effect also lowers the training error, but not the unseen error.
"""

from collections.abc import Callable
from functools import cached_property
from itertools import islice

import numpy as np

from lumbar.base.formats import percent
from lumbar.base.progress import track
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.joint_fit import fit, screen
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates
from lumbar.tissue.diagnosis.noise.input_relation import kind_of_noise
from lumbar.tissue.diagnosis.residuals.residual import probability
from lumbar.tissue.diagnosis.selection import thresholds
from lumbar.tissue.diagnosis.selection.candidate import (
    Candidate,
    add_form,
    best_by_effect,
    contradictions,
    drop_effect,
    is_adequate,
    is_neutral,
    is_worthwhile,
    leaves_noise,
    likelihood_ratio,
    loss_improvement,
    order_effects,
    refit,
    refit_from_starts,
    sort_by_score,
    unseen_improvement,
)
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisState, Ranked, Status
from lumbar.tissue.models.form import Effect, Form

LOOK_AHEAD = 3
"""Number of first effects that are tried together with a second effect."""
REFITTED = 5
"""Number of effects that are refitted after screening; the first round refits all."""
EXCHANGED = 3
"""Number of effects that are tried, in all their forms, instead of a removed effect."""
_MAX_REFITS = 3
"""Largest number of times that the fit of a selected model is continued if it has not converged."""
_EARLY_SHARE = 0.6
"""Share of the training record from which the rest is predicted."""
_AKAIKE_COST = 2.0
_MEDIAN_THIRD_DIFFERENCE = 0.6745 * np.sqrt(20.0)
"""Median size of the third differences of white noise, in its standard deviations."""
_RANKED_SETS = 10


def extend(
    model: Candidate,
    catalogue: dict[str, Effect],
    experiment: Experiment,
    most: int | None = None,
    all_forms: bool = True,
) -> list[Candidate]:
    """Add each effect of the catalogue that the model lacks; return every refitted form, best first.

    Only the `most` effects with the best screening are refitted; None refits all. With `all_forms`, all forms of an effect are
    refitted, general forms only if simpler forms fail and general forms remove `MOST_OF_REST` of the error that these leave;
    otherwise only the form with the best screening is refitted.
    """
    others = [effect for effect in catalogue.values() if effect.name not in model.effects]
    every = [form for effect in others for form in effect.forms]
    forms = [form for form in every if not form.general]
    if most is not None:
        # Only forms of the effects that screening ranks first.
        screened = {form.key: screen(model.fit, form, experiment.training)[0][0] for form in forms}
        first: dict[str, Form] = {}
        for form in sorted(forms, key=lambda item: screened[item.key]):
            first.setdefault(form.effect, form)
        effects = list(first)[:most]
        forms = [
            form for form in forms if form.effect in effects and (all_forms or form is first[form.effect])
        ]
    names = " and ".join([model.fit.structure.base.name, *model.effects])
    extended = [
        add_form(model, form, experiment) for form in track(forms, f"forms of effects fitted with {names}")
    ]
    if all_forms:
        # General forms may replace those of the best effects; of all effects if none of the best leaves only noise, because
        # the simpler forms of the right effect may be far from it.
        ranked = best_by_effect(extended)
        enough = any(is_adequate(item, experiment) for item in ranked[:LOOK_AHEAD])
        simpler = {item.effects[-1]: item for item in (ranked[:LOOK_AHEAD] if enough else ranked)}
        for form in every:
            best = simpler.get(form.effect)
            if form.general and best is not None and not is_adequate(best, experiment):
                general = add_form(model, form, experiment)
                rest = max(best.train_rms**2 - experiment.noise**2, 0.0)
                if best.train_rms**2 - general.train_rms**2 >= thresholds.MOST_OF_REST * rest:
                    extended.append(general)
    return sorted(extended, key=lambda item: item.score)


def exchange(
    model: Candidate,
    catalogue: dict[str, Effect],
    experiment: Experiment,
    polished: Callable[[list[Candidate]], list[Candidate]] = list,
) -> Candidate:
    """Replace each effect in turn by the form that fits best, of the same or another effect."""
    for name in model.effects:
        others = extend(drop_effect(model, name, experiment), catalogue, experiment, EXCHANGED)
        best = min(polished(others), key=lambda item: item.score)
        if best.score < model.score - 1.0:
            model = best
    return model


class Selection:
    """State of a selection: the candidates tried so far and the selected effects."""

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
        self.null = thresholds.null_distribution(settings.system)
        self.forms = thresholds.number_of_forms(settings.catalogue)
        self.singles = extend(base, settings.catalogue, experiment) if singles is None else singles
        self.tried = list(self.singles)
        self.contradicting: dict[Candidate, bool] = {}

    def fitted_path(self) -> list[Candidate]:
        """Select effects and return the path from the base to the model, its last fit continued to the optimum."""
        *before, model = self.selected_path
        if model is self.base:
            return [model]
        for _ in range(_MAX_REFITS):
            if model.fit.converged:
                break
            model = self.continue_fit(model)
        return [*before, refit_from_starts(model, self.experiment)]

    def polished(self, models: list[Candidate]) -> list[Candidate]:
        """Return models, best first, some refitted with parameters that are fixed in their base; one axis has none."""
        return models

    def continue_fit(self, model: Candidate) -> Candidate:
        """Continue the fit of a model that has not converged."""
        return refit(model.fit.structure, model.fit.nonlinear, self.experiment)

    def p_value(self, before: Candidate, after: Candidate) -> float:
        """Return the probability of as large a gain by the best of all forms if nothing is missing."""
        return self.null.p_value(likelihood_ratio(before, after, self.experiment), self.forms)

    def passes(self, before: Candidate, after: Candidate) -> bool:
        """Return whether an effect may be selected: significant in training and on unseen records, and consistent."""
        experiment = self.experiment
        largest = before.test_rms if experiment.floor else thresholds.BLIND * before.test_rms
        is_test = not experiment.is_unseen_at_rest
        if (is_test and after.test_rms >= largest) or self.p_value(before, after) > thresholds.LEVEL:
            return False
        # A hold does not test what acts during motion, and a few ramps have few independent errors: there a model that leaves
        # only noise is enough.
        is_better = is_test and unseen_improvement(before, after, experiment) > thresholds.UNSEEN
        if not (is_better or self.leaves_only_noise(before, after)):
            if not is_test:
                return False
            # An effect that accumulates hardly shows in short records, in which it begins again: the later part of the
            # training record counts, after a fit to its beginning.
            added = set(after.effects) - set(before.effects)
            if not any(self.settings.candidates[name].accumulates for name in added):
                return False
            training = experiment.training
            early, later = training.cache.compute_once(
                "early and later", lambda: training.split(_EARLY_SHARE)
            )
            fits = [fit(item.fit.structure, early, item.fit.nonlinear) for item in (before, after)]
            if loss_improvement(*fits, [later]) <= thresholds.UNSEEN:
                return False
        return not self.contradicts(after)

    def leaves_only_noise(self, before: Candidate, after: Candidate) -> bool:
        """Return whether a larger model leaves only noise and the smaller model more than that."""
        return is_adequate(after, self.experiment) and not is_adequate(before, self.experiment)

    def contradicts(self, model: Candidate) -> bool:
        """Return whether a model contradicts the names of its effects."""
        if model not in self.contradicting:
            self.contradicting[model] = bool(contradictions(model.fit, self.experiment))
        return self.contradicting[model]

    def is_further(self, before: Candidate, after: Candidate) -> bool:
        """Return whether an effect passes and explains more than the slight error of the smaller model's form."""
        return self.passes(before, after) and is_worthwhile(self.base, before, after, self.experiment)

    @cached_property
    def selected_path(self) -> list[Candidate]:
        """Path from the base to the model, with effects selected one after the other."""
        experiment, catalogue, most = self.experiment, self.settings.catalogue, self.settings.most_effects
        # The best effect may pass only with its own axes.
        singles = [*self.singles, *self.polished(self.singles[:1])]
        single = next((item for item in singles if self.passes(self.base, item)), None)
        path = [self.base] if single is None else [self.base, single]
        if is_adequate(path[-1], experiment) or most < 2:
            return path
        # The best pair, if it is worth a second effect; pairs are tried even if no single effect passes. Further first effects
        # are not tried as soon as a pair leaves only noise; `exchange` looks for others like it.
        pairs: list[Candidate] = []
        for first in best_by_effect(self.singles)[:LOOK_AHEAD]:
            start = self.polished([first])[0]
            pairs += self.polished(extend(start, catalogue, experiment, REFITTED, all_forms=False))
            if any(is_adequate(pair, experiment) for pair in pairs):
                break
        pairs.sort(key=lambda item: item.score)
        self.tried += pairs
        first = next((item for item in pairs if self.is_further(path[-1], item)), None)
        if first is None:
            return path
        best = exchange(first, catalogue, experiment, self.polished)
        is_better = best.test_rms <= first.test_rms * 1.001 and self.is_further(path[-1], best)
        model = best if is_better else first
        # Further effects as long as they are worth it.
        while len(model.effects) < most and not is_adequate(model, experiment):
            more = extend(model, catalogue, experiment, most=4)
            self.tried += more
            best = next((item for item in more if self.is_further(model, item)), None)
            if best is None:
                break
            model = best
        return self.ordered_path(model)

    def ordered_path(self, model: Candidate) -> list[Candidate]:
        """Return models from the base to the model: each adds the effect that helps most; effects without benefit are dropped."""
        forms = list(model.fit.structure.forms)
        path = [self.base]
        while forms:
            longer = (add_form(path[-1], form, self.experiment) for form in forms)
            best = min(longer, key=lambda item: item.score)
            forms = [form for form in forms if form.effect != best.effects[-1]]
            if not forms and best.score > model.score:
                # The last one is the model itself, with its effects in the order in which they help.
                best = order_effects(model, best.effects)
            path.append(best)
        while len(path) > 2 and not self.passes(path[-2], path[-1]):
            path.pop()
        return path

    def ties(self, model: Candidate) -> list[Candidate]:
        """Return other sets of at most the same number of effects that explain all records equally well.

        Each further parameter of another set counts 2 (Akaike, IEEE Trans. Autom. Control 19 (1974) 716-723), not the logarithm
        of the records' size: the sampling rate must not distinguish sets that explain all records equally well. A set with an
        effect that does not act is a simpler set under another name.
        """
        if model is self.base:
            return []
        discount = float(np.log(self.experiment.size)) - _AKAIKE_COST
        likely = [
            item
            for item in self.tried
            if set(item.effects) != set(model.effects)
            and len(item.effects) <= len(model.effects)
            and item.score - model.score - max(item.parameters - model.parameters, 0) * discount
            < thresholds.TIED
        ]
        return best_by_effect([item for item in likely if not is_neutral(item.fit, self.experiment)])

    def share_removed(self, model: Candidate) -> float:
        """Return the share of the base's unseen error variance, without known noise, that the effects remove."""
        explainable = max(self.base.test_rms**2 - self.experiment.noise**2, 0.0)
        removed = max(self.base.test_rms**2 - model.test_rms**2, 0.0)
        return float(min(removed / explainable, 1.0)) if explainable > removed else float(removed > 0)

    def status(self, model: Candidate, tied: list[Candidate], share: float) -> Status:
        """Return the status of the base."""
        if model is self.base:
            lacking = self.periods_differ or not leaves_noise(self.base, self.experiment)
            return Status.UNEXPLAINED if lacking else Status.ADEQUATE
        least = thresholds.EXPLAINS
        if self.experiment.floor is None and model.test_rms > thresholds.MANY_SCATTERS * self._scatter:
            least = thresholds.EXPLAINS_NEARLY_ALL
        # In a hold any force of time explains most of the error.
        is_share_enough = self.experiment.floor is not None or not self.experiment.is_one_way
        explains = (is_share_enough and share >= least) or is_adequate(model, self.experiment)
        if not (model.fit.converged and explains):
            return Status.UNEXPLAINED
        return Status.TIED if tied else Status.NAMED

    @property
    def _scatter(self) -> float:
        """RMS noise of the unseen forces, from third differences of neighbouring samples: slow forces hardly change them."""
        steps = np.concatenate([np.diff(item.trim(item.force), 3) for item in self.experiment.tests])
        return float(np.median(np.abs(steps))) / _MEDIAN_THIRD_DIFFERENCE

    @property
    def periods_differ(self) -> bool:
        """True if the response changes from period to period: something is missing, even if it raises the floor."""
        floor = self.experiment.floor
        return floor is not None and floor.changing_response_rms > thresholds.STRUCTURED * floor.rms

    def further(self, model: Candidate) -> Candidate | None:
        """Return the refined model with the effect that one more step of the search would add.

        Return None if the model leaves only noise, and for the base, with which every single effect has been tried. A step that
        the search has already made from this model is not repeated.
        """
        if model is self.base or is_adequate(model, self.experiment):
            return None
        forms = {form.key for form in model.fit.structure.forms}
        made = [item for item in self.tried if {form.key for form in item.fit.structure.forms[:-1]} == forms]
        made = made or extend(model, self.settings.catalogue, self.experiment, REFITTED)
        made = [item for item in made if self.is_further(model, item)]
        return min(made, key=lambda item: item.score, default=None)

    def refined_status(self, model: Candidate, further: Candidate | None) -> Status:
        """Return the status of the refined model."""
        if further is not None:
            return Status.NAMED
        if self.periods_differ and not any(self.settings.candidates[name].changes for name in model.effects):
            return Status.UNEXPLAINED  # an effect of time or path is missing
        is_complete = leaves_noise(model, self.experiment, thresholds.COMPLETE)
        return Status.ADEQUATE if is_complete else Status.UNEXPLAINED

    def best_sets(self, model: Candidate) -> list[Candidate]:
        """Return the selected set, then the other sets that were tried, best first."""
        chosen = [] if model is self.base else [model]
        sets = (
            item
            for item in sort_by_score(best_by_effect(self.tried))
            if set(item.effects) != set(model.effects)
        )
        acting = (item for item in sets if not is_neutral(item.fit, self.experiment))
        return [*chosen, *islice(acting, _RANKED_SETS - len(chosen))]

    def ranking(self, model: Candidate) -> list[Ranked]:
        """Return `best_sets` with p-values and parameters."""
        training, units = self.experiment.training, (self.experiment.input_unit, self.experiment.output_unit)
        return [
            Ranked(item, self.p_value(self.base, item), estimates(item.fit, training, *units))
            for item in self.best_sets(model)
        ]


def select_effects(state: DiagnosisState, kind: type[Selection] = Selection) -> DiagnosisState:
    """Select the effects that the base lacks, by forward selection; `kind` is the class of the search."""
    return after_selection(state, kind(state.result.experiment, state.result.base, state.settings))


def after_selection(
    state: DiagnosisState, selection: Selection, step: str = "select effects", **changes
) -> DiagnosisState:
    """Return the state with the selected path and other changes."""
    path, experiment = selection.fitted_path(), selection.experiment
    changes |= {"experiment": experiment, "base": selection.base, "selection": selection, "path": path}
    unit, base, model = experiment.output_unit, path[0], path[-1]
    reason = "no effect passes"
    if model.effects:
        errors = f"from {base.test_rms:.4g} to {model.test_rms:.4g} {unit}"
        reason = (
            f"selected: {' and '.join(model.effects)}; the error on {experiment.test_data} falls {errors}"
        )
    elif selection.tried:
        best = min(selection.tried, key=lambda item: item.score)
        chance = f"{probability(selection.p_value(base, best))}, at most {thresholds.LEVEL:g} is needed"
        error = f"{best.test_rms:.4g} {unit} on {experiment.test_data}"
        reason += f"; the best, {' and '.join(best.effects)}, leaves {error} ({chance})"
    return state.next(step, reason, **changes)


def find_ties(state: DiagnosisState) -> DiagnosisState:
    """Compare the selected model with all other sets of effects that were tried, and judge base and model."""
    selection, model = state.selection, state.result.model
    tied, share = selection.ties(model), selection.share_removed(model)
    status, further = selection.status(model, tied, share), selection.further(model)
    others = ", ".join(" and ".join(item.effects) for item in tied)
    likely = f"as likely: {others}" if others else "no other set of effects is as likely"
    return state.next(
        "find ties",
        f"{percent(share)} of what a model could explain is removed; {likely}",
        status=status,
        refined_status=status if model is selection.base else selection.refined_status(model, further),
        tied_with=tied,
        explainable_share_removed=share,
        further=further,
        ranking=selection.ranking(model),
        tried=best_by_effect(selection.tried),
    )


def report_noise(state: DiagnosisState) -> DiagnosisState:
    """Report the kind of the noise that a complete model leaves, if it is not the noise of the floor."""
    step, model, experiment = "report other noise", state.result.model, state.result.experiment
    if state.result.refined_status != Status.ADEQUATE or is_adequate(model, experiment, thresholds.COMPLETE):
        return state.next(
            step, "not needed: the model is incomplete, or the noise it leaves is white or known"
        )
    record, unit = experiment.training.records[0], experiment.output_unit
    rms = model.fit.rms(record)
    kind, description = kind_of_noise(model.fit.errors(record), record.motion.sampling_time)
    sentence = (
        f"{record.name}: the error left ({rms:.3g} {unit}) has no relation to the {experiment.input_quantity} and counts as "
        f"noise; it is {description}."
    )
    return state.next(step, description, Finding(kind, sentence, rms, unit, record.name))
