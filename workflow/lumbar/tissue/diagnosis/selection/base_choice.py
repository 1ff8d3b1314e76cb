"""Choice of the base: before effects are known, and again with the selected effects."""

from dataclasses import replace

import numpy as np
import scipy

from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.joint_fit import fit, shape_bounds
from lumbar.tissue.diagnosis.fitting.preparation import Experiment, prepare
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates
from lumbar.tissue.diagnosis.selection.candidate import (
    Candidate,
    best_by_effect,
    exchange_base,
    fit_base,
    is_adequate,
    is_worthwhile,
    refit,
    select_forms,
)
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisState, run
from lumbar.tissue.diagnosis.selection.forward_selection import extend, select_effects
from lumbar.tissue.diagnosis.selection.thresholds import MOST_OF_REST, TIED
from lumbar.tissue.models.bases import BASES, CHOSEN_BY_DATA, LENGTH, QUASI_LINEAR, Base
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.parameter import POSITIONS

TISSUE_BASES = ("KB", "KV", "Maxwell", "LE")
"""Bases of a fastened tool."""
CONTACT_BASES = ("KB-contact", "KV-contact", "LE-contact")
"""Bases of a tool that is not fastened to the tissue."""
_RICHEST = ("KB", "KV")
"""Beginnings of the names of bases that are no special cases of other bases."""
_SURFACE_TRIALS = 40
"""Number of depths at which the surface is searched."""
_SEARCHED_SHARE = 0.06
"""Share of the range about the first surface in which the best one is searched."""
_MAX_SPRING_RATIO = 0.9
"""Largest ratio of the squared errors of a spring with contact and a fastened spring for which contact is tried."""
_SURFACE_EFFECTS = 3
"""Number of effects, the best in screening, with which the surface is searched again."""
_MAX_REST_RANGES = 10.0
"""Largest distance of a prestrain from the recorded zero, in ranges: the zero of an encoder may be anywhere farther away."""
_MIN_FREE_SHARE = 0.03
"""Smallest share of samples above the surface."""
_MAX_FREE_SPREAD = 0.1
"""Largest ratio of the spread of the force above the surface to its spread in the whole record if there is no contact above."""


def choose_base(state: DiagnosisState) -> DiagnosisState:
    """Choose the base that the settings name, or the base that explains all records best."""
    experiment, base = find_base(state.result.experiment, state.settings.base, state.settings.candidates)
    unit, name = experiment.output_unit, base.fit.structure.base.name
    reason = f"{name}: error {base.train_rms:.4g} {unit} in training, {base.test_rms:.4g} {unit} on {experiment.test_data}"
    return state.next("choose the base", reason, experiment=experiment, base=base, path=[base])


def reconsider_base(state: DiagnosisState) -> DiagnosisState:
    """Choose the base again, with the selected effects; if another base is better, select effects again."""
    step, result = "reconsider the base", state.result
    if state.settings.base != CHOSEN_BY_DATA or not result.selected:
        return state.next(step, "not needed: the base is given, or no effect was selected")
    model = result.model
    other = better_base(model, result.experiment)
    reason = f"{other} explains the records as well with fewer effects, or better"
    # A law of position on a base without a spring may be the spring.
    has_rival = other is None and model.fit.structure.base.name == "Maxwell"
    if has_rival and any(form.is_static for form in model.fit.structure.forms):
        other, reason = (
            "KB",
            f"{' and '.join(result.selected)} may replace a spring: effects are searched with it",
        )
    if other is None:
        return state.next(step, "no other base explains the records better with the selected effects")
    experiment, base = find_base(result.experiment, other, state.settings.candidates)
    again = select_effects(state.next(step, reason, experiment=experiment, base=base, path=[base]))
    new = again.result.model
    if has_rival and not (
        new.score < model.score - TIED
        or (new.score < model.score + TIED and len(new.effects) < len(model.effects))
    ):
        return state.next(step, f"the spring is needed less than {' and '.join(result.selected)}")
    return again


