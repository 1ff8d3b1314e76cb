"""Which physical effect a model is missing: from records to a verdict, by way of the base that the data ask for."""

from dataclasses import replace

import numpy as np
import scipy

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings, prepare_for
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import fit
from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base as fit_structure
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates
from lumbar.tissue.diagnosis.linear.direction import direction_or_sign
from lumbar.tissue.diagnosis.selection.candidate import (
    Candidate,
    best_by_effect,
    evaluate,
    exchange_base,
    fit_base,
    is_adequate,
    is_worthwhile,
    refit,
    with_forms,
)
from lumbar.tissue.diagnosis.selection.findings import (
    apparent_zeros,
    falling_stiffness,
    linear_alternative,
    offsets,
    trained_otherwise,
    whatever_the_speed,
    zeros_moved,
)
from lumbar.tissue.diagnosis.selection.forward_selection import Selection, extend
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult, Status, effects_text
from lumbar.tissue.diagnosis.selection.thresholds import EXPLAINS, TIED
from lumbar.tissue.effects.catalogue import TISSUE, usable_effects
from lumbar.tissue.models.bases import BASES, CHOSEN_BY_DATA, Base
from lumbar.tissue.models.form import Effect, Form
from lumbar.tissue.models.structure import Structure

_NONLINEAR = 0.1
"""Share of what the best linear model leaves that is surely not linear, from which on something nonlinear is missing."""
_ZEROS_HELP = 0.9
"""Factor on the unseen error below which a zero of its own for every record is taken."""


def diagnose(records: list[Record], settings: DiagnosisSettings | None = None) -> DiagnosisResult:
    """Diagnose what a base model is missing on a set of records.

    There is one record per excitation, with channels ``input`` and ``output``.
    """
    settings = settings or DiagnosisSettings()
    if settings.forward:
        from lumbar.tissue.diagnosis.forward.forward_diagnosis import diagnose_forward

        return diagnose_forward(records, settings)
    if any(record.points for record in records):
        from lumbar.tissue.diagnosis.selection.static_points import diagnose_points

        return diagnose_points(records, settings, _met_at_surface)
    experiment = prepare_for(records, settings)
    known = settings.candidates
    usable, not_tried = usable_effects(
        settings.searched, experiment.training.motion.channels, experiment.training.scale
    )
    settings = replace(settings, catalogue=usable)
    if settings.system == "tissue" and not isinstance(settings.base, Base):
        # As recorded: a command that jumps between levels would be taken for a coarse sensor, and smoothed.
        as_recorded = settings.prepare(records) if experiment.faults else experiment
        turned = direction_or_sign(as_recorded, settings.layout)
        if turned is not None:
            return replace(_unexplained(as_recorded, settings, turned), not_tried=not_tried)
    found = _search(experiment, settings)
    if experiment.error_dwarfs_noise(found.model.train_rms):
        found = _search(experiment.without_whitening(), settings)
    found, zeros = _with_own_zeros(found, settings)
    found, linear = _beside_linear(found, settings)
    found, leads = _beside_lead(found, settings)
    told = [*experiment.faults, *offsets(found), *zeros, *leads, *linear]
    if settings.system == "tissue":
        found, rates = whatever_the_speed(found, {**known, **usable})
        told += [*rates, *trained_otherwise(found, settings), *falling_stiffness(found.experiment)]
    return replace(found, not_tried=not_tried, findings=tuple(told))


