"""The result of a diagnosis: status of the base model, evidence and sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from itertools import pairwise
from pathlib import Path
from typing import Any

from lumbar.base.yaml_file import shipped_yaml
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.noise.noise_floor import NoiseFloor
from lumbar.tissue.diagnosis.selection.candidate import Candidate, contradictions, is_adequate
from lumbar.tissue.diagnosis.selection.thresholds import COMPLETE, EXPLAINS, LEVEL
from lumbar.tissue.effects.catalogue import CHANNELS
from lumbar.tissue.models.form import Effect, Form
from lumbar.tissue.models.model_data import FittedParameter

_MOST = 7
"""Digits: errors that differ by less are alike."""

_NOTABLE = 0.1
"""What a right model leaves beside the noise, in noise floors, from which on it is worth a word."""
_APART = 1.5
"""Ratio of the errors of unseen records from which on they are told one by one."""
_SAID: dict[str, str] = shipped_yaml(Path(__file__).with_suffix(".yaml"))
CONDITIONAL = _SAID["conditional"]


class Status(StrEnum):
    """Whether a base model lacks something, and what."""

    ADEQUATE = "adequate"
    """No effect passes, and the error is within 1.1 noise floors if that is known."""
    NAMED = "named"
    """The selected effects are missing."""
    TIED = "tied"
    """The selected effects cannot be distinguished from others on these records."""
    UNEXPLAINED = "unexplained"
    """Something is missing that the selected effects do not explain."""


@dataclass(frozen=True)
class Step:
    """One step of a diagnosis."""

    step: str
    """Name, e.g. ``"choose the base"``."""
    reason: str
    """What it did or found, with numbers."""
    status: Status | None
    """Status of the base model after the step; None as long as no model was judged."""


@dataclass(frozen=True, eq=False)
class Ranked:
    """One set of effects with its evidence."""

    candidate: Candidate
    p_value: float
    """See `lumbar.tissue.diagnosis.selection.thresholds`."""
    estimates: list[FittedParameter]


@dataclass(frozen=True, eq=False)
class DiagnosisResult:
    """Status of a base model and the evidence for it."""

    experiment: Experiment
    base: Candidate
    """The base alone."""
    status: Status
    """Status of the base model: ``verdict`` in ``diagnosis.json``."""
    path: list[Candidate]
    """Base, base and first effect, …."""
    tied_with: list[Candidate]
    """Alternatives that explain the data as well."""
    ranking: list[Ranked]
    """Sets of effects, best first."""
    explainable_share_removed: float
    """Share of the base's variance on unseen records, that of known noise aside, that the selected effects remove."""
    refined_status: Status
    """Status of the refined model: ``named`` (`further` passes what an effect must pass to be selected), else
    ``adequate`` (its error is within `COMPLETE` of the noise floor, or that is not known) or ``unexplained``."""
    further: Candidate | None = None
    """Refined model with the effect that one more step of the search would add. None as well where the refined model
    leaves only noise, so that no step was made."""
    not_tried: list[tuple[Form, tuple[str, ...]]] = field(default_factory=list)
    """Forms that need channels which the records do not have, with these channels."""
    findings: tuple[Finding, ...] = ()
    """What is true of the records and is no physical effect."""
    is_searched_further: bool = True
    """Whether a further effect was searched for in addition to those selected."""
    linear: Candidate | None = None
    """Linear dynamics of higher order that explain more than the refined model, as a base of their own."""
    proposal: Any = None
    """The search of a law for what the catalogue leaves (`law.proposal.Proposal`); None if none was made."""
    steps: tuple[Step, ...] = ()
    """Steps of the diagnosis in their order."""

    @property
    def model(self) -> Candidate:
        """The refined model: base and selected effects."""
        return self.path[-1]

    @property
    def selected(self) -> tuple[str, ...]:
        """Names of the selected effects, in the order added."""
        return self.model.effects

    @property
    def noise_rms(self) -> float:
        """Noise per sample: the floor, or what the model leaves of its training record where there is none."""
        floor = self.experiment.floor
        return self.model.train_rms if floor is None else floor.rms

    @property
    def orientation(self) -> Finding | None:
        """The finding that input and output, a sign or channels are the wrong way round; None where they are not."""
        wrong = ("direction", "sign", "force_channels")
        return next((item for item in self.findings if item.kind in wrong), None)

    @property
    def decided_by(self) -> Step | None:
        """The step that set the status: the last one with another status than the step before it."""
        decided, before = None, None
        for step in self.steps:
            if step.status != before:
                decided, before = step, step.status
        return decided

    @property
    def complete(self) -> bool | None:
        """Whether the status of the refined model is ``adequate``; None where the noise floor is unknown."""
        return None if self.experiment.floor is None else self.refined_status == Status.ADEQUATE

    @property
    def goes_beyond_catalogue(self) -> bool:
        """Whether a law that no effect holds may be what is left.

        Not where nothing is known to be left, where the effects named go on with one more that passes and leaves but
        noise, nor where records are the wrong way round, so that whatever fits them is no force law.
        """
        goes_on = self.further is not None and is_adequate(self.further, self.experiment, COMPLETE)
        named_on = self.complete is False and not goes_on
        return self.orientation is None and (self.status == Status.UNEXPLAINED or named_on)

    def to_json(self) -> dict:
        """Return the content of ``diagnosis.json`` (schema ``lumbar.diagnosis/1``)."""
        floor = self.experiment.floor
        return {
            "schema": "lumbar.diagnosis/1",
            "base": self.base.fit.structure.base.name,
            "train": self.experiment.training.name,
            "unit": self.experiment.output_unit,
            "verdict": self.status,
            "complete": self.complete,
            "verdict_after": self.refined_status,
            "further": None if self.further is None else self.further.effects[-1],
            "selected": list(self.selected),
            "tied_with": [
                "+".join(name for name in item.effects if name not in self.selected)
                for item in self.tied_with
            ],
            "findings": [item.to_json() for item in self.findings],
            "noise_floor_rms": None if floor is None else floor.rms,
            "explainable_share_removed": self.explainable_share_removed,
            "ranking": [_ranked_json(item) for item in self.ranking],
            "ladder": [
                {
                    "effects": list(item.effects),
                    "train_rms": item.train_rms,
                    "test_rms": item.test_rms,
                    "unseen_rms": item.unseen_rms,
                }
                for item in self.path
            ],
            "not_tried": [
                {"effect": form.effect, "form": form.name, "missing_channels": list(missing)}
                for form, missing in self.not_tried
            ],
            "steps": [asdict(item) for item in self.steps],
        }


