"""Steps for records with the force as input: searched with the motion as input, confirmed by simulation from the force."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.forward.forward_base import (
    EVALUATIONS,
    better_base,
    choose_between,
    choose_forward_base,
    exchange_between,
    fit_by_simulation,
    has_spring,
    prepare_forward,
    response_of,
    resume_fit,
    shorten,
    simulate_base,
    to_inverse_problem,
)
from lumbar.tissue.diagnosis.forward.sensor import sensor_candidates
from lumbar.tissue.diagnosis.selection.alternatives import linear_alternative, report_offsets
from lumbar.tissue.diagnosis.selection.candidate import (
    Candidate,
    add_form,
    fit_base,
    is_adequate,
    unseen_improvement,
)
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisState, Status
from lumbar.tissue.diagnosis.selection.forward_selection import Selection, after_selection, find_ties
from lumbar.tissue.diagnosis.selection.thresholds import TIED, UNSEEN
from lumbar.tissue.effects.catalogue import MOTION_SENSOR, filter_forms
from lumbar.tissue.models.bases import CHOSEN_BY_DATA, Base
from lumbar.tissue.models.driven_motion import can_be_simulated
from lumbar.tissue.models.form import Effect, Form

_RIVALS = 5
"""Number of sets of effects that are simulated in addition to the named sets."""
_MIN_EXPLAINED = 0.05
"""Share of the motion's variance that a base must explain if effects are to be searched."""
_FINAL_EVALUATIONS = 4
"""Largest number of evaluations of the error on whole records, starting from the fit to their beginnings."""


def estimate_motion_noise(state: DiagnosisState) -> DiagnosisState:
    """Prepare records with the force as input, and estimate the noise of the motion."""
    experiment = prepare_forward(state.records, state.settings)
    floor, unit = experiment.floor, experiment.output_unit
    noise = f"{floor.rms:.3g} {unit} from {floor.periods} periods" if floor else "unknown: no record repeats"
    return state.next("estimate the noise floor", noise, prepared=experiment)


def choose_simulated_base(state: DiagnosisState) -> DiagnosisState:
    """Choose the base with the beginning of long records; ignore the colour of the noise if the error is far above the noise."""
    prepared, base = _prepare_base(state.prepared, state.settings)
    experiment = shorten(prepared)
    reason = f"{base.fit.structure.base.name}: error {base.test_rms:.4g} {experiment.output_unit} on {experiment.test_data}"
    changes = {"prepared": prepared, "experiment": experiment, "base": base, "path": [base]}
    return state.next("choose the base", reason, **changes)


def select_by_simulation(state: DiagnosisState) -> DiagnosisState:
    """Select effects with the motion as input; keep what simulation from force to motion confirms."""
    experiment, base, data = state.result.experiment, state.result.base, state.result.experiment.training
    model = base.fit.structure.base
    variance = float(np.var(data.trim(data.force)))
    if state.inverse is None and base.train_rms**2 > (1 - _MIN_EXPLAINED) * variance:
        # The motion hardly follows the force: without a response no effect can be searched.
        return after_selection(state, _Confirmation(experiment, base, state.settings))
    # A base that leaves only noise lacks at most one effect.
    most = 1 if is_adequate(base, experiment) else None
    usable = state.settings.limit(forward_catalogue(state.settings.searched, model, data), most)
    response = response_of(model, base.fit.linear, base.fit.nonlinear)
    inverse = to_inverse_problem(experiment, response)
    search = Selection(inverse, fit_base(model, inverse), usable)
    named = search.fitted_path()
    rivals = [*search.ties(named[-1]), *search.best_sets(named[-1])]
    # A constant force shifts the motion by the static response.
    static = float(response(np.zeros(1))[0].real) if has_spring(model) else 0.0
    selection = _Confirmation(experiment, base, usable, named[1:], rivals, zero_factor=-static)
    return after_selection(state, selection, inverse=inverse)


def reconsider_simulated_base(state: DiagnosisState) -> DiagnosisState:
    """Choose base and course of the force again, with the selected effects; if either changes, select effects again."""
    step, result, experiment = "reconsider the base", state.result, state.result.experiment
    if state.inverse is None or not result.selected:
        return state.next(step, "not needed: no effect was selected")
    model = choose_between([result.model], experiment)
    course, other = model.fit.structure.force_between, None
    if state.settings.base == CHOSEN_BY_DATA:
        other = better_base(result.model, state.inverse)
    is_larger = other and len(other.linear) + len(other.nonlinear) > result.base.parameters
    named = " and ".join(result.selected)
    if other and not (is_larger and is_adequate(model, experiment)):
        base = simulate_base(experiment, other, course)
        reason = f"{other.name} explains the records better with {named}; effects are selected again"
        again = select_by_simulation(state.next(step, reason, base=base, path=[base]))
        if again.result.model.score < model.score:
            return again
    if course == result.base.fit.structure.force_between:
        tried = "no other base" if state.settings.base == CHOSEN_BY_DATA else "no other course of the force"
        return state.next(step, f"{tried} explains the records better with {named}")
    base = exchange_between(result.base, course, experiment)
    reason = f"a force that is {course} between samples explains the records better with {named}; effects are selected again"
    return select_by_simulation(state.next(step, reason, base=base, path=[base]))