def _with_own_zeros(
    found: DiagnosisResult, settings: DiagnosisSettings
) -> tuple[DiagnosisResult, list[Finding]]:
    """Search again with a zero of its own for every record, where the model or a smaller one does much better with them.

    Where records differ in their zeros, what accumulates (a drift) may pass for the difference. Where they do not, a model that
    lacks a relaxation would have them differ all the same: a zero of its own counts only where the record begins with it.
    """
    experiment = found.experiment
    if settings.system != "tissue" or experiment.own_zeros:
        return found, []
    with_zeros = experiment.with_own_zeros()

    def helps(item: Candidate) -> bool:
        refitted = refit(item.fit.structure, item.fit.nonlinear, with_zeros)
        return refitted.test_rms < _ZEROS_HELP * item.test_rms

    accumulating = any(settings.candidates[name].accumulates for name in found.selected)
    if not (accumulating or any(helps(item) for item in found.path)):
        return found, []
    again = _search(with_zeros, settings)
    better = again.model.test_rms < _ZEROS_HELP * found.model.test_rms
    simpler = len(again.selected) < len(found.selected)
    as_good = again.model.test_rms < found.model.test_rms / _ZEROS_HELP
    if not (better or (simpler and as_good)):
        return found, []
    if zeros_moved(again):
        return again, []
    if set(found.selected) != set(again.selected):
        # What is named hangs on zeros that did not move.
        found = replace(found, status=Status.UNEXPLAINED, tied_with=[])
    after = Status.UNEXPLAINED if found.refined_status == Status.ADEQUATE else found.refined_status
    return replace(found, refined_status=after), [apparent_zeros(again)]


def _beside_linear(
    found: DiagnosisResult, settings: DiagnosisSettings
) -> tuple[DiagnosisResult, list[Finding]]:
    """Ask whether linear dynamics of higher order explain more than the effects that were selected.

    If so, and nothing nonlinear is left beside them, only linear effects are searched for. If something nonlinear is, no
    effect of the catalogue explains it.
    """
    experiment = found.experiment
    only_linear = bool(found.selected) and all(settings.candidates[name].linear for name in found.selected)
    if settings.system != "tissue" or (is_adequate(found.model, experiment) and not only_linear):
        return found, []
    alternative = linear_alternative(found.model, experiment)
    if alternative is None:
        return found, []
    from lumbar.tissue.diagnosis.linear.linear_dynamics import nonlinear_share
    from lumbar.tissue.diagnosis.linear.poles import linear_base

    linear, finding = alternative
    base = linear_base(linear.fit.poles, linear.fit.held)
    found = replace(found, linear=base and fit_base(base, experiment))
    if (nonlinear_share(experiment, linear.fit) or 0.0) > _NONLINEAR:
        return replace(found, status=Status.UNEXPLAINED, tied_with=[]), [finding]
    only = {name: effect for name, effect in settings.candidates.items() if effect.linear}
    if not set(found.selected) <= set(only):
        again = _search(experiment, replace(settings, catalogue=only))
        if linear_alternative(again.model, experiment) is None:
            return again, [finding]
        found = replace(again, linear=found.linear)
    return replace(found, status=Status.UNEXPLAINED, tied_with=[]), [finding]


def _beside_lead(
    found: DiagnosisResult, settings: DiagnosisSettings
) -> tuple[DiagnosisResult, list[Finding]]:
    """Ask whether a force that leads explains more than the linear effects that were selected: it is no mechanism."""
    linear = {name for name in found.selected if settings.candidates[name].linear}
    finding = None if settings.system != "tissue" else force_leads(found.model, found.experiment, linear)
    if finding is None:
        return found, []
    stands = not linear and is_adequate(found.model, found.experiment)
    return (found if stands else replace(found, status=Status.UNEXPLAINED, tied_with=[])), [finding]


def _unexplained(experiment: Experiment, settings: DiagnosisSettings, turned: Finding) -> DiagnosisResult:
    """No effect is looked for in records whose input and output, or a sign, are the wrong way round."""
    experiment, base = choose_base(experiment, settings.base, settings.candidates)
    return DiagnosisResult(
        experiment, base, Status.UNEXPLAINED, [base], [], [], 0.0, Status.UNEXPLAINED, findings=(turned,)
    )


