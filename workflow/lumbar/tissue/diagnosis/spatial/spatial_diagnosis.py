"""Diagnosis of records of several axes: its steps, and the fit of a base with given effects."""

from dataclasses import replace
from functools import partial

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.selection.base_choice import reweigh_errors
from lumbar.tissue.diagnosis.selection.candidate import Candidate, select_forms
from lumbar.tissue.diagnosis.selection.diagnosis_result import UNUSABLE, DiagnosisState
from lumbar.tissue.diagnosis.selection.forward_selection import Selection, after_selection, extend, find_ties
from lumbar.tissue.diagnosis.selection.refine import add_in_turn
from lumbar.tissue.diagnosis.selection.thresholds import TIED
from lumbar.tissue.diagnosis.spatial.spatial_base import KINDS, choose_base, choose_likelier, refit_axes
from lumbar.tissue.diagnosis.spatial.spatial_data import prepare
from lumbar.tissue.diagnosis.spatial.spatial_findings import SENSOR, exchanged_channels, report_mounting
from lumbar.tissue.effects.catalogue import choose, usable_effects
from lumbar.tissue.models.bases import CHOSEN_BY_DATA
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.space import force_sensor_effects

_MAX_REFITTED_EFFECTS = 8
"""Number of effects, the best in screening, that are refitted after axes were chosen again."""
_MAX_ROUNDS = 3
"""Largest number of times that base and axes are chosen again with the selected effects."""


def prepare_axes(state: DiagnosisState) -> DiagnosisState:
    """Repair sensor faults and estimate the noise, axis by axis; leave out effects without a form in space."""
    experiment, axes = prepare(state.records, state.settings), state.records[0].axes
    usable = usable_in_space(state.settings.searched, experiment)
    floor, unit = experiment.floor, experiment.output_unit
    noise = f"{floor.rms:.3g} {unit} per axis" if floor else "unknown: no record repeats"
    faults = ", ".join(f"{item.kind.replace('_', ' ')} in {item.record}" for item in experiment.faults)
    changes = {"prepared": experiment, "experiment": experiment, "settings": state.settings.limit(usable)}
    reason = f"axes {', '.join(axes)}; noise {noise}; sensor faults: {faults or 'none'}; {len(usable)} effects can be tried"
    return state.next("estimate the noise floor", reason, *experiment.faults, **changes)


def check_channels(state: DiagnosisState) -> DiagnosisState:
    """Stop without a search of effects if the channels of the force are exchanged."""
    step, experiment, kinds = "check channels", state.result.experiment, _kinds(state.settings)
    finding = exchanged_channels(experiment, state.settings.layout)
    if finding is None:
        return state.next(step, "channels of force and position belong to the same axes")
    base = choose_base(experiment, kinds)
    reason = "the channels of the force are not those of the axes of the position"
    return state.next(step, reason, finding, base=base, path=[base], **UNUSABLE)


def select_in_space(state: DiagnosisState) -> DiagnosisState:
    """Choose base, symmetry and axes and select effects, until the selected effects no longer change this choice."""
    experiment, settings = state.result.experiment, state.settings
    base, singles = choose_base(experiment, _kinds(settings)), None
    # A single effect first: with wrong axes the search of a second one is futile.
    single_effect = settings.limit(settings.catalogue, most_effects=1)
    for chosen in (single_effect, *[settings] * _MAX_ROUNDS):
        selection = SpatialSelection(experiment, refit_axes(base, experiment, free=False), chosen, singles)
        better = _better_base(selection.selected_path[-1], experiment, settings)
        if better is not None:
            base = better
            singles = extend(base, settings.catalogue, experiment, most=_MAX_REFITTED_EFFECTS)
            continue
        singles = selection.singles
        if chosen is settings:
            break
    else:
        selection = SpatialSelection(experiment, base, settings, singles)
    return after_selection(state, selection, "choose the base and select effects")