def try_quasi_linear(state: DiagnosisState) -> DiagnosisState:
    """Choose a quasi-linear base if it explains more than the best linear base with effects; select effects again.

    Its elastic response must be nonlinear within the range of the records: else it is a spectrum of a linear base. One ramp may
    not determine that response: if no such base leaves only noise, all records are fitted together.
    """
    step, result, settings = "try quasi-linear bases", state.result, state.settings
    if settings.base != CHOSEN_BY_DATA or settings.system != "tissue":
        return state.next(step, "not needed: the base is given")
    if is_adequate(result.model, result.experiment):
        return state.next(step, "not needed: the model leaves only noise")
    experiment = result.experiment.shift_origin(result.experiment.rest[0])
    base = _best_quasi_linear(result.model, experiment)
    if base is None or not is_adequate(base, experiment):
        together = _fit_together(state)
        if together is not None:
            return select_effects(together)
    if base is None:
        return state.next(step, "none explains the records better")
    reason = _describe_gain(base, result.model, experiment)
    return select_effects(state.next(step, reason, experiment=experiment, base=base, path=[base]))


def _fit_together(state: DiagnosisState) -> DiagnosisState | None:
    """Return the state with a quasi-linear base that, fitted to all records together, leaves only noise; None if none does."""
    result, settings = state.result, state.settings
    names, model = [record.name for record in result.experiment.records], result.model
    if settings.train or len(names) < 2 or model.fit.structure.base.contact:
        return None
    try:
        together = prepare(state.repaired[0], **{**settings.preparation, "train": names})
    except InputError:  # records of different rates
        return None
    model = refit(model.fit.structure, model.fit.nonlinear, together)
    base = None if is_adequate(model, together) else _best_quasi_linear(model, together)
    if base is None or not is_adequate(base, together):
        return None
    sentence = (
        f"{' and '.join(names)} were fitted together: {result.experiment.training.name} alone does not determine the elastic "
        f"response of {base.fit.structure.base.name}, with which one set of parameters describes all records."
    )
    finding = Finding("trained_together", sentence, base.train_rms, together.output_unit)
    changes = {"settings": replace(settings, train=names), "prepared": together, "experiment": together}
    reason = f"fitted to all together, {_describe_gain(base, model, together)}"
    return state.next("try quasi-linear bases", reason, finding, base=base, path=[base], **changes)


def _describe_gain(base: Candidate, model: Candidate, experiment: Experiment) -> str:
    errors = f"{base.test_rms:.4g} {experiment.output_unit} on {experiment.test_data}, the linear base {model.test_rms:.4g}"
    return f"{base.fit.structure.base.name} explains the records better: error {errors}"


def _best_quasi_linear(model: Candidate, experiment: Experiment) -> Candidate | None:
    """Return the likeliest quasi-linear base that is nonlinear and leaves only noise or far less than a model, or None."""
    largest = (1 - MOST_OF_REST) * max(model.test_rms**2 - experiment.noise**2, 0.0) + experiment.noise**2
    better = [
        item
        for item in (fit_base(BASES[name], experiment) for name in QUASI_LINEAR)
        if item.score < model.score - TIED
        and (is_adequate(item, experiment) or item.test_rms**2 <= largest)
        and _is_curved(item, experiment)
    ]
    return min(better, key=lambda item: item.score, default=None)


def _is_curved(model: Candidate, experiment: Experiment) -> bool:
    """Return whether the interval of a quasi-linear base's length ends below the longest length that a fit allows."""
    units = experiment.input_unit, experiment.output_unit
    length = next(item for item in estimates(model.fit, experiment.training, *units) if item.name == LENGTH)
    at = [item.name for item in model.fit.structure.nonlinear].index(LENGTH)
    _, longest = shape_bounds(model.fit.structure, experiment.training, model.fit.nonlinear)
    return length.high < longest[at]