def _search(experiment: Experiment, settings: DiagnosisSettings) -> DiagnosisResult:
    """Choose the base and select effects; once they are known, choose the base again."""
    experiment, base = choose_base(experiment, settings.base, settings.candidates)
    found = Selection(experiment, base, settings).result()
    if settings.base != CHOSEN_BY_DATA or found.model is found.base:
        return found
    other = base_beside(found.model, experiment)
    if other is None:
        return found
    return Selection(*choose_base(experiment, other, settings.candidates), settings).result()


TISSUE_BASES = ("KB", "KV", "Maxwell", "LE")
"""Bases of a fastened tool that are tried."""
CONTACT_BASES = ("KB-contact", "KV-contact", "LE-contact")
"""Bases of a tool that is not fastened to the tissue."""
_SURFACES = 40
"""Depths at which the surface is looked for."""
_SEARCHED = 0.06
"""Share of the range about the first surface in which the best one is sought."""
_SPRINGS = 0.9
"""Squared error of a spring that is met, in those of a fastened one, up to which contact is tried."""
_WITH_EFFECT = 3
"""Effects, those with the best screening, with which the surface is sought again."""
_LEAST_SHARE = 0.03
"""Share of the samples that must lie above the surface."""
_FLAT = 0.1
"""Spread of the force above the surface, in those of the whole record, up to which nothing is touched there."""


def choose_base(
    experiment: Experiment, name: str | Base, catalogue: dict[str, Effect]
) -> tuple[Experiment, Candidate]:
    """Fit the base that is named, or the one that the data ask for.

    By the likelihood of all records and the number of parameters. A base with contact must beat a fastened one with any
    single effect: one that likewise loses the tissue, or one that clips the force.

    `name` is a key of `lumbar.tissue.models.bases.BASES`, a base of one's own, or `CHOSEN_BY_DATA`. The experiment's
    positions are counted from the tissue's surface where the base is one with contact.
    """
    # Surfaces are positions as recorded, also where a base is chosen again.
    experiment = experiment.with_origin(experiment.rest[0])
    if isinstance(name, Base):
        return experiment, fit_base(name, experiment)
    if name != CHOSEN_BY_DATA:
        if BASES[name].contact:
            return _surface_of_refined(*at_surface(experiment, (name,)), catalogue)
        return experiment, fit_base(BASES[name], experiment)
    fastened = min((fit_base(BASES[base], experiment) for base in TISSUE_BASES), key=lambda item: item.score)
    if not _springs_show_contact(experiment):
        return experiment, fastened
    rivals = [fastened, *extend(fastened, catalogue, experiment)]
    if any(is_adequate(item, experiment) for item in rivals):
        return experiment, fastened
    from_surface, touching = at_surface(experiment, CONTACT_BASES)
    from_surface, touching = _surface_of_refined(from_surface, touching, catalogue)
    if touching.score < min(item.score for item in rivals):
        return from_surface, touching
    return experiment, fastened


def _springs_show_contact(experiment: Experiment) -> bool:
    """Whether a spring that is met at a surface leaves less than a fastened one, by more than a clipped response would."""
    surface = first_surface(experiment)
    if surface is None:
        return False
    fastened, touched = (
        fit_base(BASES["LE"], experiment),
        fit_base(BASES["LE-contact"], experiment.with_origin(surface)),
    )
    return touched.fit.squared_error < _SPRINGS * fastened.fit.squared_error


def base_beside(model: Candidate, experiment: Experiment) -> str | None:
    """Name of the base that surely explains all records better with the same effects; None where there is none.

    What a model lacks may have passed for a Maxwell branch as long as it was lacking. A base without fewer parameters
    must be worth them as a further effect must: a branch can take up a little of any model's error, and its spring then tells on
    the other parameters (a mass m beside a dashpot b is m + bτ beside a branch).
    """
    mine = model.fit.structure.base
    bases = [BASES[name] for name in (CONTACT_BASES if mine.contact else TISSUE_BASES) if name != mine.name]
    bare = fit_base(mine, experiment)
    found = [
        item
        for item in (exchange_base(model, base, experiment) for base in bases)
        if item.score < model.score - TIED
        and (item.parameters < model.parameters or is_worthwhile(bare, model, item, experiment))
    ]
    best = min(found, key=lambda item: item.score, default=None)
    return best and best.fit.structure.base.name