def free_axes(state: DiagnosisState) -> DiagnosisState:
    """Fit the principal axes together with the other parameters."""
    experiment = state.result.experiment
    path = [refit_axes(item, experiment, free=True) for item in state.result.path]
    error = f"error {path[-1].test_rms:.4g} {experiment.output_unit}"
    return state.next("fit the axes", f"{error} unseen with the axes fitted too", base=path[0], path=path)


SEARCH_IN_SPACE = (select_in_space, find_ties, free_axes)
SPATIAL_STEPS = (
    prepare_axes,
    check_channels,
    *SEARCH_IN_SPACE,
    partial(reweigh_errors, search=SEARCH_IN_SPACE),
    report_mounting,
)


def refine(
    records: list[Record], effects: list[str], settings: DiagnosisSettings
) -> tuple[Experiment, list[Candidate]]:
    """Choose a base together with effects and add them in turn; see `lumbar.tissue.diagnosis.selection.refine`.

    Raises
    ------
    InputError
        For an effect without a form in space, or an effect that needs other axes.
    """
    experiment = prepare(records, settings)
    axes = records[0].axes
    known, without = usable_in_space(settings.candidates, experiment), {}
    for effect in choose(effects, {**settings.candidates, **known}):
        if effect.name not in known:
            without |= effect.to_space(axes)[1] or {effect.name: f"needs another axis than {', '.join(axes)}"}
    if without:
        raise InputError("; ".join(f"{key}: {why}" for key, why in without.items()))
    usable = {name: known[name] for name in effects}
    base = choose_base(experiment, _kinds(settings))
    for _ in range(_MAX_ROUNDS):
        path = add_in_turn(experiment, refit_axes(base, experiment, free=False), usable)
        better = _better_base(path[-1], experiment, settings)
        if better is None:
            break
        base = better
    else:
        path = add_in_turn(experiment, base, usable)
    return experiment, [refit_axes(item, experiment, free=True) for item in path]


def effects_in_space(catalogue: dict[str, Effect], axes: tuple[str, ...]) -> dict[str, Effect]:
    """Return the effects of a catalogue that have a form in space, and the effects of the force sensor."""
    read = {name: effect.to_space(axes)[0] for name, effect in catalogue.items()}
    return {name: effect for name, effect in read.items() if effect is not None} | force_sensor_effects(axes)


def usable_in_space(catalogue: dict[str, Effect], experiment: Experiment) -> dict[str, Effect]:
    """Return the effects of `effects_in_space` for which the records have all channels."""
    training, in_space = experiment.training, effects_in_space(catalogue, experiment.records[0].axes)
    return usable_effects(in_space, training.motion.channels, training.scale)[0]


def _kinds(settings: DiagnosisSettings) -> tuple[str, ...]:
    if settings.base == CHOSEN_BY_DATA:
        return KINDS
    if settings.base in KINDS:
        return (str(settings.base),)
    name = settings.base if isinstance(settings.base, str) else settings.base.name
    raise InputError(f"improvement.base: {name} has no form in space. Use auto, {', '.join(KINDS)}.")


def _better_base(model: Candidate, experiment: Experiment, settings: DiagnosisSettings) -> Candidate | None:
    """Return the base (equation, symmetry, axes) that the records require with a model's effects; None without a better base."""
    structure = model.fit.structure
    if not model.effects:
        return None
    acting = model.fit.nonlinear[len(structure.base.nonlinear) :]
    rotated = refit_axes(model, experiment, free=True)
    chosen = choose_base(experiment, _kinds(settings), structure.forms, acting)
    best = choose_likelier(experiment, rotated, chosen)
    if best is rotated and rotated.score > model.score - TIED:
        return None
    return refit_axes(replace(best, fit=select_forms(best.fit, ())), experiment, free=False)


class SpatialSelection(Selection):
    """A search with fixed principal axes; the axes are fitted again for the most promising models."""

    def polished(self, models: list[Candidate]) -> list[Candidate]:
        """Fit the axes of the best model and of models with an effect of the sensor, which rotates axes; then fix them."""
        return [
            refit_axes(refit_axes(item, self.experiment, free=True), self.experiment, free=False)
            if item is models[0] or item.effects[-1] in SENSOR
            else item
            for item in models
        ]
