"""The result of a diagnosis, the state between two of its steps, and the runner of a sequence of steps."""

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, fields, replace
from enum import StrEnum
from typing import Any, Self

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.selection.candidate import Candidate, is_adequate
from lumbar.tissue.diagnosis.selection.thresholds import COMPLETE
from lumbar.tissue.models.form import Effect, Form
from lumbar.tissue.models.model_data import FittedParameter

_LAST_KINDS = (
    *("surface", "position_offset", "force_offset", "motion_offset"),
    *("turned_frame", "crosstalk", "unexcited"),
    *("apparent_zeros", "force_leads", "higher_order_linear"),
    *("other_rates_missed", "one_rate", "trained_otherwise", "falling_stiffness", "proposed_law"),
)
"""Kinds of findings in the order in which a result lists them, after those of records and sensors."""


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
    """Action or finding, with numbers."""
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
    """Properties of the records that are not physical effects."""
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
        """Noise per sample: the floor, or the error of the model in training if the floor is unknown."""
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
        """Whether the status of the refined model is ``adequate``; None if the noise floor is unknown."""
        return None if self.experiment.floor is None else self.refined_status == Status.ADEQUATE

    @property
    def goes_beyond_catalogue(self) -> bool:
        """Whether a law outside the catalogue may explain the rest.

        False if nothing is known to be left, if one more effect passes and leaves only noise, and if records are exchanged, so
        that nothing that fits them is a force law.
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


@dataclass(frozen=True, eq=False)
class DiagnosisState:
    """State of a diagnosis between two steps; fields of `DiagnosisResult` have the same meaning."""

    records: list[Record]
    """Records as given."""
    settings: DiagnosisSettings
    """Settings; their catalogue is limited to what these records allow as soon as that is known."""
    findings: tuple[Finding, ...] = ()
    repaired: tuple[list[Record], list[Finding]] | None = None
    """Records without the faults of their sensors, and these faults."""
    effects: dict[str, Effect] = field(default_factory=dict)
    """All effects that these records allow, rivals included."""
    prepared: Experiment | None = None
    """Records as prepared; their positions are not counted from a surface."""
    experiment: Experiment | None = None
    base: Candidate | None = None
    selection: Any = None
    """`forward_selection.Selection` of the current base, with all sets of effects that were tried."""
    inverse: Experiment | None = None
    """Records with the force as input, prepared with the motion as input for the search."""
    path: list[Candidate] = field(default_factory=list)
    status: Status | None = None
    refined_status: Status | None = None
    tied_with: list[Candidate] = field(default_factory=list)
    ranking: list[Ranked] = field(default_factory=list)
    explainable_share_removed: float = 0.0
    further: Candidate | None = None
    is_searched_further: bool = True
    linear: Candidate | None = None
    not_tried: list[tuple[Form, tuple[str, ...]]] = field(default_factory=list)
    proposal: Any = None
    is_decided: bool = False
    """Whether no further step can change the result."""
    steps: tuple[Step, ...] = ()

    @property
    def model(self) -> Candidate:
        """The last model of the path: base and selected effects."""
        return self.path[-1]

    @property
    def selected(self) -> tuple[str, ...]:
        """Names of the selected effects, in the order added."""
        return self.model.effects

    def next(self, step: str, reason: str, *findings: Finding, **changes) -> Self:
        """Return the state after a step.

        Parameters
        ----------
        step, reason : str
            Name of the step; what it did or found, with numbers.
        findings : Finding
            Findings that the step adds.
        changes
            New values of fields.
        """
        changes["findings"] = (*changes.get("findings", self.findings), *findings)
        status = changes.get("status", self.status)
        return replace(self, steps=(*self.steps, Step(step, reason, status)), **changes)

    def result(self) -> DiagnosisResult:
        """Return the result, its findings in the order of their subjects."""
        values = {item.name: getattr(self, item.name) for item in fields(DiagnosisResult)}
        places = {kind: number for number, kind in enumerate(_LAST_KINDS)}
        values["findings"] = tuple(sorted(self.findings, key=lambda item: places.get(item.kind, -1)))
        return DiagnosisResult(**values)


def run(steps: Iterable[Callable[[DiagnosisState], DiagnosisState]], state: DiagnosisState) -> DiagnosisState:
    """Take one step after another until the result is decided."""
    for step in steps:
        if state.is_decided:
            break
        state = step(state)
    return state