def reconsider_origin(state: DiagnosisState) -> DiagnosisState:
    """Select effects again with positions as recorded, if a selected effect depends on position and the origin was moved.

    About a prestrain every curve is nearly a parabola; from the recorded zero it may be the curve of another law.
    """
    step, result = "reconsider the origin", state.result
    experiment, model = result.experiment, result.model
    rest, span = abs(experiment.rest[0]), float(np.ptp(experiment.training.motion.position))
    is_moved = 0 < rest < _MAX_REST_RANGES * span and experiment.surface == experiment.rest[0]
    forms = [form for form in model.fit.structure.forms if not form.hand_written]
    if not is_moved or not any(form.parsed_equation.signals & set(POSITIONS) for form in forms):
        return state.next(
            step, "not needed: no effect counts positions from another zero than the recorded one"
        )
    recorded = experiment.shift_origin(0.0, rest=(0.0,))
    base = fit_base(model.fit.structure.base, recorded)
    reason = "effects are searched with positions from their recorded zero"
    again = select_effects(state.next(step, reason, experiment=recorded, base=base, path=[base]))
    if again.result.model.score >= model.score + TIED:
        return state.next(
            step,
            f"positions from {experiment.rest[0]:.4g} {experiment.input_unit} explain the records better",
        )
    return again


SEARCH = (choose_base, select_effects, reconsider_base, reconsider_origin, try_quasi_linear)
"""Steps from prepared records to the selected model."""


def reweigh_errors(state: DiagnosisState, search: tuple = SEARCH) -> DiagnosisState:
    """Repeat a search without whitening if the model's error is far above the noise."""
    step, error = "weigh errors", state.result.model.train_rms
    rms = f"{error:.4g} {state.result.experiment.output_unit}"
    if not state.prepared.error_dwarfs_noise(error):
        return state.next(step, f"not needed: {rms} is near the noise, or that is white or unknown")
    reason = f"{rms} is far above the noise: its colour is ignored, and base and effects are searched again"
    again = state.next(step, reason, experiment=state.prepared.drop_whitening(), status=None)
    return run(search, again)


def find_base(
    experiment: Experiment, name: str | Base, catalogue: dict[str, Effect]
) -> tuple[Experiment, Candidate]:
    """Fit the named base, or the base that the data require.

    The latter has the best likelihood of all records for its number of parameters. A base with contact must be better than a
    fastened base with any single effect, e.g. an effect that loses contact or clips the force. `name` is a key of
    `lumbar.tissue.models.bases.BASES`, a user-defined base, or `CHOSEN_BY_DATA`. Positions of the returned experiment are counted
    from the tissue's surface if the base has contact.
    """
    # Surfaces are positions as recorded, also if a base is chosen again.
    experiment = experiment.shift_origin(experiment.rest[0])
    if isinstance(name, Base):
        return experiment, fit_base(name, experiment)
    if name != CHOSEN_BY_DATA:
        if BASES[name].contact:
            return _fit_surface_with_effects(*fit_at_surface(experiment, (name,)), catalogue)
        return experiment, fit_base(BASES[name], experiment)
    fastened = min((fit_base(BASES[base], experiment) for base in TISSUE_BASES), key=lambda item: item.score)
    surface = first_surface(experiment)
    if surface is None:
        return experiment, fastened
    # A spring that is met at a surface must fit better than a fastened one, by more than a clipped response would.
    spring = fit_base(BASES["LE"], experiment)
    met = fit_base(BASES["LE-contact"], experiment.shift_origin(surface))
    if met.fit.squared_error >= _MAX_SPRING_RATIO * spring.fit.squared_error:
        return experiment, fastened
    rivals = [fastened, *extend(fastened, catalogue, experiment)]
    if any(is_adequate(item, experiment) for item in rivals):
        return experiment, fastened
    from_surface, touching = fit_at_surface(experiment, CONTACT_BASES)
    from_surface, touching = _fit_surface_with_effects(from_surface, touching, catalogue)
    if touching.score < min(item.score for item in rivals):
        return from_surface, touching
    return experiment, fastened


