"""Diagnosis of forward records: named by what the turned-round records ask for, confirmed by simulation from force to motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lumbar.diagnosis.finding import Finding
from lumbar.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.diagnosis.fitting.joint_fit import fit, fit_base
from lumbar.diagnosis.fitting.preparation import Experiment, prepare
from lumbar.diagnosis.forward.carried import carried, fitted_base, response_of
from lumbar.diagnosis.forward.forward_data import forward_experiment
from lumbar.diagnosis.forward.forward_fit import fit_forward
from lumbar.diagnosis.forward.sensor import sensor_candidates
from lumbar.diagnosis.selection.diagnose import Selection
from lumbar.diagnosis.selection.forward_selection import Candidate, evaluate, is_adequate, unseen_improvement
from lumbar.diagnosis.selection.linear_gate import linear_alternative, linear_finding
from lumbar.diagnosis.selection.null_distribution import shipped
from lumbar.diagnosis.selection.offsets import offsets
from lumbar.diagnosis.selection.thresholds import TIED, UNSEEN
from lumbar.diagnosis.selection.verdict import Verdict
from lumbar.effects.motion_sensor import MOTION_SENSOR
from lumbar.errors import InputError
from lumbar.models.bases import BASES, CHOSEN_BY_DATA, Base
from lumbar.models.force_balance import can_be_simulated
from lumbar.models.form import Effect
from lumbar.models.forward_structure import ForwardStructure
from lumbar.models.measured_motion import with_measured_motion
from lumbar.models.structure import Structure
from lumbar.records.record import Record

FORWARD_BASES = ("KV-mass", "KB-mass", "KV", "KB", "LE")
"""Bases that are tried where the force is the input."""
_SIMULATED = 2
"""Bases, those that fit best turned round, that are simulated."""
_CONFIRMED = 5
"""Sets of effects, beside those selected and tied, that are simulated."""
_LEAST_EXPLAINED = 0.05
"""Share of the motion's variance that a base must explain for effects to be looked for beside it."""
_LONG = 6000
"""Samples of the training record on which a search is made."""
_POLISHED = 4
"""Evaluations of the error on all of a long record, from the fit to its beginning."""


def diagnose_forward(records: list[Record], settings: DiagnosisSettings) -> Verdict:
    """Diagnose what a base model is missing on forward records (force in, motion out).

    Parameters
    ----------
    records : list of Record
        With the force as channel ``input`` and the motion as ``output``.
    settings : DiagnosisSettings

    Returns
    -------
    Verdict
        In the unit of the motion; its fits simulate from force to motion.

    Raises
    ------
    InputError
        For a base with contact, and for records that cannot be used.
    """
    experiment, base = prepared_base(records, settings)
    found = _behind_sensor(_confirmed(experiment, base, settings), settings)
    found, linear = _beside_linear(found)
    zeros = [replace(item, kind="motion_offset") for item in offsets(found)]
    return replace(found, findings=(*zeros, *linear))


def _behind_sensor(found: Verdict, settings: DiagnosisSettings) -> Verdict:
    """Linear dynamics behind a sensor that is not linear, where they surely explain all records better."""
    experiment, null = found.experiment, shipped("tissue")
    if is_adequate(found.model, experiment):
        return found
    forms = {name: settings.candidates[name].forms for name in MOTION_SENSOR}
    for before, after in sorted(sensor_candidates(experiment, forms), key=lambda pair: pair[1].score):
        judge = Selection(experiment, before, settings, null, singles=[])
        surely = unseen_improvement(found.model, after, experiment) > UNSEEN
        if not (judge.passes(before, after) and surely and after.score < found.model.score - TIED):
            continue
        judge.tried = [after]
        share = judge.share_removed(after)
        return replace(
            found,
            base=before,
            verdict=judge.verdict(after, [], share),
            path=[before, after],
            tied_with=[],
            ranking=[*judge.ranking(after), *found.ranking],
            explainable_share_removed=share,
            verdict_after=judge.verdict_after(after, None),
        )
    return found


