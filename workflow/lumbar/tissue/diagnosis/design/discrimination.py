"""The excitation that tells tied models apart.

Two models are told apart by a record if neither can be refitted to what the other would have answered: the distance is the
size of what one leaves of the other's force, in noise standard deviations, √Σ(F_A − F_B)²/σ, the smaller of both directions. It
is the number of standard deviations by which the statistic of the likelihood-ratio test would be moved (design for model
discrimination: Atkinson and Fedorov, Biometrika 62 (1975) 57-70, T-optimality). Excitations are ranked by the root mean square
of the difference instead, which does not reward mere length: a small difference drowns in what neither model has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.tissue.diagnosis.design.excitation_family import (
    ExcitationCandidate,
    excitation_family,
    motion_csv,
)
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.joint_fit import fit as refit
from lumbar.tissue.diagnosis.fitting.uncertainty import beyond, tangent_basis
from lumbar.tissue.diagnosis.selection.forward_selection import Candidate
from lumbar.tissue.diagnosis.selection.sentences import effects_text
from lumbar.tissue.diagnosis.selection.thresholds import TIED
from lumbar.tissue.diagnosis.selection.ties import noise_rms
from lumbar.tissue.diagnosis.selection.verdict import Verdict
from lumbar.tissue.signals.motion_range import Kinematics

REFITTED = 4
"""How many excitations, the best to first order, are judged with full refits."""
CLEAR = 6.0
"""Noise standard deviations that are enough; beyond it an excitation within the range already recorded is preferred."""


@dataclass(frozen=True, eq=False)
class Separation:
    """The excitation that separates tied candidates best."""

    excitation: ExcitationCandidate
    distance: float
    """Noise standard deviations by which it would separate the closest pair of selected and tied candidates."""
    rms: float
    """Root mean square of that pair's difference, in the output's unit."""
    recorded: float
    """The same distance on the training record."""
    closest: tuple[str, ...]
    """Effects of the selected candidate's closest rival under this excitation."""
    tried: int
    """Number of excitations tried."""

    @property
    def separates(self) -> bool:
        """Whether the tie would be broken: the likelihoods then differ by more than `TIED`."""
        return self.distance**2 > TIED

    @property
    def improves(self) -> bool:
        """Whether it separates better than the record at hand."""
        return self.distance > self.recorded

    def to_json(self) -> dict:
        """Return what ``diagnosis.json`` holds under ``separating_excitation``."""
        return {
            "description": self.excitation.words,
            "duration_s": self.excitation.motion.sampling_time * len(self.excitation.motion),
            "noise_standard_deviations": self.distance,
            "noise_standard_deviations_recorded": self.recorded,
            "difference_rms": self.rms,
            "closest": list(self.closest),
            "separates": self.separates,
            "improves": self.improves,
            "tried": self.tried,
        }


def separating_excitation(diagnosis: Verdict, limits: Kinematics | None = None) -> Separation | None:
    """Search the excitation under which the selected and the tied candidates differ most.

    None without a tie, and where a candidate needs channels beside the input: an excitation says nothing about them.

    Every excitation is judged to first order (the difference beyond the other model's tangent space), the best few with both
    models refitted in turn.

    Parameters
    ----------
    limits : Kinematics, optional
        Of the machine, in the input's unit: see `excitation_family`.
    """
    candidates = [diagnosis.model, *diagnosis.tied_with]
    further = any(form.channels for item in candidates for form in item.fit.structure.forms)
    if not diagnosis.tied_with or further:
        return None
    experiment, noise = diagnosis.experiment, noise_rms(diagnosis)
    training = experiment.training
    family = excitation_family(training.motion, experiment.input_unit, limits)
    rivals = diagnosis.tied_with
    model = diagnosis.model.fit

    def first_order(item: ExcitationCandidate) -> _Left:
        data = FitData(item.words, item.motion, np.zeros(len(item.motion)), training.whitening)
        return min(_left_to_first_order(model, rival.fit, data) for rival in rivals)

    ranked = sorted(((first_order(item), item) for item in family), key=lambda pair: -pair[0].rms)
    inside = [pair for pair in ranked if pair[1].within]
    enough = inside and inside[0][0].distance(noise) > CLEAR
    chosen = [item for _, item in (inside if enough else ranked)[:REFITTED]]
    found = [(*_judged(model, rivals, item, training.whitening), item) for item in chosen]
    left, closest, excitation = max(found, key=lambda item: item[0].rms)
    own = ExcitationCandidate(training.name, training.motion, True)
    recorded = _judged(model, rivals, own, training.whitening)[0]
    return Separation(
        excitation, left.distance(noise), left.rms, recorded.distance(noise), closest, len(family)
    )