def better_base(model: Candidate, experiment: Experiment) -> str | None:
    """Return the name of the base that explains all records significantly better with the same effects, or None.

    Without its effects the base may have a Maxwell branch instead of them. Another base without fewer parameters must be as
    worthwhile as a further effect: a branch can absorb a little of any model's error, and its spring then changes the other
    parameters (a mass m with a dashpot b is m + bτ with a branch). With fewer of the effects it need only explain them as well.
    """
    current = model.fit.structure.base
    names = CONTACT_BASES if current.contact else TISSUE_BASES
    bare = fit_base(current, experiment)
    better = [
        item
        for item in (exchange_base(model, BASES[name], experiment) for name in names if name != current.name)
        if item.score < model.score - TIED
        and (item.parameters < model.parameters or is_worthwhile(bare, model, item, experiment))
    ]
    # Without an effect only a base that has an element more can explain as much.
    forms = model.fit.structure.forms
    richer = [name for name in names if name[:2] in _RICHEST and name != current.name]
    for dropped in forms if len(forms) > 1 else ():
        kept = select_forms(model.fit, [form for form in forms if form is not dropped])
        simpler = (exchange_base(replace(model, fit=kept), BASES[name], experiment) for name in richer)
        better += [item for item in simpler if item.score < model.score + TIED]
    best = min(better, key=lambda item: (len(item.effects), item.score), default=None)
    return best and best.fit.structure.base.name


def first_surface(experiment: Experiment) -> float | None:
    """Return the surface below which a spring explains the training record best, or None if the force is not flat above it."""
    training = experiment.training
    position, force = (training.trim(item) for item in (training.motion.position, training.force))
    span = np.ptp(position)
    if span == 0:
        return None
    trials = position.min() + span * np.linspace(0.02, 0.8, _SURFACE_TRIALS)
    errors = []
    for surface in trials:
        columns = np.column_stack([np.ones(len(position)), np.maximum(position - surface, 0.0)])
        solution, *_ = np.linalg.lstsq(columns, force, rcond=None)
        squared_error = float(np.sum((columns @ solution - force) ** 2))
        errors.append(squared_error if solution[1] > 0 else np.inf)
    if not np.isfinite(min(errors)):
        return None
    surface = float(trials[int(np.argmin(errors))])
    above = position < surface - 0.02 * span
    if np.mean(above) < _MIN_FREE_SHARE or np.std(force[above]) > _MAX_FREE_SPREAD * np.std(force):
        return None
    return surface


def fit_at_surface(experiment: Experiment, names: tuple[str, ...]) -> tuple[Experiment, Candidate]:
    """Fit the surface of the tissue with each of several bases with contact, and return the best base."""
    start = first_surface(experiment)
    if start is None:
        start = float(experiment.training.motion.position.min())
    first = experiment.shift_origin(start)
    best = min((fit_base(BASES[name], first) for name in names), key=lambda item: item.fit.squared_error)
    experiment, best = _fit_surface(experiment, best, start)
    others = [fit_base(BASES[name], experiment) for name in names if name != best.fit.structure.base.name]
    return experiment, min([best, *others], key=lambda item: item.score)


def _fit_surface_with_effects(
    experiment: Experiment, base: Candidate, catalogue: dict[str, Effect]
) -> tuple[Experiment, Candidate]:
    """Fit the surface together with the best single effect, because a missing effect moves the surface."""
    singles = best_by_effect(extend(base, catalogue, experiment, most=_SURFACE_EFFECTS, all_forms=False))
    refined = [_fit_surface(experiment, item, experiment.surface) for item in singles[:_SURFACE_EFFECTS]]
    refined = [pair for pair in refined if pair[1].score < base.score - TIED]
    if not refined:
        return experiment, base
    moved, _ = min(refined, key=lambda pair: pair[1].score)
    return moved, refit(base.fit.structure, base.fit.nonlinear, moved)


def _fit_surface(experiment: Experiment, model: Candidate, start: float) -> tuple[Experiment, Candidate]:
    """Refit a model with contact together with the surface: Brent's bounded method, the model refitted at each position."""
    half_width = _SEARCHED_SHARE * float(np.ptp(experiment.training.motion.position))

    def squared_error(surface: float) -> float:
        training = experiment.shift_origin(surface).training
        return fit(model.fit.structure, training, model.fit.nonlinear).squared_error

    optimum = scipy.optimize.minimize_scalar(
        squared_error,
        bounds=(start - half_width, start + half_width),
        method="bounded",
        options={"xatol": 1e-3 * half_width},
    )
    moved = experiment.shift_origin(float(optimum.x))
    return moved, refit(model.fit.structure, model.fit.nonlinear, moved)
