"""What a model of tissue in space is missing: from records of several axes to a result."""

from dataclasses import replace

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.selection.candidate import Candidate, with_forms
from lumbar.tissue.diagnosis.selection.forward_selection import Selection, extend
from lumbar.tissue.diagnosis.selection.refine import added_in_turn
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult, Status
from lumbar.tissue.diagnosis.selection.thresholds import TIED
from lumbar.tissue.diagnosis.spatial.force_channels import exchanged_channels
from lumbar.tissue.diagnosis.spatial.spatial_base import KINDS, choose_base, freed, held, likelier
from lumbar.tissue.diagnosis.spatial.spatial_data import prepare
from lumbar.tissue.diagnosis.spatial.spatial_findings import SENSOR, spatial_findings
from lumbar.tissue.effects.catalogue import choose, usable_effects
from lumbar.tissue.models.bases import CHOSEN_BY_DATA
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.space import force_sensor_effects

_PROMISING = 8
"""Effects, those with the best screening, that are refitted where axes were chosen anew."""
_ROUNDS = 3
"""Times that base and axes are chosen anew beside the effects that were selected."""


def diagnose(records: list[Record], settings: DiagnosisSettings) -> DiagnosisResult:
    """Diagnose what a base is missing on records of several axes, as `lumbar.tissue.diagnosis.selection.diagnose`.

    Raises
    ------
    InputError
        For a base that is not one of `KINDS`, and as `prepare`.
    """
    experiment = prepare(records, settings)
    axes = records[0].axes
    settings = replace(settings, catalogue=usable_in_space(settings.searched, axes, experiment))
    kinds = _kinds(settings)
    exchanged = exchanged_channels(experiment, axes, settings.layout)
    if exchanged is not None:
        base, told = choose_base(experiment, axes, kinds), (*experiment.faults, exchanged)
        return DiagnosisResult(
            experiment, base, Status.UNEXPLAINED, [base], [], [], 0.0, Status.UNEXPLAINED, findings=told
        )
    result = _search(experiment, settings, axes, kinds)
    if experiment.error_dwarfs_noise(result.model.train_rms):
        result = _search(experiment.without_whitening(), settings, axes, kinds)
    return replace(result, findings=(*experiment.faults, *spatial_findings(result, axes)))


def refine(
    records: list[Record], effects: list[str], settings: DiagnosisSettings
) -> tuple[Experiment, list[Candidate]]:
    """Add effects to the base that the records ask for beside them, as `lumbar.tissue.diagnosis.selection.refine`."""
    experiment = prepare(records, settings)
    axes, kinds = records[0].axes, _kinds(settings)
    known, without = usable_in_space(settings.candidates, axes, experiment), {}
    for effect in choose(effects, {**settings.candidates, **known}):
        if effect.name not in known:
            without |= effect.in_space(axes)[1] or {effect.name: f"needs another axis than {', '.join(axes)}"}
    if without:
        raise InputError("; ".join(f"{key}: {why}" for key, why in without.items()))
    usable = {name: known[name] for name in effects}
    base = choose_base(experiment, axes, kinds)
    for _ in range(_ROUNDS):
        path = added_in_turn(experiment, held(base, experiment), usable)
        better = _better_base(path[-1], experiment, axes, kinds)
        if better is None:
            break
        base = better
    else:
        path = added_in_turn(experiment, base, usable)
    return experiment, [freed(item, experiment) for item in path]


def in_space(catalogue: dict[str, Effect], axes: tuple[str, ...]) -> dict[str, Effect]:
    """Effects of a catalogue that have a form in space, and those of the force sensor."""
    read = {name: effect.in_space(axes)[0] for name, effect in catalogue.items()}
    return {name: effect for name, effect in read.items() if effect is not None} | force_sensor_effects(axes)


def usable_in_space(
    catalogue: dict[str, Effect], axes: tuple[str, ...], experiment: Experiment
) -> dict[str, Effect]:
    """Those of `in_space` that the records have the channels for."""
    training = experiment.training
    return usable_effects(in_space(catalogue, axes), training.motion.channels, training.scale)[0]


def _kinds(settings: DiagnosisSettings) -> tuple[str, ...]:
    if settings.base == CHOSEN_BY_DATA:
        return KINDS
    if settings.base in KINDS:
        return (str(settings.base),)
    name = settings.base if isinstance(settings.base, str) else settings.base.name
    raise InputError(f"improvement.base: {name} has no form in space; there are auto, {', '.join(KINDS)}")


def _search(
    experiment: Experiment, settings: DiagnosisSettings, axes: tuple[str, ...], kinds: tuple[str, ...]
) -> DiagnosisResult:
    """Choose base, symmetry and axes and select effects, until the effects no longer change what is chosen.

    One effect at first: beside axes that are not right yet a second one would be looked for in vain.
    """
    base, singles = choose_base(experiment, axes, kinds), None
    alone = replace(settings, most_effects=1)
    for chosen in (alone, *[settings] * _ROUNDS):
        selection = _Selection(experiment, held(base, experiment), chosen, singles)
        better = _better_base(selection.selected_path[-1], experiment, axes, kinds)
        if better is not None:
            base = better
            singles = extend(base, settings.catalogue, experiment, most=_PROMISING)
            continue
        singles = selection.singles
        if chosen is settings:
            break
    else:
        selection = _Selection(experiment, base, settings, singles)
    found = selection.result()
    path = [freed(item, experiment) for item in found.path]
    return replace(found, base=path[0], path=path)


def _better_base(
    model: Candidate, experiment: Experiment, axes: tuple[str, ...], kinds: tuple[str, ...]
) -> Candidate | None:
    """The base, without the effects, that the records ask for beside a model's effects; None where the model has it.

    Another one, or the same with its axes elsewhere.
    """
    structure = model.fit.structure
    if not model.effects:
        return None
    acting = model.fit.nonlinear[len(structure.base.nonlinear) :]
    turned, again = freed(model, experiment), choose_base(experiment, axes, kinds, structure.forms, acting)
    best = likelier(experiment, turned, again)
    if best is turned and turned.score > model.score - TIED:
        return None
    return held(replace(best, fit=with_forms(best.fit, ())), experiment)


class _Selection(Selection):
    """A search with the principal axes where they are, which pairs of effects have fitted anew."""

    def polished(self, models: list[Candidate]) -> list[Candidate]:
        """Models with their axes where they fit best: of the best one, and of effects of the sensor, which turn them."""
        return [
            held(freed(item, self.experiment), self.experiment)
            if item is models[0] or item.effects[-1] in SENSOR
            else item
            for item in models
        ]