def fit_whole_records(state: DiagnosisState) -> DiagnosisState:
    """Fit the same models and the best rival to the whole of long records, and judge these fits."""
    step, experiment = "fit whole records", state.prepared
    if state.result.experiment is experiment:
        return state.next(step, "not needed: the search has used whole records")
    base = resume_fit(experiment, state.result.base, _FINAL_EVALUATIONS)
    model, data = base.fit.structure.base, experiment.training
    usable = state.settings.limit(forward_catalogue(state.settings.searched, model, data))
    ranked, selected = [item.candidate for item in state.result.ranking], set(state.result.selected)
    rivals = [item for item in ranked if set(item.effects) != selected]
    named = [*state.result.path[1:], *state.result.tied_with, *rivals[:1]]
    selection = _Confirmation(experiment, base, usable, named)
    selection.evaluations = _FINAL_EVALUATIONS
    return find_ties(after_selection(state, selection, step))


def check_motion_sensor(state: DiagnosisState) -> DiagnosisState:
    """Select linear dynamics with a nonlinear sensor if they explain all records better than every model tried before."""
    step, experiment = "check the motion sensor", state.result.experiment
    if is_adequate(state.result.model, experiment):
        return state.next(step, "not needed: the model leaves only noise")
    forms = {name: state.settings.candidates[name].forms for name in MOTION_SENSOR}
    best = min([state.result.model.score, *(item.candidate.score for item in state.result.ranking)])
    for before, after in sorted(sensor_candidates(experiment, forms), key=lambda pair: pair[1].score):
        judge = Selection(experiment, before, state.settings, singles=[])
        better = unseen_improvement(state.result.model, after, experiment) > UNSEEN
        if not (better and after.score < best - TIED and judge.passes(before, after)):
            continue
        judge.tried = [after]
        share = judge.share_removed(after)
        error = f"{after.test_rms:.4g} {experiment.output_unit} on {experiment.test_data}"
        changes = {"base": before, "path": [before, after], "explainable_share_removed": share}
        changes |= {"status": judge.status(after, [], share), "tied_with": []}
        changes |= {"refined_status": judge.refined_status(after, None)}
        changes |= {"ranking": [*judge.ranking(after), *state.result.ranking], "tried": judge.tried}
        reason = f"{after.effects[-1]} of the sensor and linear dynamics leave {error}"
        return state.next(step, reason, **changes)
    return state.next(step, "no sensor that clips or gives the absolute value explains the records better")


def compare_motion_with_linear_dynamics(state: DiagnosisState) -> DiagnosisState:
    """Name nothing if linear dynamics of higher order explain the motion better."""
    step = "compare with linear dynamics"
    if is_adequate(state.result.model, state.prepared):
        return state.next(step, "not needed: the model leaves only noise")
    alternative = linear_alternative(state.result.model, state.prepared)
    if alternative is None:
        return state.next(step, "linear dynamics of higher order do not explain the records better")
    dynamics, finding = alternative
    error = f"{dynamics.test_rms:.4g} {state.prepared.output_unit}"
    reason = f"linear dynamics explain more: {error} on {state.prepared.test_data}, the model {state.result.model.test_rms:.4g}"
    unexplained = {"status": Status.UNEXPLAINED, "refined_status": Status.UNEXPLAINED, "tied_with": []}
    return state.next(step, reason, finding, **unexplained)


def report_motion_offset(state: DiagnosisState) -> DiagnosisState:
    """Report the zero of the motion's sensor if it is relevant."""
    findings = [replace(item, kind="motion_offset") for item in report_offsets(state.result)]
    reason = f"the zero is {'not ' * bool(findings)}where the records say"
    return state.next("report zeros", reason, *findings, is_searched_further=False)


FORWARD_STEPS = (
    estimate_motion_noise,
    choose_simulated_base,
    select_by_simulation,
    reconsider_simulated_base,
    find_ties,
    fit_whole_records,
    check_motion_sensor,
    compare_motion_with_linear_dynamics,
    report_motion_offset,
)


def _prepare_base(experiment: Experiment, settings: DiagnosisSettings) -> tuple[Experiment, Candidate]:
    """Return records without whitening if the error is far above the noise, and the base of the settings or the best base."""
    base = choose_forward_base(shorten(experiment), settings.base)
    if experiment.error_dwarfs_noise(base.train_rms):
        experiment = experiment.drop_whitening()
        base = resume_fit(shorten(experiment), base)
    return experiment, base