@dataclass(frozen=True, order=True)
class _Left:
    """What the best approximation by another model leaves: its RMS (by which it is ordered) and sum of squares."""

    rms: float
    sum_of_squares: float

    @classmethod
    def of(cls, squared: float, size: int) -> _Left:
        return cls(float(np.sqrt(squared / size)), float(squared))

    def distance(self, noise: float) -> float:
        return float(np.sqrt(self.sum_of_squares) / noise)


def _left_to_first_order(first: Fit, second: Fit, data: FitData) -> _Left:
    """The smaller of what either model leaves of the other beyond its tangent space."""
    difference = data.counted(first.simulate(data.motion) - second.simulate(data.motion))
    left = [beyond(tangent_basis(fit, [data]), difference) for fit in (first, second)]
    return min(_Left.of(float(item @ item), data.size) for item in left)


def _judged(model: Fit, rivals: list[Candidate], excitation: ExcitationCandidate, whitening):
    """What full refits leave, for the closest rival, and that rival's effects."""
    judged = [
        (
            min(
                _left_after_refit(truth, other, excitation, whitening)
                for truth, other in ((model, rival.fit), (rival.fit, model))
            ),
            rival.effects,
        )
        for rival in rivals
    ]
    return min(judged, key=lambda item: item[0])


def _left_after_refit(
    truth: Fit, other: Fit, excitation: ExcitationCandidate, whitening: np.ndarray
) -> _Left:
    """What the best approximation by another model leaves of a model's noise-free force."""
    force = truth.simulate(excitation.motion)
    data = FitData(excitation.words, excitation.motion, force, whitening)
    fitted = refit(other.structure, data, other.nonlinear)
    unfitted = data.counted(other.simulate(excitation.motion) - force)
    return _Left.of(min(fitted.squared_error, float(unfitted @ unfitted)), data.size)


def separation_sentence(separation: Separation, diagnosis: Verdict) -> str:
    """The proposal in words."""
    unit = diagnosis.experiment.output_unit
    pair = f"{effects_text(diagnosis.selected)} from {effects_text(separation.closest)}"
    if not separation.separates:
        return (
            f"None of {separation.tried} excitations tried within the machine's limits would tell {pair}: the best, "
            f"{separation.excitation.words}, by {separation.distance:.2g} noise standard deviations; either model will do."
        )
    if not separation.improves:
        return (
            f"The records at hand separate {pair} better ({separation.recorded:.2g} noise standard deviations) than any of "
            f"{separation.tried} excitations tried within the machine's limits ({separation.distance:.2g}): no further "
            "record of these kinds is proposed."
        )
    beyond_range = (
        ""
        if separation.excitation.within
        else " It leaves the range of your record: both models are extrapolated there."
    )
    own = f"your record {diagnosis.experiment.training.name}: {separation.recorded:.2g}"
    return (
        f"To tell {pair}, record {separation.excitation.words} and fit on it: it would separate them by "
        f"{separation.distance:.2g} noise standard deviations ({separation.rms:.2g} {unit} RMS); {own}.{beyond_range}"
    )


def excitation_csv(separation: Separation, diagnosis: Verdict) -> str:
    """The excitation as a file to play: header ``time_s,position_<unit>``."""
    return motion_csv(separation.excitation.motion, diagnosis.experiment.input_unit)