def _beside_linear(found: Verdict) -> tuple[Verdict, list[Finding]]:
    """Where linear dynamics of higher order surely explain more, they are told and nothing is named."""
    experiment = found.experiment
    if is_adequate(found.model, experiment):
        return found, []
    linear = linear_alternative(found.model, experiment)
    if linear is None:
        return found, []
    said = [linear_finding(linear, found.model, experiment)]
    return replace(found, verdict="unexplained", tied_with=[], verdict_after="unexplained"), said


def prepared_base(records: list[Record], settings: DiagnosisSettings) -> tuple[Experiment, Candidate]:
    """Forward records ready for a diagnosis, and the base that is named or that they ask for, simulated."""
    seen = [with_measured_motion(record) for record in records]
    experiment = replace(
        forward_experiment(prepare(seen, settings.train, settings.periods)), records=tuple(seen)
    )
    base = chosen_base(experiment, settings.base)
    if experiment.error_dwarfs_noise(base.train_rms):
        experiment = experiment.unwhitened()
        base = chosen_base(experiment, base.fit.structure.base.name)
    return experiment, base


def chosen_base(experiment: Experiment, name: str) -> Candidate:
    """The base of a name, or the one of `FORWARD_BASES` that explains all records best, fitted by simulation."""
    if name != CHOSEN_BY_DATA:
        if BASES[name].contact or BASES[name].system != "tissue":
            raise InputError(
                f"base {name}: records with the force as input know the bases {', '.join(FORWARD_BASES)}"
            )
        return _simulated_base(experiment, BASES[name])
    short = shortened(experiment)
    turned = [(fitted_base(short, BASES[item]), BASES[item]) for item in FORWARD_BASES]
    # All carried through the response of the first, which has all that the others have but a second relaxation.
    (_, linear, nonlinear), first = turned[0]
    seen = carried(short, response_of(first, linear, nonlinear))

    def score(base: Base) -> float:
        return evaluate(fit_base(Structure(base), seen.training), seen).score

    ranked = sorted((base for _, base in turned), key=score)
    found = [_simulated_base(experiment, base) for base in ranked[:_SIMULATED]]
    return min(found, key=lambda item: item.score if np.isfinite(item.score) else np.inf)


def _simulated_base(experiment: Experiment, base: Base) -> Candidate:
    _, linear, nonlinear = fitted_base(shortened(experiment), base)
    return simulated(experiment, ForwardStructure(base), linear, nonlinear)


def simulated(
    experiment: Experiment,
    structure: ForwardStructure,
    linear: np.ndarray,
    nonlinear: np.ndarray,
    zero: float = 0.0,
) -> Candidate:
    """Fit a structure by the error of its simulation, long records on their beginning first."""
    short = shortened(experiment).training
    found = fit_forward(structure, short, linear, nonlinear, zero)
    if short is not experiment.training:
        found = fit_forward(
            structure, experiment.training, found.linear, found.nonlinear, found.zero, _POLISHED
        )
    return evaluate(found, experiment)


def shortened(experiment: Experiment) -> Experiment:
    """The experiment with no more of every record than a search needs."""

    def short(data):
        return data.split(_LONG / data.size)[0] if data.size > _LONG else data

    return replace(
        experiment, training=short(experiment.training), tests=[short(item) for item in experiment.tests]
    )


def forward_catalogue(catalogue: dict[str, Effect], base: Base) -> dict[str, Effect]:
    """The effects that can be simulated from force to motion, without what the base has itself."""
    known = set(base.form.parsed.columns)
    found = {}
    for name, effect in catalogue.items():
        forms = tuple(
            form for form in effect.forms if can_be_simulated(form) and not known >= set(form.parsed.columns)
        )
        if forms:
            found[name] = replace(effect, forms=forms)
    return found


def _confirmed(experiment: Experiment, base: Candidate, settings: DiagnosisSettings) -> Verdict:
    """Name by the turned-round records, keep what simulation confirms; once effects are known, ask for the base again."""
    if _follows_nothing(base, experiment):
        return _Confirmation(
            experiment, base, replace(settings, catalogue={}), shipped("tissue"), None, 1.0
        ).diagnosis()
    found, seen = _named(experiment, base, settings)
    if settings.base != CHOSEN_BY_DATA or not found.selected:
        return found
    other = _base_beside(found.model, seen)
    if other is None:
        return found
    return _named(experiment, _simulated_base(experiment, other), settings)[0]