def forward_catalogue(catalogue: dict[str, Effect], base: Base, data: FitData) -> dict[str, Effect]:
    """Return the effects that can be simulated from force to motion and that the base does not contain, scaled to the data."""
    known = set(base.form.parsed_equation.columns)

    def is_usable(form: Form) -> bool:
        return can_be_simulated(form) and not known >= set(form.parsed_equation.columns)

    return filter_forms(catalogue, is_usable, data.scale)


class _Confirmation(Selection):
    """Selection by simulation among the models that the inverse problem has named, and rivals.

    `zero_factor` is the ratio of the zero of the motion's sensor to the zero of fits in the inverse problem.
    """

    evaluations: int = EVALUATIONS
    """Largest number of evaluations of the error to fit one model."""

    def __init__(
        self,
        experiment: Experiment,
        base: Candidate,
        settings: DiagnosisSettings,
        named: Sequence[Candidate] = (),
        rivals: Sequence[Candidate] = (),
        zero_factor: float = 1.0,
    ):
        super().__init__(experiment, base, settings, singles=[])
        self.named, self.rivals, self.zero_factor = named, rivals, zero_factor

    @cached_property
    def selected_path(self) -> list[Candidate]:
        """Path of simulated sets of effects that pass, in order of size, the best of each size."""
        self.simulate(self.named)
        rivals = self.rivals
        best = min([self.base, *self.tried], key=lambda item: item.score)
        if is_adequate(best, self.experiment):
            # Larger sets explain nothing more.
            rivals = [item for item in rivals if len(item.effects) <= len(best.effects)]
        self.simulate(rivals[:_RIVALS])
        path = [self.base]
        while True:
            passes = self.passes if len(path) == 1 else self.is_further
            effects = set(path[-1].effects)
            larger = [item for item in self.tried if set(item.effects) > effects and passes(path[-1], item)]
            if not larger:
                return path
            path.append(min(larger, key=lambda item: (len(item.effects), item.score)))

    def simulate(self, models: Sequence[Candidate]) -> None:
        """Fit models by simulation, each set of forms a single time."""
        known = {item.fit.structure.forms for item in self.tried}
        for item in models:
            structure = replace(self.base.fit.structure, forms=item.fit.structure.forms)
            if structure.forms and structure.forms not in known:
                known.add(structure.forms)
                start = item.fit.linear, item.fit.nonlinear, self.zero_factor * item.fit.zero
                fit = fit_by_simulation(self.experiment, structure, *start, self.evaluations)
                if np.isfinite(fit.score):
                    self.tried.append(fit)

    def continue_fit(self, model: Candidate) -> Candidate:
        """Continue the fit of a model by simulation."""
        return resume_fit(self.experiment, model, self.evaluations)

    def further(self, model: Candidate) -> Candidate | None:
        """Return None: only the sets of the search are simulated."""
        return None


def refine_forward(
    records: list[Record], effects: dict[str, Effect], settings: DiagnosisSettings
) -> tuple[Experiment, list[Candidate]]:
    """Add effects in the given order, each in the form that fits best in the inverse problem, and fit by simulation.

    Parameters
    ----------
    records : list of Record
        Records with the force as channel ``input`` and the motion as ``output``.
    effects : dict of str to Effect
        Effects by name.
    settings : DiagnosisSettings
        Base, training records and known effects.

    Returns
    -------
    Experiment, list of Candidate
        The prepared records and the path: base, base with the first effect and so on.

    Raises
    ------
    InputError
        For an effect that cannot be simulated from force to motion, or that the base contains.
    NumericalError
        If an effect makes the model worse.
    """
    experiment, base = _prepare_base(prepare_forward(records, settings), settings)
    model = base.fit.structure.base
    usable = forward_catalogue(effects, model, experiment.training)
    for name in effects:
        if name not in usable:
            known = ", ".join(forward_catalogue(settings.candidates, model, experiment.training))
            raise InputError(
                f"{name}: it cannot be added to {model.name} from force to motion. Use one of {known}."
            )
    short = shorten(experiment)
    inverse = to_inverse_problem(short, response_of(model, base.fit.linear, base.fit.nonlinear))
    searched = fit_base(model, inverse)
    path = [base if short is experiment else resume_fit(experiment, base)]
    for effect in usable.values():
        added = [add_form(searched, form, inverse) for form in effect.forms]
        searched = min(added, key=lambda item: item.score)
        structure = replace(base.fit.structure, forms=searched.fit.structure.forms)
        start = searched.fit.linear, searched.fit.nonlinear, path[-1].fit.zero
        fitted = fit_by_simulation(short, structure, *start)
        fitted = fitted if short is experiment else resume_fit(experiment, fitted)
        if fitted.fit.squared_error > path[-1].fit.squared_error * (1 + 1e-6):
            raise NumericalError(
                f"{effect.name} raises the error on {experiment.training.name} from {path[-1].train_rms:.4g} to "
                f"{fitted.train_rms:.4g} {experiment.output_unit}. Leave it out."
            )
        path.append(fitted)
    return experiment, path
