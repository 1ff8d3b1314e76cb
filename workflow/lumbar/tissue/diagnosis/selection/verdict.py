"""A diagnosis: the verdict on a base model and the evidence for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.selection.forward_selection import Candidate
from lumbar.tissue.models.form import Form
from lumbar.tissue.models.model_data import FittedParameter

SAME_SCORE = 1e-6
"""Relative difference of scores that rounding on another processor may turn round."""


def in_order(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Candidates by score, the best first; those whose scores are the same to rounding by their effects' names."""
    ordered: list[Candidate] = []
    alike: list[Candidate] = []
    for item in sorted(candidates, key=lambda item: item.score):
        if alike and item.score - alike[0].score > SAME_SCORE * abs(alike[0].score):
            ordered += sorted(alike, key=lambda item: item.effects)
            alike = []
        alike.append(item)
    return ordered + sorted(alike, key=lambda item: item.effects)


@dataclass(frozen=True, eq=False)
class Ranked:
    """One set of effects with its evidence."""

    candidate: Candidate
    p_value: float
    """See `lumbar.tissue.diagnosis.selection.null_distribution`."""
    estimates: list[FittedParameter]


@dataclass(frozen=True, eq=False)
class Verdict:
    """The verdict on a base model and the evidence."""

    experiment: Experiment
    base: Candidate
    """The base alone."""
    verdict: str
    """``adequate``, ``named``, ``tied`` or ``unexplained``."""
    path: list[Candidate]
    """Base, base and first effect, …."""
    tied_with: list[Candidate]
    """Alternatives that explain the data as well."""
    ranking: list[Ranked]
    """Sets of effects, best first."""
    explainable_share_removed: float
    """Share of the base's explainable variance on unseen records that the selected effects remove."""
    verdict_after: str
    """Verdict on the refined model: ``named`` (`further` passes what an effect must pass to be selected), else
    ``adequate`` (its error is within `COMPLETE` of the noise floor, or that is not known) or ``unexplained``."""
    further: Candidate | None = None
    """Refined model with the effect that one more step of the search would add. None as well where the refined model
    leaves only noise, so that no step was made."""
    not_tried: list[tuple[Form, tuple[str, ...]]] = field(default_factory=list)
    """Forms that need channels which the records do not have, with these channels."""
    findings: tuple[Finding, ...] = ()
    """What is true of the records and is no physical effect."""
    diagnosed_again: bool = True
    """Whether a further effect was looked for beside those selected."""

    @property
    def model(self) -> Candidate:
        """The refined model: base and selected effects."""
        return self.path[-1]

    @property
    def selected(self) -> tuple[str, ...]:
        """Names of the selected effects, in the order added."""
        return self.model.effects

    @property
    def turned(self) -> Finding | None:
        """The finding that input and output, or a sign, are the wrong way round; None where they are not."""
        return next((item for item in self.findings if item.kind in ("direction", "sign")), None)

    @property
    def complete(self) -> bool | None:
        """Whether the verdict on the refined model is ``adequate``; None where the noise floor is unknown."""
        return None if self.experiment.floor is None else self.verdict_after == "adequate"

    def to_json(self) -> dict:
        """Return the content of ``diagnosis.json`` (schema ``lumbar.diagnosis/1``)."""
        floor = self.experiment.floor
        return {
            "schema": "lumbar.diagnosis/1",
            "base": self.base.fit.structure.base.name,
            "train": self.experiment.training.name,
            "unit": self.experiment.output_unit,
            "verdict": self.verdict,
            "complete": self.complete,
            "verdict_after": self.verdict_after,
            "further": None if self.further is None else self.further.effects[-1],
            "selected": list(self.selected),
            "tied_with": [_new_effects(item, self.selected) for item in self.tied_with],
            "findings": [item.to_json() for item in self.findings],
            "noise_floor_rms": None if floor is None else floor.rms,
            "explainable_share_removed": self.explainable_share_removed,
            "ranking": [_ranked_json(item) for item in self.ranking],
            "ladder": [
                {"effects": list(item.effects), "train_rms": item.train_rms, "test_rms": item.test_rms}
                for item in self.path
            ],
            "not_tried": [
                {"effect": form.effect, "form": form.name, "missing_channels": list(missing)}
                for form, missing in self.not_tried
            ],
        }


def _new_effects(candidate: Candidate, selected: Sequence[str]) -> str:
    """Name what an alternative has instead of the selected effects."""
    return "+".join(name for name in candidate.effects if name not in selected)


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
