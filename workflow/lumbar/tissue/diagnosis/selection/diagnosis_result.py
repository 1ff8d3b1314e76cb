"""The result of a diagnosis, the state between two of its steps, and the runner of a sequence of steps."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from typing import Any, Self

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.selection.candidate import Candidate
from lumbar.tissue.models.form import Effect, Form
from lumbar.tissue.models.model_data import FittedParameter

_LAST_KINDS = (
    *("surface", "position_offset", "force_offset", "motion_offset"),
    *("turned_frame", "crosstalk", "unexcited"),
    *("apparent_zeros", "force_leads", "higher_order_linear"),
    *("other_rates_missed", "one_rate", "one_ramp", "trained_otherwise", "falling_stiffness", "proposed_law"),
)
"""Kinds of findings that a result lists last, in this order."""


class Status(StrEnum):
    """Verdict on a base model."""

    ADEQUATE = "adequate"
    """No effect passes, and the error is within 1.1 noise floors if that is known."""
    NAMED = "named"
    """The selected effects are missing."""
    TIED = "tied"
    """These records cannot distinguish the selected effects from others."""
    UNEXPLAINED = "unexplained"
    """Something is missing that the selected effects do not explain."""


UNUSABLE = {"status": Status.UNEXPLAINED, "refined_status": Status.UNEXPLAINED, "is_decided": True}
"""New values of fields after a step that detects records to which the models do not apply: no effect is searched."""


@dataclass(frozen=True)
class Step:
    """One step of a diagnosis."""

    step: str
    """Name of the step, e.g. ``"choose the base"``."""
    reason: str
    """Action or finding of the step, with numbers."""
    status: Status | None
    """Status of the base model after the step; None until a model is judged."""


@dataclass(frozen=True, eq=False)
class Ranked:
    """One set of effects with its evidence."""

    candidate: Candidate
    p_value: float
    """Probability of as large a gain if nothing is missing; see `lumbar.tissue.diagnosis.selection.thresholds`."""
    estimates: list[FittedParameter]

    def to_json(self) -> dict:
        """Return the entry of ``ranking`` in ``diagnosis.json``."""
        names, candidate, parameters = [item.name for item in self.estimates], self.candidate, {}
        for item in self.estimates:
            label = item.name if names.count(item.name) == 1 else f"{item.effect or 'base'}.{item.name}"
            values = {key: getattr(item, key) for key in ("value", "low", "high", "unit")}
            parameters[label] = {**values, "effect": item.effect or None}
        return {
            "effects": list(candidate.effects),
            "forms": [form.name for form in candidate.fit.structure.forms],
            "train_rms": candidate.train_rms,
            "test_rms": candidate.test_rms,
            "p_value": self.p_value,
            "converged": candidate.fit.converged,
            "parameters": parameters,
        }


@dataclass(frozen=True, eq=False)
class DiagnosisResult:
    """Status of a base model and the evidence for it; each field is None before its step of the diagnosis."""

    experiment: Experiment = None
    base: Candidate = None
    """Base without effects."""
    status: Status = None
    """Status of the base model: ``verdict`` in ``diagnosis.json``."""
    path: list[Candidate] = field(default_factory=list)
    """Models from the base to the refined model, each with one more effect."""
    tied_with: list[Candidate] = field(default_factory=list)
    """Alternatives that explain the data equally well."""
    ranking: list[Ranked] = field(default_factory=list)
    """Sets of effects with their evidence, best first."""
    tried: list[Candidate] = field(default_factory=list)
    """Best fit of every set of effects that the search tried, best first."""
    explainable_share_removed: float = 0.0
    """Share of the base's unseen error variance, without known noise, that the selected effects remove."""
    refined_status: Status = None
    """Status of the refined model: ``named`` (`further` passes all tests of a selected effect), else ``adequate`` (its error is
    within `COMPLETE` noise floors, or the floor is unknown) or ``unexplained``."""
    further: Candidate | None = None
    """Refined model with the effect that one more step of the search would add. None if there is no such effect, or if the
    refined model leaves only noise."""
    not_tried: list[tuple[Form, tuple[str, ...]]] = field(default_factory=list)
    """Forms that need channels missing in the records, with the missing channels."""
    findings: tuple[Finding, ...] = ()
    """Properties of the records that are not physical effects."""
    is_searched_further: bool = True
    """True if an effect was searched in addition to the selected effects."""
    linear: Candidate | None = None
    """User-defined base of higher-order linear dynamics that explain more than the refined model."""
    proposal: Any = None
    """Proposed law for the error that the catalogue leaves (`law.proposal.Proposal`); None if no law was searched."""
    steps: tuple[Step, ...] = ()
    """Steps of the diagnosis in chronological order."""

    @property
    def model(self) -> Candidate:
        """Refined model: base and selected effects."""
        return self.path[-1]

    @property
    def selected(self) -> tuple[str, ...]:
        """Names of the selected effects, in the order added."""
        return self.model.effects

    @property
    def noise_rms(self) -> float:
        """RMS of the noise per sample: the floor, or the training error of the model if the floor is unknown."""
        floor = self.experiment.floor
        return self.model.train_rms if floor is None else floor.rms

    @property
    def orientation(self) -> Finding | None:
        """Finding on exchanged input and output, an inverted sign or exchanged channels; None if all are right."""
        wrong = ("direction", "sign", "force_channels")
        return next((item for item in self.findings if item.kind in wrong), None)

    @property
    def decided_by(self) -> Step | None:
        """Step that decided the status: the last step with a status other than that of the step before."""
        before = (None, *(step.status for step in self.steps))
        changed = [step for step, status in zip(self.steps, before, strict=False) if step.status != status]
        return changed[-1] if changed else None

    @property
    def is_incomplete(self) -> bool:
        """True if effects are named, but more is missing."""
        return self.status == Status.NAMED and self.refined_status != Status.ADEQUATE

    @property
    def verdict(self) -> str:
        """Status for readers: named effects that leave more than noise are incomplete."""
        return f"{self.status}, incomplete" if self.is_incomplete else str(self.status)

    @property
    def complete(self) -> bool | None:
        """True if the status of the refined model is ``adequate``; None if the noise floor is unknown."""
        return None if self.experiment.floor is None else self.refined_status == Status.ADEQUATE

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
            "ranking": [item.to_json() for item in self.ranking],
            "ladder": [
                {
                    "effects": list(item.effects),
                    **{key: getattr(item, key) for key in ("train_rms", "test_rms", "unseen_rms")},
                }
                for item in self.path
            ],
            "not_tried": [
                {"effect": form.effect, "form": form.name, "missing_channels": list(missing)}
                for form, missing in self.not_tried
            ],
            "steps": [asdict(item) for item in self.steps],
        }


