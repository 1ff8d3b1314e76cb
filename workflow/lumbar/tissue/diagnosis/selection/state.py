"""What a diagnosis knows between two of its steps, and the runner of a sequence of steps."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.selection.candidate import Candidate
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult, Ranked, Status, Step
from lumbar.tissue.models.form import Effect, Form

_LAST_KINDS = (
    *("surface", "position_offset", "force_offset", "motion_offset"),
    *("turned_frame", "crosstalk", "unexcited"),
    *("apparent_zeros", "force_leads", "higher_order_linear"),
    *("other_rates_missed", "one_rate", "trained_otherwise", "falling_stiffness", "proposed_law"),
)
"""Kinds of findings in the order in which a result lists them, after those of records and sensors."""


@dataclass(frozen=True, eq=False)
class DiagnosisState:
    """What is known between two steps; fields of `DiagnosisResult` have its meaning."""

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