def _follows_nothing(base: Candidate, experiment: Experiment) -> bool:
    """Whether the motion hardly follows the force through the base: nothing can be carried through its response then."""
    data = experiment.training
    return base.train_rms**2 > (1 - _LEAST_EXPLAINED) * float(np.var(data.settled(data.force)))


def _named(
    experiment: Experiment, base: Candidate, settings: DiagnosisSettings
) -> tuple[Verdict, Experiment]:
    """A diagnosis with one base, and the turned-round records that it was searched on."""
    model = base.fit.structure.base
    usable = replace(settings, catalogue=forward_catalogue(settings.candidates, model))
    response = response_of(model, base.fit.linear, base.fit.nonlinear)
    seen = carried(shortened(experiment), response)
    turned = evaluate(fit_base(Structure(model), seen.training), seen)
    null = shipped("tissue")
    named = Selection(seen, turned, usable, null).diagnosis()
    stiffness = 1 / max(abs(response(np.zeros(1))[0]), 1e-300)
    return _Confirmation(experiment, base, usable, null, named, stiffness).diagnosis(), seen


def _base_beside(model: Candidate, seen: Experiment) -> Base | None:
    """The base that explains the turned-round records better with the same effects, or as well with fewer parameters."""
    mine = model.fit.structure.base
    forms = model.fit.structure.forms
    _, parts = model.fit.structure.nonlinear_of(model.fit.nonlinear)
    acting = [parts[form.key] for form in forms]

    def refitted(base: Base) -> Candidate:
        bare = fit_base(Structure(base), seen.training)
        start = np.concatenate([bare.nonlinear, *acting])
        return evaluate(fit(Structure(base, forms), seen.training, start), seen)

    found = {base.name: refitted(base) for base in {mine, *(BASES[name] for name in FORWARD_BASES)}}
    best = min(found, key=lambda name: found[name].score)
    return None if best == mine.name else BASES[best]


class _Confirmation(Selection):
    """Judges models by their simulation as the search judges them turned round.

    Parameters
    ----------
    named : Verdict or None
        Of the turned-round records; None where none was made.
    stiffness : float
        Static stiffness of the base, which turns the zero of a force into one of the motion.
    """

    def __init__(self, experiment, base, settings, null, named: Verdict | None, stiffness: float):
        super().__init__(experiment, base, settings, null, singles=[])
        self.named = named
        self.stiffness = stiffness

    def selected_path(self) -> list[Candidate]:
        """Simulate what was named, and its rivals; from the base on to larger sets that pass, the best of each step."""
        if self.named is None:
            return [self.base]
        self.simulate(self.named.path[1:])
        rivals = [*self.named.tied_with, *(item.candidate for item in self.named.ranking)]
        best = min([self.base, *self.tried], key=lambda item: item.score)
        if is_adequate(best, self.experiment):
            # What is larger explains nothing more.
            rivals = [item for item in rivals if len(item.effects) <= len(best.effects)]
        self.simulate(rivals[:_CONFIRMED])
        path = [self.base]
        while larger := [item for item in self.tried if self.follows(path[-1], item)]:
            fewest = min(len(item.effects) for item in larger)
            path.append(
                min((item for item in larger if len(item.effects) == fewest), key=lambda item: item.score)
            )
        return path

    def simulate(self, models: Sequence[Candidate]) -> None:
        """Fit models by their simulation, each set of forms once."""
        known = {item.fit.structure.forms for item in self.tried}
        for item in models:
            forms = item.fit.structure.forms
            if forms and forms not in known:
                known.add(forms)
                structure = ForwardStructure(item.fit.structure.base, forms)
                zero = -item.fit.zero / self.stiffness
                found = simulated(self.experiment, structure, item.fit.linear, item.fit.nonlinear, zero)
                if np.isfinite(found.score):
                    self.tried.append(found)

    def follows(self, before: Candidate, after: Candidate) -> bool:
        """Whether a larger set may be selected after another one."""
        if not set(after.effects) > set(before.effects) or not self.passes(before, after):
            return False
        return before is self.base or self.worthwhile(before, after)

    def further(self, model: Candidate) -> Candidate | None:
        """What was not named turned round is not looked for."""
        return None