def first_surface(experiment: Experiment) -> float | None:
    """Position from which on a spring explains the training record best, or None where nothing is flat above it."""
    training = experiment.training
    position, force = (training.trim(item) for item in (training.motion.position, training.force))
    reach = np.ptp(position)
    if reach == 0:
        return None
    trials = position.min() + reach * np.linspace(0.02, 0.8, _SURFACES)
    ones = np.ones(len(position))

    def left(surface: float) -> float:
        columns = np.column_stack([ones, np.maximum(position - surface, 0.0)])
        solution, *_ = np.linalg.lstsq(columns, force, rcond=None)
        return float(np.sum((columns @ solution - force) ** 2)) if solution[1] > 0 else np.inf

    errors = [left(surface) for surface in trials]
    if not np.isfinite(min(errors)):
        return None
    surface = float(trials[int(np.argmin(errors))])
    above = position < surface - 0.02 * reach
    if np.mean(above) < _LEAST_SHARE or np.std(force[above]) > _FLAT * np.std(force):
        return None
    return surface


def at_surface(experiment: Experiment, names: tuple[str, ...]) -> tuple[Experiment, Candidate]:
    """Find the surface of the tissue, and the best of several bases with contact from there."""
    start = first_surface(experiment)
    if start is None:
        start = float(experiment.training.motion.position.min())
    first = experiment.with_origin(start)
    best = min((fit_base(BASES[name], first) for name in names), key=lambda item: item.fit.squared_error)
    experiment, best = with_surface(experiment, best, start)
    found = [fit_base(BASES[name], experiment) for name in names if name != best.fit.structure.base.name]
    return experiment, min([best, *found], key=lambda item: item.score)


def _met_at_surface(experiment: Experiment) -> tuple[Experiment, Candidate] | None:
    """A spring that is met at a surface, for points of a static test; None where nothing is flat above one."""
    return None if first_surface(experiment) is None else at_surface(experiment, ("LE-contact",))


def _surface_of_refined(
    experiment: Experiment, base: Candidate, catalogue: dict[str, Effect]
) -> tuple[Experiment, Candidate]:
    """Surface that fits best with the best single effect: what the base lacks moves it."""
    singles = best_by_effect(extend(base, catalogue, experiment, most=_WITH_EFFECT, all_forms=False))
    refined = [with_surface(experiment, item, experiment.surface) for item in singles[:_WITH_EFFECT]]
    refined = [pair for pair in refined if pair[1].score < base.score - TIED]
    if not refined:
        return experiment, base
    moved, _ = min(refined, key=lambda pair: pair[1].score)
    return moved, refit(base.fit.structure, base.fit.nonlinear, moved)


def with_surface(experiment: Experiment, model: Candidate, start: float) -> tuple[Experiment, Candidate]:
    """Refit a model with contact together with the position of the surface.

    Brent's bounded method on the error that is left at each surface, the model's parameters fitted anew.
    """
    reach = _SEARCHED * float(np.ptp(experiment.training.motion.position))

    def squared_error(surface: float) -> float:
        training = experiment.with_origin(surface).training
        return fit(model.fit.structure, training, model.fit.nonlinear).squared_error

    found = scipy.optimize.minimize_scalar(
        squared_error,
        bounds=(start - reach, start + reach),
        method="bounded",
        options={"xatol": 1e-3 * reach},
    )
    moved = experiment.with_origin(float(found.x))
    return moved, refit(model.fit.structure, model.fit.nonlinear, moved)


_LEAD_BASES = ("LE", "KB")
"""Tissues beside which a lead is looked for: the others make up for one by a dashpot of their own."""
_LEAD_SAMPLES = (5, 14, 23)
"""Longest lead that is looked for first, and next where it may be longer: a delay reaches over ten samples."""
_LEAD_ROOM = 4
"""Times as many samples that must count in every record."""
_LEAD_LEAST = 0.2
"""Samples of delay up to which the lead may be longer."""
_LEAD_STARTS = (4.0, 1.5)
"""Samples that the search for the delay begins at."""