def _ranked_json(item: Ranked) -> dict:
    parameters: dict[str, dict] = {}
    names = [estimate.name for estimate in item.estimates]
    for estimate in item.estimates:
        key = (
            estimate.name
            if names.count(estimate.name) == 1
            else f"{estimate.effect or 'base'}.{estimate.name}"
        )
        parameters[key] = {
            "value": estimate.value,
            "low": estimate.low,
            "high": estimate.high,
            "unit": estimate.unit,
            "effect": estimate.effect or None,
        }
    return {
        "effects": list(item.candidate.effects),
        "forms": [form.name for form in item.candidate.fit.structure.forms],
        "train_rms": item.candidate.train_rms,
        "test_rms": item.candidate.test_rms,
        "p_value": item.p_value,
        "converged": item.candidate.fit.converged,
        "parameters": parameters,
    }


def distinguishing_digits(values: Sequence[float], fewest: int) -> list[str]:
    """Return numbers in words with so many digits, `fewest` at least, that neighbours which differ read differently.

    Examples
    --------
    >>> distinguishing_digits([1.42, 1.404, 1.398], 2)
    ['1.42', '1.404', '1.398']
    >>> distinguishing_digits([8700.0, 1796.0], 3)
    ['8700', '1800']
    """
    wanted = sum(f"{a:.{_MOST}g}" != f"{b:.{_MOST}g}" for a, b in pairwise(values))
    for digits in range(fewest, _MOST + 1):
        words = [_written(value, digits) for value in values]
        if sum(a != b for a, b in pairwise(words)) == wanted:
            break
    return words


