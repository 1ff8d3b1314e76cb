"""Evidence of a diagnosis in addition to the ranking: ties, the experiment that settles them, limits, the remaining error.

The force that a candidate adds to the base is the simulation of the candidate minus that of the base, on all records. Only the
part counts that the parameters of the base cannot absorb (`lumbar.tissue.diagnosis.fitting.uncertainty`). Two effects explain the
same error if their added forces have the same direction; the angle between them measures how well they can be distinguished.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy

from lumbar.base.files import write_csv, write_json, write_text
from lumbar.settings.tissue import MachineSettings
from lumbar.tables.table_layout import unit_in_print
from lumbar.tissue.diagnosis.evidence.discrimination import Separation, motion_csv, separating_excitation
from lumbar.tissue.diagnosis.fitting import uncertainty
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.joint_fit import nonlinear_starts
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.residuals.locate import ResidualReport, compare_and_locate
from lumbar.tissue.diagnosis.residuals.residual import steady_velocity
from lumbar.tissue.diagnosis.selection.candidate import Candidate, drop_effect
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisResult
from lumbar.tissue.diagnosis.selection.forward_selection import extend
from lumbar.tissue.diagnosis.selection.sentences import effects_text, headline, readable
from lumbar.tissue.diagnosis.selection.thresholds import (
    TIED,
    NullDistribution,
    null_distribution,
    number_of_forms,
)
from lumbar.tissue.effects.catalogue import usable_effects
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.motion import along_axes
from lumbar.tissue.signals.spectrum import Kinematics, occupied_band

if TYPE_CHECKING:
    import pandas as pd

ALIKE = 15.0
"""Largest angle in degrees between added forces of one cluster (97 % of the force in common)."""
_ROUNDING_SHARE = 1e-9
"""Share of a force below which an added force is rounding."""


@dataclass(frozen=True, eq=False)
class Ties:
    """Angles between the added forces of candidates, and clusters of similar candidates."""

    candidates: list[Candidate]
    """Candidates, the selected one first, without candidates with an added force that noise would hide."""
    angles: np.ndarray
    """Angles between added forces in degrees, 0 to 180, shape (candidates, candidates)."""
    clusters: list[list[int]]
    """Indices of candidates with all angles at most the larger of `ALIKE` and `resolution`; the selected one's cluster first."""
    resolution: float
    """Angle in degrees to the added force of the selected effect that noise hides."""

    def to_json(self) -> dict:
        """Return the entry ``ties`` of ``diagnosis.json``."""
        names = ["+".join(item.effects) for item in self.candidates]
        return {
            "angle_to_first_deg": dict(zip(names, self.angles[0].tolist(), strict=True)),
            "clusters": [[names[index] for index in cluster] for cluster in self.clusters],
            "resolution_deg": self.resolution,
        }


def signal_angles(diagnosis: DiagnosisResult) -> Ties | None:
    """Compare the added forces of the ranked candidates; return None if nothing was selected."""
    if not diagnosis.selected:
        return None
    experiment, noise = diagnosis.experiment, diagnosis.noise_rms
    records = [experiment.training, *experiment.tests]
    # The ranking, the selected first, then tied ones that are not in it. Sets with the selected one and more add a similar force.
    chosen = set(diagnosis.selected)
    candidates = [item.candidate for item in diagnosis.ranking if not set(item.candidate.effects) > chosen]
    ranked = {frozenset(item.effects) for item in candidates}
    candidates += [item for item in diagnosis.tied_with if frozenset(item.effects) not in ranked]
    basis = uncertainty.tangent_basis(diagnosis.base.fit, records)
    base = uncertainty.whitened_simulation(diagnosis.base.fit, records)
    simulated = [uncertainty.whitened_simulation(item.fit, records) for item in candidates]
    added = uncertainty.project_out(basis, np.stack([item - base for item in simulated], axis=1))
    size = np.sqrt(np.sum(added**2, axis=0))
    # A candidate that adds less than noise would hide has no direction.
    shown = [index for index in range(len(candidates)) if index == 0 or size[index] ** 2 > TIED * noise**2]
    candidates = [candidates[index] for index in shown]
    angles = angles_between(added[:, shown])
    hidden = min(1.0, np.sqrt(TIED) * noise / size[0]) if size[0] > 0 else 1.0
    resolution = float(np.degrees(np.arcsin(hidden)))
    return Ties(candidates, angles, complete_linkage(angles, max(ALIKE, resolution)), resolution)


