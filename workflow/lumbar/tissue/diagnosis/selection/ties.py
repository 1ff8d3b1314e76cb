"""How alike the candidates' effects are: the angle between the forces that they add.

What a candidate adds to the base is its simulation less the base's, on all records. Of this counts what the base's own
parameters cannot take up (`lumbar.tissue.diagnosis.fitting.uncertainty`). Two effects whose added forces point the
same way explain the same error; the angle between them says how far they can be told apart, whatever the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.tissue.diagnosis.fitting.uncertainty import beyond, simulation_over, tangent_basis
from lumbar.tissue.diagnosis.selection.forward_selection import Candidate
from lumbar.tissue.diagnosis.selection.thresholds import TIED
from lumbar.tissue.diagnosis.selection.verdict import Verdict

ALIKE = 15.0
"""Degrees: candidates of one cluster add forces that differ by no more (97 % of the force in common)."""


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
    noise = noise_rms(diagnosis)
    # A candidate that adds less than noise would hide has no direction to speak of.
    seen = [index for index in range(len(candidates)) if index == 0 or size[index] ** 2 > TIED * noise**2]
    candidates, added = [candidates[index] for index in seen], added[:, seen]
    angles = angles_between(added)
    hidden = min(1.0, np.sqrt(TIED) * noise / size[0]) if size[0] > 0 else 1.0
    resolution = float(np.degrees(np.arcsin(hidden)))
    return Ties(candidates, angles, complete_linkage(angles, max(ALIKE, resolution)), resolution)


def noise_rms(diagnosis: Verdict) -> float:
    """Noise per sample: the floor, or what the model leaves of its training record where there is none."""
    floor = diagnosis.experiment.floor
    return diagnosis.model.train_rms if floor is None else floor.rms


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

    Returns
    -------
    list of list of int
        The cluster of the first item first, the others in the order of their first members.
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