def _written(value: float, digits: int) -> str:
    """A number to so many digits; thousands without an exponent."""
    rounded = float(f"{value:.{digits}g}")
    return f"{rounded:.0f}" if 10.0**digits <= abs(rounded) < 1e6 else f"{value:.{digits}g}"


def readable(name: str) -> str:
    """Name of an effect for a reader."""
    return name.replace("_", " ")


def effects_text(names) -> str:
    """Names of several effects for a reader."""
    *first, last = [readable(name) for name in names] or ["no effect"]
    return f"{', '.join(first)} and {last}" if first else last


def headline(result: DiagnosisResult) -> str:
    """Return the result in one sentence."""
    unit, base = result.experiment.output_unit, result.base.fit.structure.base.name
    before, after = result.base.test_rms, result.model.test_rms
    named = effects_text(result.selected)
    share, fall = _percent(1 - after / before), error_falls(result)
    if result.orientation is not None:
        return f"These records are not what the {base} model takes. {result.orientation.sentence}"
    if result.status == Status.ADEQUATE:
        return f"Nothing is missing: what the {base} model leaves ({before:.3g} {unit}) is noise as far as can be told."
    if result.status == Status.NAMED:
        added = "it" if len(result.selected) == 1 else "them"
        return f"The {base} model is missing {named}: with {added} {fall}."
    if result.status == Status.TIED:
        others = ", ".join(effects_text(item.effects) for item in result.tied_with)
        return _SAID["tied"].format(named=named, fall=fall, others=others)
    missing = _SAID["unexplained"].format(base=base)
    if not result.selected:
        return f"{missing}."
    near = "a_little" if result.explainable_share_removed < EXPLAINS else "nearest"
    return missing + _SAID[near].format(named=named, s="s" * (len(result.selected) == 1), share=share)


def explain(result: DiagnosisResult) -> list[str]:
    """Return one line per step: its name, what it did or found, and which step decided the status."""
    decided = result.decided_by
    return [
        f"{item.step}: {item.reason}" + (f" [decided: {item.status}]" if item is decided else "")
        for item in result.steps
    ]


def error_falls(result: DiagnosisResult) -> str:
    """By how much the error on unseen records falls with the selected effects, from what to what."""
    before, after = result.base.test_rms, result.model.test_rms
    errors = " to ".join(distinguishing_digits([before, after], 3))
    unit = result.experiment.output_unit
    return _SAID["fall"].format(share=_percent(1 - after / before), errors=errors, unit=unit)


def _percent(share: float) -> str:
    """A share in words: with a decimal where it is nearly all or nearly nothing."""
    return f"{100 * share:.{1 if share > 0.99 or share < 0.1 else 0}f} %"


def noise_sentence(experiment: Experiment) -> str:
    """Say how large the noise is and what that is taken from, or that it is unknown."""
    floor = experiment.floor
    if experiment.points:
        return "How much of the error is noise is unknown: the same positions measured again would say."
    if floor is None:
        return _SAID["no_floor"]
    alike = _SAID["alike"] if floor.exact else ""
    two = _SAID["two_periods"] if floor.halves else ""
    noted = experiment.beside_floor > _NOTABLE * floor.rms
    beside = _SAID["beside_floor"].format(experiment=experiment) if noted else ""
    return _SAID["floor"].format(experiment=experiment, floor=floor, alike=alike, two=two) + beside


