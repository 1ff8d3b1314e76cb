"""What could have been seen in a set of records: effects put into them, and the further record that helps most."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.progress import track
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.doctor.effect_sizes import (
    Diagnose,
    EffectSize,
    Kind,
    Outcome,
    diagnosis_or_refusal,
    effect_size,
    judge_effect,
)
from lumbar.tissue.diagnosis.doctor.injection import Truth
from lumbar.tissue.diagnosis.evidence.discrimination import CLEAR, ExcitationCandidate, excitation_family
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.uncertainty import beyond, tangent_basis
from lumbar.tissue.diagnosis.selection.thresholds import null_distribution, number_of_forms
from lumbar.tissue.diagnosis.selection.verdict import Verdict, effects_text, readable
from lumbar.tissue.effects.catalogue import choose, usable_effects
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.motion import Motion, SpatialMotion
from lumbar.tissue.signals.spectrum import Kinematics

_HARDEST = 3
"""Effects, those that must be largest to be named, that a further record is sought for where nothing is unclear."""
_HELPS = 1.5
"""Factor on the distance from which on a record is said to help."""
_HIDDEN = 0.1
"""Noise standard deviations below which a distance is as good as none."""
_NAMED_IN_SENTENCE = 4


@dataclass(frozen=True, eq=False)
class Examination:
    """What could have been seen."""

    truth: Truth
    nothing: Outcome
    """What was said of the records that the refined model would give, nothing put into them."""
    effects: tuple[EffectSize, ...]
    further: "FurtherRecord | None"

    @property
    def false_alarm(self) -> bool:
        """Whether something was named where nothing had been put in."""
        return self.nothing.kind is Kind.MISTAKEN


def examine(
    records: Sequence[Record],
    verdict: Verdict,
    catalogue: dict[str, Effect],
    diagnose: Diagnose,
    *,
    effects: Sequence[str] | None = None,
    limits: Kinematics | None = None,
    seed: int = 0,
) -> Examination:
    """Put effects into records, diagnose them blind, and seek the further record that helps most.

    Parameters
    ----------
    verdict : Verdict
        Their diagnosis.
    catalogue : dict of str to Effect
        Candidates of a diagnosis.
    diagnose : callable
        Blind diagnosis.
    effects : sequence of str, optional
        Names in the catalogue; default all.
    limits : Kinematics, optional
        Of the machine that would play a further excitation, in the input's unit.
    seed : int
        Of noise.

    Raises
    ------
    InputError
        For an unknown effect, and for records of which the direction or a sign is wrong.
    """
    if verdict.orientation is not None:
        raise InputError(f"nothing can be put into these records: {verdict.orientation.sentence}")
    truth = Truth.of(verdict, records, seed)
    usable, _ = usable_effects(catalogue, truth.training.motion.channels, truth.training.scale)
    searched = {name: effect for name, effect in usable.items() if not effect.rival}
    wanted = searched if effects is None else _choice(effects, catalogue, usable)
    unchanged = diagnosis_or_refusal(truth.records(truth.fit), len(verdict.selected) + 1, diagnose)
    base = truth.fit.structure.base
    nothing = judge_effect(unchanged, "", verdict.selected, base.name)
    least_gain = null_distribution(base.system).threshold(number_of_forms(usable))
    sizes = [
        effect_size(truth, effect, least_gain, diagnose)
        for effect in track(list(wanted.values()), "effects tried")
    ]
    several = isinstance(truth.training.motion, SpatialMotion)
    further = None if several else further_record(truth, open_questions(sizes), limits)
    return Examination(truth, nothing, tuple(sizes), further)


def _choice(
    names: Sequence[str], catalogue: dict[str, Effect], usable: dict[str, Effect]
) -> dict[str, Effect]:
    choose(list(names), catalogue)
    missing = [name for name in names if name not in usable]
    if missing:
        raise InputError(
            f"{', '.join(missing)}: needs channels that these records do not have; can be tried: {', '.join(usable)}"
        )
    return {name: usable[name] for name in dict.fromkeys(names)}


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
        difference = data.whiten(self.truth.simulate(data.motion) - self.rival.simulate(data.motion))
        left = beyond(tangent_basis(self.rival, [data]), difference)
        return float(np.sqrt(left @ left) / noise)


@dataclass(frozen=True, eq=False)
class FurtherRecord:
    """The excitation that answers most of what the records leave open."""

    excitation: ExcitationCandidate
    answers: tuple[tuple[Question, float, float], ...]
    """Questions that it answers better than the training record, each with the noise standard deviations under the excitation
    and on that record."""
    tried: int
    """Excitations that were tried."""

    @property
    def sentence(self) -> str:
        """What to record, and what it would show."""
        rows = sorted(self.answers, key=lambda row: row[2] / row[1])
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
                for item, far, own in self.answers
            ],
        }


def open_questions(sizes: Sequence[EffectSize]) -> list[Question]:
    """What a further record should answer: what was not named; where all was, what must be largest to be."""
    excited = [item for item in sizes if item.put_in is not None and not item.form.channels]
    unclear = [item for item in excited if not item.is_named]
    last = sorted(excited, key=lambda item: -(item.put_in or 0.0))[:_HARDEST]
    return [_question(item) for item in unclear or last]


def _question(item: EffectSize) -> Question:
    """The effect of the size that was missed, or of half the one that was named."""
    assert item.put_in is not None
    assert item.outcome is not None
    size = item.put_in / 2 if item.is_named else item.put_in
    rival, others, found = item.injection.model, (), item.outcome.verdict
    if (
        found
        and item.outcome.kind in (Kind.MISTAKEN, Kind.TIED)
        and found.experiment.surface == found.experiment.rest[0]
    ):
        candidates = [found.model, *found.tied_with]
        wrong = next((each for each in candidates if item.form.effect not in each.effects), None)
        if wrong is not None:
            others = tuple(name for name in wrong.effects if name not in rival.structure.effects)
            rival = wrong.fit
    return Question(item.form.effect, item.injection.at(size), rival, others)


def further_record(
    truth: Truth, questions: list[Question], limits: Kinematics | None
) -> FurtherRecord | None:
    """Search the excitation that answers the open questions best, to first order.

    Each answer counts by the logarithm of its distance, so that one clear answer does not stand for many. Where excitations
    within the recorded range make all of them clear, one of these is taken. None where no excitation is better than the
    training record.

    `limits` are the machine's, in the input's unit: see `excitation_family`.
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
        tuple((questions[number], float(best[number]), float(recorded[number])) for number in helped),
        len(family),
    )
