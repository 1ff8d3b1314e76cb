"""What a set of records can tell: how alike the forces of candidates are, and how large an effect must be to be seen.

What a candidate adds to the base is its simulation less the base's, on all records. Of this counts what the base's own
parameters cannot take up (`lumbar.tissue.diagnosis.fitting.uncertainty`). Two effects whose added forces point the
same way explain the same error; the angle between them says how far they can be told apart, whatever the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, nonlinear_starts
from lumbar.tissue.diagnosis.fitting.uncertainty import added_forces, beyond, simulation_over, tangent_basis
from lumbar.tissue.diagnosis.selection.candidate import Candidate
from lumbar.tissue.diagnosis.selection.thresholds import TIED, NullDistribution, number_of_forms
from lumbar.tissue.diagnosis.selection.verdict import Verdict
from lumbar.tissue.models.form import Effect, Form

ALIKE = 15.0
"""Degrees: candidates of one cluster add forces that differ by no more (97 % of the force in common)."""
_STARTS = 3
"""Starting nonlinear parameters tried of every form: the first, the middle and the last of its grid."""
_NOTHING = 1e-9
"""A share of the force that is left by rounding alone."""


@dataclass(frozen=True, eq=False)
class Ties:
    """Angles between the added forces of candidates, and clusters of those that are alike."""

    candidates: list[Candidate]
    """The selected one first; those whose added force noise would hide are left out."""
    angles: np.ndarray
    """Shape (candidates, candidates): degrees, 0 to 180."""
    clusters: list[list[int]]
    """Indices of candidates all of whose angles are at most the larger of `ALIKE` and `resolution`; the one with the
    selected first."""
    resolution: float
    """Degrees: noise hides an angle as small as this from the selected effect's added force."""

    def to_json(self) -> dict:
        """Return what ``diagnosis.json`` holds under ``ties``."""
        names = ["+".join(item.effects) for item in self.candidates]
        return {
            "angle_to_first_deg": dict(zip(names, self.angles[0].tolist(), strict=True)),
            "clusters": [[names[index] for index in cluster] for cluster in self.clusters],
            "resolution_deg": self.resolution,
        }


def signal_angles(diagnosis: Verdict) -> Ties | None:
    """Compare the added forces of the ranked candidates; None where nothing was selected."""
    if not diagnosis.selected:
        return None
    experiment = diagnosis.experiment
    records = [experiment.training, *experiment.tests]
    candidates = _with_tied(diagnosis)
    basis = tangent_basis(diagnosis.base.fit, records)
    base = simulation_over(diagnosis.base.fit, records)
    added = np.stack([simulation_over(item.fit, records) - base for item in candidates], axis=1)
    added = beyond(basis, added)
    size = np.sqrt(np.sum(added**2, axis=0))
    noise = diagnosis.noise_rms
    # A candidate that adds less than noise would hide has no direction to speak of.
    seen = [index for index in range(len(candidates)) if index == 0 or size[index] ** 2 > TIED * noise**2]
    candidates, added = [candidates[index] for index in seen], added[:, seen]
    angles = angles_between(added)
    hidden = min(1.0, np.sqrt(TIED) * noise / size[0]) if size[0] > 0 else 1.0
    resolution = float(np.degrees(np.arcsin(hidden)))
    return Ties(candidates, angles, complete_linkage(angles, max(ALIKE, resolution)), resolution)


def _with_tied(diagnosis: Verdict) -> list[Candidate]:
    """Ranked candidates, the selected first, and the tied ones that the ranking does not show.

    Sets that hold the selected one and more are left out: that they add a like force goes without saying.
    """
    chosen = set(diagnosis.selected)
    ranked = [item.candidate for item in diagnosis.ranking if not set(item.candidate.effects) > chosen]
    shown = {frozenset(item.effects) for item in ranked}
    return [*ranked, *(item for item in diagnosis.tied_with if frozenset(item.effects) not in shown)]


def angles_between(signals: np.ndarray) -> np.ndarray:
    """Angles in degrees between the columns of `signals`; a column of zeros is at 90° to all others.

    Taken from the half-angle, 2 atan2(‖a − b‖, ‖a + b‖) of unit vectors, which stays accurate for small angles (Kahan, How
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
    """Clusters in which no two members are further apart than `largest`, merged from the closest pair on.

    The cluster of the first item comes first, the others in the order of their first members.
    """
    clusters = [[index] for index in range(len(angles))]
    while len(clusters) > 1:
        pairs = [
            (max(angles[i, j] for i in first for j in second), a, b)
            for a, first in enumerate(clusters)
            for b, second in enumerate(clusters)
            if a < b
        ]
        distance, a, b = min(pairs)
        if distance > largest:
            break
        clusters[a] = sorted(clusters[a] + clusters.pop(b))
    return sorted(clusters)


@dataclass(frozen=True)
class Detectable:
    """Smallest effect that the training record would show."""

    effect: str
    easiest: float
    hardest: float
    """`easiest`, `hardest`: RMS of the force it must add, in the output's unit, for the form and shape that the record
    shows best and worst."""


def detectable_effects(
    diagnosis: Verdict, catalogue: dict[str, Effect], null: NullDistribution
) -> list[Detectable]:
    """Smallest detectable force of every effect that the model does not have, the best shown first.

    An effect is selected when its statistic N R² exceeds the threshold of the null table; R² counts only what the model's own
    parameters cannot take up. A force of which they take up the share 1 − s must therefore have the RMS σ √(threshold/(N s)).
    Effects that are no force beside the tissue's are judged by the change they make at their starting nonlinear parameters.
    """
    fit, data = diagnosis.model.fit, diagnosis.experiment.training
    least = diagnosis.noise_rms * np.sqrt(null.threshold(number_of_forms(catalogue)) / data.size)
    basis = tangent_basis(fit, [data])
    found = []
    for effect in catalogue.values():
        if effect.name in diagnosis.selected:
            continue
        shares = [share for form in effect.forms for share in _shares_left(fit, form, data, basis)]
        if shares:
            found.append(
                Detectable(
                    effect.name, *(float(least / np.sqrt(part)) for part in (max(shares), min(shares)))
                )
            )
    return sorted(found, key=lambda item: item.easiest)


def _shares_left(fit: Fit, form: Form, data: FitData, basis: np.ndarray) -> list[float]:
    """Share of a form's force, in squares, that the model cannot take up, for several nonlinear parameters."""
    residual = data.force - fit.simulate(data.motion)
    starts = nonlinear_starts(form, data, residual)
    chosen = [starts[index] for index in sorted({0, len(starts) // 2, len(starts) - 1})][:_STARTS]
    shares = []
    for start in chosen:
        for signal in added_forces(fit, form, data, start).T:
            energy = float(signal @ signal)
            left = beyond(basis, signal)
            if energy > 0 and left @ left > _NOTHING * energy:
                shares.append(float(left @ left) / energy)
    return shares
