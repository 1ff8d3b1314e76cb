"""Which further record would help most to see what these records do not show, or show as something else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lumbar.tissue.diagnosis.design.discrimination import CLEAR
from lumbar.tissue.diagnosis.design.excitation_family import ExcitationCandidate, excitation_family
from lumbar.tissue.diagnosis.doctor.effect_sizes import EffectSize
from lumbar.tissue.diagnosis.doctor.outcome import Kind
from lumbar.tissue.diagnosis.doctor.truth import Truth
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.sensitivity_subspace import beyond, tangent_basis
from lumbar.tissue.diagnosis.selection.sentences import effects_text, readable
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.signals.machine_limits import Kinematics

_HARDEST = 3
"""Effects, those that are named last, that a further record is sought for where nothing is unclear."""
_HELPS = 1.5
"""Factor on the distance from which on a record is said to help."""
_HIDDEN = 0.1
"""Noise standard deviations below which a distance is as good as none."""
_NAMED_IN_SENTENCE = 4


@dataclass(frozen=True, eq=False)
class Question:
    """An effect that these records do not show for what it is."""

    effect: str
    truth: Fit
    """The model with the effect, of the size that was missed."""
    rival: Fit
    """The model without it, or the one that was taken for it."""
    mistaken_for: tuple[str, ...] = ()
    """Effects of that one."""

    @property
    def words(self) -> str:
        """The effect, and what it was taken for."""
        name = readable(self.effect)
        return f"{name} from {effects_text(self.mistaken_for)}" if self.mistaken_for else name

    def distance(self, data: FitData, noise: float) -> float:
        """Noise standard deviations between both models under an excitation, beyond what the rival's parameters take up."""
        difference = data.counted(self.truth.simulate(data.motion) - self.rival.simulate(data.motion))
        left = beyond(tangent_basis(self.rival, [data]), difference)
        return float(np.sqrt(left @ left) / noise)


@dataclass(frozen=True, eq=False)
class FurtherRecord:
    """The excitation that answers most of what the records leave open."""

    excitation: ExcitationCandidate
    questions: tuple[Question, ...]
    """Those that it answers better than the training record."""
    distances: tuple[float, ...]
    recorded: tuple[float, ...]
    """`distances`, `recorded`: noise standard deviations under the excitation and on the training record."""
    tried: int
    """Excitations that were tried."""

    @property
    def sentence(self) -> str:
        """What to record, and what it would show."""
        rows = sorted(
            zip(self.questions, self.distances, self.recorded, strict=True), key=lambda row: row[2] / row[1]
        )
        shown = [f"{item.words} {far:.2g} (now {own:.2g})" for item, far, own in rows[:_NAMED_IN_SENTENCE]]
        more = f" and {len(rows) - len(shown)} more" if len(rows) > len(shown) else ""
        beyond_range = "" if self.excitation.within else "; it leaves the range of your record"
        return (
            f"The further record that helps most of {self.tried} tried: {self.excitation.words}; it would tell, in noise "
            f"standard deviations, {', '.join(shown)}{more}{beyond_range}."
        )

    def to_json(self) -> dict:
        """Return what ``doctor.json`` holds under ``further_record``."""
        motion = self.excitation.motion
        rows = zip(self.questions, self.distances, self.recorded, strict=True)
        return {
            "description": self.excitation.words,
            "duration_s": motion.sampling_time * len(motion),
            "within_recorded_range": self.excitation.within,
            "tried": self.tried,
            "tells": [
                {
                    "effect": item.effect,
                    "from": list(item.mistaken_for),
                    "noise_standard_deviations": far,
                    "noise_standard_deviations_recorded": own,
                }
                for item, far, own in rows
            ],
        }


def open_questions(sizes: Sequence[EffectSize]) -> list[Question]:
    """What a further record should answer: what was never named, or taken for something else; else what is named last."""
    excited = [item for item in sizes if item.trials and not item.form.channels]
    unclear = [item for item in excited if item.smallest is None or _misread(item)]
    last = sorted(excited, key=lambda item: -(item.smallest or 0.0))[:_HARDEST]
    return [_question(item) for item in unclear or last]


def _misread(item: EffectSize) -> bool:
    missed = item.trials.at_missed if item.trials else None
    return missed is not None and missed.kind in (Kind.MISTAKEN, Kind.TIED)


def _question(item: EffectSize) -> Question:
    """The effect of the largest size that was missed, or a little smaller than the smallest that was named."""
    assert item.trials is not None
    missed = (item.smallest or 0.0) / 2 if item.trials.missed is None else item.trials.missed * item.noise
    size = min(missed, item.injection.largest)
    outcome = item.trials.at_missed
    rival, others = item.injection.model, ()
    if outcome and outcome.verdict and _misread(item):
        found = outcome.verdict
        candidates = [found.model, *found.tied_with]
        wrong = next((each for each in candidates if item.form.effect not in each.effects), None)
        if wrong is not None and found.experiment.surface == 0:
            rival = wrong.fit
            others = tuple(
                name for name in wrong.effects if name not in item.injection.model.structure.effects
            )
    return Question(item.form.effect, item.injection.at(size), rival, others)


def further_record(
    truth: Truth, questions: list[Question], limits: Kinematics | None
) -> FurtherRecord | None:
    """Search the excitation that answers the open questions best, to first order.

    Each answer counts by the logarithm of its distance, so that one clear answer does not stand for many. Where excitations
    within the recorded range make all of them clear, one of these is taken. None where no excitation is better than the
    training record.

    Parameters
    ----------
    limits : Kinematics, optional
        Of the machine, in the input's unit: see `excitation_family`.
    """
    if not questions:
        return None
    experiment, noise = truth.verdict.experiment, truth.noise
    longest, _ = truth.training.longest(truth.training.force)
    from_surface = replace(longest, position=longest.position + experiment.surface)
    family = excitation_family(from_surface, experiment.input_unit, limits)

    def distances(motion: Motion) -> np.ndarray:
        data = FitData("", motion, np.zeros(len(motion)), truth.training.whitening)
        return np.array([item.distance(data, noise) for item in questions])

    def told(found: np.ndarray) -> float:
        return float(np.sum(np.log(np.maximum(found, _HIDDEN))))

    recorded = distances(longest)
    judged = [
        (distances(replace(item.motion, position=item.motion.position - experiment.surface)), item)
        for item in family
    ]
    if not judged:
        return None
    inside = [pair for pair in judged if pair[1].within and pair[0].min() > CLEAR]
    best, excitation = max(inside or judged, key=lambda pair: told(pair[0]))
    helped = [number for number in range(len(questions)) if best[number] > _HELPS * recorded[number]]
    if told(best) <= told(recorded) or not helped:
        return None
    return FurtherRecord(
        excitation,
        tuple(questions[number] for number in helped),
        tuple(float(best[number]) for number in helped),
        tuple(float(recorded[number]) for number in helped),
        len(family),
    )