@dataclass(frozen=True, eq=False)
class DiagnosisState:
    """State of a diagnosis between two steps."""

    records: list[Record]
    """Original records."""
    settings: DiagnosisSettings
    """Settings; their catalogue is limited to effects that the records allow as soon as these are known."""
    result: DiagnosisResult = field(default_factory=DiagnosisResult)
    """Result of the steps so far."""
    repaired: tuple[list[Record], list[Finding]] | None = None
    """Records after repair of sensor faults, and findings on these faults."""
    effects: dict[str, Effect] = field(default_factory=dict)
    """All effects that the records allow, including rivals."""
    prepared: Experiment = None
    """Prepared records, with positions that are not counted from a surface."""
    selection: Any = None
    """`forward_selection.Selection` of the current base, with all sets of effects that were tried."""
    inverse: Experiment | None = None
    """Records with the force as input, prepared with the motion as input for the search."""
    is_decided: bool = False
    """True if no further step can change the result."""

    def report(self, step: str, findings: Sequence[Finding], otherwise: str) -> Self:
        """Return the state after a step that only reports findings.

        Parameters
        ----------
        step : str
            Name of the step.
        findings : sequence of Finding
            Findings; their kinds are the result of the step.
        otherwise : str
            Result of the step without findings.
        """
        kinds = ", ".join(item.kind.replace("_", " ") for item in findings)
        return self.next(step, kinds or otherwise, *findings)

    def next(self, step: str, reason: str, *findings: Finding, **changes) -> Self:
        """Return the state after a step.

        Parameters
        ----------
        step : str
            Name of the step.
        reason : str
            Action or finding of the step, with numbers.
        *findings : Finding
            Findings that the step adds.
        **changes
            New values of fields of the state or of its result.
        """
        result, places = self.result, {kind: number for number, kind in enumerate(_LAST_KINDS)}
        changed = {name: value for name, value in changes.items() if hasattr(result, name)}
        listed = (*changed.get("findings", result.findings), *findings)
        changed["findings"] = tuple(sorted(listed, key=lambda item: places.get(item.kind, -1)))
        changed["steps"] = (*result.steps, Step(step, reason, changed.get("status", result.status)))
        own = {name: value for name, value in changes.items() if name not in changed}
        return replace(self, result=replace(result, **changed), **own)


def run(steps: Iterable[Callable[[DiagnosisState], DiagnosisState]], state: DiagnosisState) -> DiagnosisState:
    """Run one step after another until the result is decided."""
    for step in steps:
        if state.is_decided:
            break
        state = step(state)
    return state