def force_leads(model: Candidate, experiment: Experiment, linear: set[str]) -> Finding | None:
    """By how much the force leads, where that explains all records surely better than what was selected; else None.

    The force is put later, and what is then between it and the position is a delay like any other. The effects `linear` are
    left out beside it: dashpots, masses and branches stand in for a lead.
    """
    base = model.fit.structure.base
    replaced = linear & set(model.effects)
    if base.contact or base.own or not (replaced or base.name == "KV" or not is_adequate(model, experiment)):
        return None
    kept = [form for form in model.fit.structure.forms if form.effect not in replaced | {"delay"}]
    shortest = min(data.size for data in (*experiment.training.records, *experiment.tests))
    for samples in (number for number in _LEAD_SAMPLES if _LEAD_ROOM * number <= shortest):
        put_late = experiment.with_data(lambda data, by=samples: _late(data, by, by))
        best = _with_delay(model, kept, put_late)
        units = experiment.input_unit, experiment.output_unit
        late = next(item for item in estimates(best.fit, put_late.training, *units) if item.effect == "delay")
        step = experiment.training.motion.sampling_time
        if late.low > 0 and late.value > _LEAD_LEAST * step:
            break
    else:
        return None  # longer than what can be looked for: it has no size that could be told
    first = samples * step
    same = experiment.with_data(lambda data: _late(data, 0, samples))
    rival = refit(model.fit.structure, model.fit.nonlinear, same)
    likelier = best.score < rival.score - (TIED if best.parameters >= rival.parameters else 0)
    # Beside another effect that is missing a lead may help a little: it is told where nothing is left.
    whole = (
        is_adequate(best, put_late)
        if experiment.floor
        else best.test_rms**2 < (1 - EXPLAINS) * rival.test_rms**2
    )
    if not (best.fit.converged and likelier and whole and late.high < first):
        return None
    low, lead, high = (1e3 * (first - value) for value in (late.high, late.value, late.low))
    position, unit = experiment.input_quantity, experiment.output_unit
    lead_only = effects_text([best.fit.structure.base.name, *(form.effect for form in kept)])
    sentence = (
        f"The {experiment.output_quantity} leads the {position} by {lead:.3g} ms (95 % interval {low:.3g} to {high:.3g}): with "
        f"only this lead added to {lead_only}, the error on unseen records is {best.test_rms:.4g} {unit}, that of the selected "
        f"model {rival.test_rms:.4g} {unit}. No tissue responds before it is moved: the clocks of the channels differ, or the "
        f"{position} is delayed by its sensor or filter; put both channels on one clock and diagnose again, because selected "
        "dashpots, masses and branches may only stand in for the lead."
    )
    return Finding("force_leads", sentence, lead / 1e3, "s")


def _with_delay(model: Candidate, kept: list[Form], put_late: Experiment) -> Candidate:
    """The likeliest base with a delay, and with effects that the model has."""
    (delay,) = TISSUE["delay"].forms
    acting = with_forms(model.fit, kept).nonlinear[len(model.fit.structure.base.nonlinear) :]
    step = put_late.training.motion.sampling_time
    fits = (
        fit_structure(Structure(BASES[name], (*kept, delay)), put_late.training, [*acting, samples * step])
        for name in _LEAD_BASES
        for samples in _LEAD_STARTS
    )
    return min((evaluate(fit, put_late) for fit in fits), key=lambda item: item.score)


def _late(data: FitData, samples: int, longest: int) -> FitData:
    """The record with its force so many samples later; of those at its start the `longest` do not count."""
    force = np.concatenate([np.repeat(data.force[:1], samples), data.force[: len(data.force) - samples]])
    return replace(data, force=force, settling=data.settling + longest)
