"""What a referee asks of a diagnosis beyond the ranking: ties, the experiment that settles them, limits, what is left."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.design.detectable import Detectable, detectable_effects, threshold_ratio
from lumbar.tissue.diagnosis.design.discrimination import Separation, separating_excitation
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.joint_fit import fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.residuals.locate import Simulated, compare_and_locate
from lumbar.tissue.diagnosis.selection.forward_selection import Candidate, evaluate, extend
from lumbar.tissue.diagnosis.selection.null_distribution import NullDistribution, shipped
from lumbar.tissue.diagnosis.selection.ties import Ties, signal_angles
from lumbar.tissue.diagnosis.selection.verdict import Verdict
from lumbar.tissue.effects.catalogue import without_channels
from lumbar.tissue.models.form import Effect
from lumbar.tissue.signals.motion_range import Kinematics

if TYPE_CHECKING:
    from lumbar.settings.signals import MachineSettings


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence beside a diagnosis."""

    remaining: list[Simulated]
    """The selected model on every record: where it still fails."""
    ties: Ties | None
    """None where nothing was selected."""
    separation: Separation | None
    """None without a tie."""
    detectable: list[Detectable]
    """How large other effects would have to be."""
    threshold: float
    """Gain that an effect needs to be selected."""
    null: NullDistribution
    """Simulated experiments that the threshold comes from."""
    other_forms: list[Candidate]
    """The selected model with one of its effects in another mathematical form."""


def gather_evidence(
    diagnosis: Verdict,
    records: list[Record],
    settings: DiagnosisSettings,
    seed: int,
    machine: MachineSettings | None = None,
) -> Evidence:
    """Gather the evidence for a diagnosis.

    Parameters
    ----------
    records : list of Record
        Those it was made from.
    settings : DiagnosisSettings
        Those it was made with.
    seed : int
        Of the intervals.
    machine : MachineSettings, optional
        Its limits; taken where the input is in mm.
    """
    experiment = diagnosis.experiment
    null = shipped(diagnosis.base.fit.structure.base.system)
    catalogue, _ = without_channels(settings.candidates, experiment.training.motion.channels)
    forms = sum(len(effect.forms) for effect in catalogue.values())
    if settings.forward:
        # What tells effects apart is worked out for motions that are prescribed.
        remaining = compare_and_locate(
            experiment.records, diagnosis.model.fit, experiment.floor, experiment.floor_from, seed
        )
        return Evidence(remaining, None, None, [], threshold_ratio(null, forms), null, [])
    return Evidence(
        remaining=compare_and_locate(
            experiment.records,
            diagnosis.model.fit,
            experiment.floor,
            experiment.floor_from,
            seed,
            experiment.surface,
            experiment.session,
        ),
        ties=signal_angles(diagnosis),
        separation=separating_excitation(diagnosis, machine_limits(machine, experiment)),
        detectable=detectable_effects(diagnosis, catalogue, null),
        threshold=threshold_ratio(null, forms),
        null=null,
        other_forms=_other_forms(diagnosis, catalogue),
    )


def machine_limits(machine: MachineSettings | None, experiment: Experiment) -> Kinematics | None:
    """Limits of the machine in the input's unit; None where it is not known or the input is not in mm."""
    if machine is None or experiment.input_unit != "mm":
        return None
    return Kinematics(machine.displacement_mm, machine.velocity_mm_s, machine.acceleration_mm_s2)


def _other_forms(diagnosis: Verdict, catalogue: dict[str, Effect]) -> list[Candidate]:
    """The model refitted with every other form of each of its effects."""
    experiment, model = diagnosis.experiment, diagnosis.model
    found = []
    for mine in model.fit.structure.forms:
        effect = catalogue[mine.effect]
        others = tuple(form for form in effect.forms if form.name != mine.name)
        if not others:
            continue
        rest = model.fit.structure.without(mine.effect)
        base, parts = model.fit.structure.nonlinear_of(model.fit.nonlinear)
        start = np.concatenate([base, *(parts[form.key] for form in rest.forms)])
        without = evaluate(fit(rest, experiment.training, start), experiment)
        found += extend(without, {mine.effect: replace(effect, forms=others)}, experiment)
    return found