def angles_between(signals: np.ndarray) -> np.ndarray:
    """Return the angles in degrees between the columns of `signals`; a column of zeros is at 90° to all others.

    The angle is 2 atan2(‖a − b‖, ‖a + b‖) of unit vectors a and b, which stays accurate for small angles (Kahan, How
    Futile are Mindless Assessments of Roundoff, 2006, §12).
    """
    size = np.sqrt(np.sum(signals**2, axis=0))
    unit = signals / np.where(size > 0, size, 1.0)
    less = np.linalg.norm(unit[:, :, None] - unit[:, None, :], axis=0)
    more = np.linalg.norm(unit[:, :, None] + unit[:, None, :], axis=0)
    angles = np.degrees(2 * np.arctan2(less, more))
    angles[size == 0, :] = angles[:, size == 0] = 90.0
    np.fill_diagonal(angles, 0.0)
    return angles


def complete_linkage(angles: np.ndarray, largest: float) -> list[list[int]]:
    """Return clusters by complete linkage: in a cluster no two items differ by more than `largest`. Sorted by first member."""
    if len(angles) == 1:
        return [[0]]
    clusters: dict[int, list[int]] = {}
    distances = scipy.spatial.distance.squareform(angles, checks=False)
    tree = scipy.cluster.hierarchy.linkage(distances, "complete")
    for index, number in enumerate(scipy.cluster.hierarchy.fcluster(tree, largest, "distance")):
        clusters.setdefault(number, []).append(index)
    return list(clusters.values())


@dataclass(frozen=True)
class Detectable:
    """Smallest effect that the training record would show."""

    effect: str
    easiest: float
    """RMS of the force that the effect must add, in the output's unit, for the form and shape that the record shows best."""
    hardest: float
    """RMS of the force that the effect must add, in the output's unit, for the form and shape that the record shows worst."""