def details(result: DiagnosisResult, catalogue: dict[str, Effect]) -> list[str]:
    """Return what a reader asks next: noise, share explained, runner-up, what would settle a tie."""
    unit, floor = result.experiment.output_unit, result.experiment.floor
    lines = [item.sentence for item in result.findings if item is not result.orientation]
    if any("interval" in line for line in lines):
        lines.append(CONDITIONAL)
    if not result.model.fit.converged:
        base = result.base.fit.structure.base.name
        named = f"{base} with {effects_text(result.selected)}" if result.selected else base
        lines.append(_SAID["not_converged"].format(model=named))
    if result.linear is not None:
        lines.append(_SAID["linear"].format(model=result.linear.fit.structure.base.name))
    lines.append(noise_sentence(result.experiment))
    if floor is not None:
        lines += [
            f"Beside noise the periods differ by {words} (RMS {rms:.3g} {unit})."
            for words, rms in floor.structured
        ]
    if result.selected:
        lines.append(_removed_and_left(result))
        lines.append(what_is_left(result))
    unseen = result.model.unseen_rms
    if max(unseen.values()) > _APART * min(unseen.values()):
        told = ", ".join(f"{name} {rms:.3g}" for name, rms in unseen.items())
        lines.append(f"Error on unseen records, one by one: {told} {unit}.")
    if result.status in (Status.NAMED, Status.TIED):
        lines += [
            f"{readable(name).capitalize()}: {catalogue[name].mechanism} {catalogue[name].sensors}".rstrip()
            for name in result.selected
        ]
    second = runner_up(result)
    if second is not None:
        lines.append(_second_sentence(result, second))
    for item in result.tied_with:
        new = [name for name in item.effects if name not in result.selected]
        lines += [f"To settle {readable(name)}: {catalogue[name].experiment}." for name in new]
    if result.tied_with:
        lines += [f"To settle {readable(name)}: {catalogue[name].experiment}." for name in result.selected]
    return lines + not_tried(result)


def not_tried(result: DiagnosisResult) -> list[str]:
    """Say which candidates the records left out, and what would have to be recorded for them."""
    columns: dict[str, dict[str, None]] = {}
    for form, missing in result.not_tried:
        columns.setdefault(form.effect, {}).update({CHANNELS.get(role, role): None for role in missing})
    return [
        f"Not tried: {readable(name)} as measured, for want of {' and '.join(missing)} in the records."
        for name, missing in columns.items()
    ]


def _second_sentence(result: DiagnosisResult, second: Ranked) -> str:
    """The best set of effects that was not selected, and why it was not where the base is adequate."""
    rms, base = second.candidate.test_rms, result.base
    error = f"{effects_text(second.candidate.effects)}, error on unseen records {rms:.3g} {result.experiment.output_unit}"
    if rms > base.test_rms:
        error += f", worse than {base.fit.structure.base.name} alone ({base.test_rms:.3g})"
    if result.status != Status.ADEQUATE:
        return f"Runner-up: {error}."
    if second.p_value <= LEVEL:
        against = contradictions(second.candidate.fit, result.experiment)
        why = against[0] if against else "on unseen records it is not surely better"
        return _SAID["gains_in_training"].format(error=error, why=why)
    return _SAID["gains_by_chance"].format(error=error, percent=100 * second.p_value, needed=100 * LEVEL)


def _removed_and_left(result: DiagnosisResult) -> str:
    """What is left, in noise floors, then what was removed: 99 % of a large error may leave many times the noise."""
    share = f"{100 * result.explainable_share_removed:.1f} % of the variance"
    floor, model = result.experiment.floor, result.model
    if floor is None:
        return f"The selected effects remove {share} of the error on unseen records, noise included."
    rms = max(model.train_rms, model.test_rms)
    unit = result.experiment.output_unit
    return _SAID["left"].format(times=times_floor(rms, floor), rms=rms, unit=unit, share=share)


def times_floor(rms: float, floor: NoiseFloor) -> str:
    """An error in noise floors, with decimals where they say something."""
    times = rms / floor.rms
    return f"{times:.2f}" if times < 10 else f"{times:.0f}" if times < 1000 else "more than a thousand"


def what_is_left(result: DiagnosisResult) -> str:
    """Say whether anything is missing from the model with the selected effects."""
    unit, floor, model = result.experiment.output_unit, result.experiment.floor, result.model
    if result.further is not None:
        effect = readable(result.further.effects[-1])
        return _SAID["further"].format(effect=effect, rms=result.further.test_rms, unit=unit)
    if floor is not None and is_adequate(model, result.experiment):
        return "What is left is noise as far as can be told."
    left = "something unexplained is left and " if result.refined_status == Status.UNEXPLAINED else ""
    if not result.is_searched_further:
        return f"{left}no further effect was looked for.".capitalize()
    return f"Diagnosed again, {left}none of the most promising further effects passes."


def runner_up(result: DiagnosisResult) -> Ranked | None:
    """Best of the ranked sets of effects that is not the selected one."""
    chosen = set(result.selected)
    return next((item for item in result.ranking if set(item.candidate.effects) != chosen), None)