def detectable_effects(
    diagnosis: DiagnosisResult, catalogue: dict[str, Effect], null: NullDistribution
) -> list[Detectable]:
    """Return the smallest detectable force of every effect that the model lacks, the most easily detected first.

    An effect is selected if its statistic N R² exceeds the threshold of the null table; R² counts only the part of the force that
    the parameters of the model cannot absorb. If this part is the share s, the force must have the RMS σ √(threshold/(N s)).
    Effects that do not add a force are judged by the change that they cause at their starting parameters.
    """
    fit, data = diagnosis.model.fit, diagnosis.experiment.training
    least = diagnosis.noise_rms * np.sqrt(null.threshold(number_of_forms(catalogue)) / data.size)
    basis, residual = uncertainty.tangent_basis(fit, [data]), data.force - fit.simulate(data.motion)
    detectable = []
    for effect in catalogue.values():
        if effect.name in diagnosis.selected:
            continue
        shares = []
        for form in effect.forms:
            starts = nonlinear_starts(form, data, residual)
            # The first, the middle and the last starting values of the form.
            for index in sorted({0, len(starts) // 2, len(starts) - 1}):
                for signal in uncertainty.added_forces(fit, form, data, starts[index]).T:
                    energy, left = float(signal @ signal), uncertainty.project_out(basis, signal)
                    if energy > 0 and left @ left > _ROUNDING_SHARE * energy:
                        shares.append(float(left @ left) / energy)
        if shares:
            easiest, hardest = (float(least / np.sqrt(part)) for part in (max(shares), min(shares)))
            detectable.append(Detectable(effect.name, easiest, hardest))
    return sorted(detectable, key=lambda item: item.easiest)


_MAX_HALF_WIDTH = 0.5
"""Half width of an interval, as a share of the value, above which a parameter is poorly known."""
_LISTED_EFFECTS = 4
"""Number of effects listed as the hardest to detect."""
EXCITATION = "separating_excitation.csv"


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence of a diagnosis."""

    remaining: list[ResidualReport]
    """Remaining error of the selected model on every record."""
    ties: Ties | None
    """Angles between the added forces of candidates; None if nothing was selected."""
    separation: Separation | None
    """Excitation that separates tied candidates; None without a tie."""
    detectable: list[Detectable]
    """Smallest detectable force of every effect that the model lacks."""
    threshold: float
    """Smallest likelihood-ratio statistic of an effect that may be selected."""
    null: NullDistribution
    """Statistics of simulated null experiments, which give the threshold."""
    other_forms: list[Candidate]
    """Models that differ from the selected model in the mathematical form of one effect."""


def machine_limits(machine: MachineSettings | None, experiment: Experiment) -> Kinematics | None:
    """Return the limits of the machine in the input's unit; None if the machine is unknown or the input is not in mm."""
    if machine is None or experiment.input_unit != "mm":
        return None
    return Kinematics(machine.displacement_mm, machine.velocity_mm_s, machine.acceleration_mm_s2)


def gather_evidence(
    diagnosis: DiagnosisResult, settings: DiagnosisSettings, seed: int, machine: MachineSettings | None = None
) -> Evidence:
    """Gather the evidence for a diagnosis.

    `settings` are the settings of that diagnosis. `seed` is the random seed of the intervals. Machine limits need an input in mm.
    """
    experiment, model = diagnosis.experiment, diagnosis.model
    null = null_distribution(diagnosis.base.fit.structure.base.system)
    training = experiment.training
    catalogue, _ = usable_effects(settings.searched, training.motion.channels, training.scale)
    threshold = null.threshold(number_of_forms(catalogue))
    remaining = [] if experiment.points else compare_and_locate(experiment, model.fit, seed)
    if settings.forward or experiment.points:
        # Ties and detectable effects are defined for prescribed motions only.
        return Evidence(remaining, None, None, [], threshold, null, [])
    other_forms = []
    for form in model.fit.structure.forms:
        effect = catalogue[form.effect]
        others = [item for item in effect.forms if item.name != form.name]
        if others:
            without = drop_effect(model, form.effect, experiment)
            other_forms += extend(without, {form.effect: effect.with_forms(others)}, experiment)
    separation = separating_excitation(diagnosis, machine_limits(machine, experiment))
    moves = np.ptp(training.motion.position) > 0  # a rest shows no effect
    detectable = detectable_effects(diagnosis, catalogue, null) if moves else []
    return Evidence(remaining, signal_angles(diagnosis), separation, detectable, threshold, null, other_forms)


def limitations(diagnosis: DiagnosisResult, evidence: Evidence) -> list[str]:
    """Return one sentence per limit of the evidence."""
    experiment, model = diagnosis.experiment, diagnosis.model
    sentences = [_range_sentence(experiment)]
    if experiment.tests[0].name == experiment.training.name:
        sentences.append(
            "Whether the model holds for another specimen or day: there is only one table. Record a second one."
            if experiment.points
            else "Whether the model holds for another excitation: there is only one record, and its last part serves as the "
            "unseen one. Record a second excitation."
        )
    if experiment.points:
        sentences.append(
            "Whether the remaining error is noise: measure the same positions again, in another order."
        )
    elif experiment.floor is None:
        sentences.append(
            "Whether the remaining error is noise: no record repeats. Record at least three periods of one excitation and give "
            "its period."
        )
    if diagnosis.tied_with:
        others = " or ".join(effects_text(item.effects) for item in diagnosis.tied_with)
        sentences.append(
            f"Whether it is {effects_text(diagnosis.selected)} or {others}: both explain the records equally well."
        )
    keys = {form.key for form in model.fit.structure.forms}
    others = ", ".join(
        f"{readable(form.effect)} as {form.name}"
        for item in evidence.other_forms
        if item.score - model.score < TIED
        for form in item.fit.structure.forms
        if form.key not in keys
    )
    if others:
        named = " and ".join(form.name for form in model.fit.structure.forms)
        sentences.append(f"The mathematical form: {others} explains the records as well as {named}.")
    wide = ", ".join(
        f"{readable(item.name)} ({item.low:.3g} to {item.high:.3g} {unit_in_print(item.unit)})"
        for item in (diagnosis.ranking[0].estimates if diagnosis.selected else ())
        if item.high - item.low > 2 * _MAX_HALF_WIDTH * abs(item.value)
    )
    if wide:
        sentences.append(f"The value of {wide}: the interval is as wide as the value.")
    if evidence.detectable:
        easiest, unit = evidence.detectable[0], experiment.output_unit
        hardest = sorted(evidence.detectable, key=lambda item: -item.hardest)[:_LISTED_EFFECTS]
        ranges = (f"{readable(item.effect)} {item.easiest:.2g} to {item.hardest:.2g}" for item in hardest)
        listed = ", ".join(ranges)
        sentences.append(
            f"Effects that are too small to be seen. To be selected, an effect must add at least {easiest.easiest:.2g} {unit} "
            f"RMS to the training record ({readable(easiest.effect)}); hardest to see in this excitation, depending on their "
            f"parameters: {listed} {unit}."
        )
    return sentences


def _range_sentence(experiment: Experiment) -> str:
    motions = [part for item in (experiment.training, *experiment.tests) for part in along_axes(item.motion)]
    positions = np.concatenate([item.position for item in motions])
    unit = experiment.input_unit
    anything = f"Anything outside {positions.min():.3g} to {positions.max():.3g} {unit}"
    if experiment.points:
        return f"{anything}, and anything that depends on time, speed or direction: points of a static test do not show it."
    speed = max(float(np.abs(steady_velocity(item.position, item.sampling_time)).max()) for item in motions)
    training = max(along_axes(experiment.training.motion), key=lambda item: float(np.var(item.position)))
    bottom, top = (f"{edge:.2g}" for edge in occupied_band(training.position, training.sampling_time))
    frequencies = f"outside {bottom} to {top} Hz" if bottom != top else f"at a frequency other than {top} Hz"
    return f"{anything}, above {speed:.3g} {unit}/s or {frequencies}: the tool did not move there."


def write_diagnosis(
    diagnosis: DiagnosisResult, gather: Callable[[], Evidence], folder: Path, source_label: str
) -> None:
    """Write ``diagnosis.json``, ``ladder.csv`` and, if effects are tied, ``separating_excitation.csv``.

    The result is first written without evidence, so that it remains if `gather` fails. The excitation of an earlier diagnosis is
    removed from the folder. `source_label` names the source of the data.
    """
    document = {**diagnosis.to_json(), "headline": headline(diagnosis), "data": source_label}
    write_json(folder / "diagnosis.json", document)
    write_csv(folder / "ladder.csv", ladder_frame(diagnosis, source_label))
    (folder / EXCITATION).unlink(missing_ok=True)
    evidence = gather()
    write_json(folder / "diagnosis.json", document | evidence_document(diagnosis, evidence))
    if evidence.separation is not None and evidence.separation.improves:
        motion = evidence.separation.excitation.motion
        write_text(folder / EXCITATION, motion_csv(motion, diagnosis.experiment.input_unit))


def evidence_document(diagnosis: DiagnosisResult, evidence: Evidence) -> dict:
    """Return the part of ``diagnosis.json`` that the evidence adds."""
    unit = diagnosis.experiment.output_unit
    return {
        "ties": None if evidence.ties is None else evidence.ties.to_json(),
        "separating_excitation": None if evidence.separation is None else evidence.separation.to_json(),
        "false_alarm_threshold": None
        if diagnosis.experiment.points
        else {"gain": evidence.threshold, "null_experiments": len(evidence.null.ratios)},
        "detectable_rms": {
            item.effect: {"easiest": item.easiest, "hardest": item.hardest, "unit": unit}
            for item in evidence.detectable
        },
    }


def ladder_frame(diagnosis: DiagnosisResult, source_label: str) -> pd.DataFrame:
    """Return the error ladder: one row for the base, for the base with the first effect, and so on."""
    import pandas as pd

    experiment = diagnosis.experiment
    rows = [
        {
            "rung": number,
            "effects": "+".join(item.effects),
            "forms": "+".join(form.name for form in item.fit.structure.forms),
            "train_rms": item.train_rms,
            "test_rms": item.test_rms,
            "unit": experiment.output_unit,
            "noise_floor_rms": None if experiment.floor is None else experiment.floor.rms,
            "data": source_label,
        }
        for number, item in enumerate(diagnosis.path)
    ]
    return pd.DataFrame(rows)
