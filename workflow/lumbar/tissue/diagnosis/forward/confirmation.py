"""Models that the search named turned round, judged by their simulation from force to motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.forward.forward_base import simulated
from lumbar.tissue.diagnosis.forward.forward_fit import EVALUATIONS
from lumbar.tissue.diagnosis.selection.forward_selection import Candidate, is_adequate
from lumbar.tissue.diagnosis.selection.null_distribution import shipped
from lumbar.tissue.diagnosis.selection.selection import Selection
from lumbar.tissue.models.forward_structure import ForwardStructure

_RIVALS = 5
"""Sets of effects, beside those named, that are simulated."""


class Confirmation(Selection):
    """Keeps what passes by simulation, as the search does by the turned-round records.

    Parameters
    ----------
    experiment : Experiment
        Forward records.
    base : Candidate
        Simulated on them.
    settings : DiagnosisSettings
    named, rivals : sequence of Candidate
        Models that were named, and others.
    zero_of : callable
        From a fit of theirs to the zero of the motion's sensor.
    evaluations : int
        Of the error, at most, to fit one of them.
    """

    def __init__(
        self,
        experiment: Experiment,
        base: Candidate,
        settings: DiagnosisSettings,
        named: Sequence[Candidate] = (),
        rivals: Sequence[Candidate] = (),
        zero_of: Callable[[Fit], float] = lambda fit: fit.zero,
        evaluations: int = EVALUATIONS,
    ):
        super().__init__(experiment, base, settings, shipped("tissue"), singles=[])
        self.named = named
        self.rivals = rivals
        self.zero_of = zero_of
        self.evaluations = evaluations

    def selected_path(self) -> list[Candidate]:
        """Simulate what was named, and its rivals; from the base on to larger sets that pass, the best of each step."""
        self.simulate(self.named)
        rivals = self.rivals
        best = min([self.base, *self.tried], key=lambda item: item.score)
        if is_adequate(best, self.experiment):
            # What is larger explains nothing more.
            rivals = [item for item in rivals if len(item.effects) <= len(best.effects)]
        self.simulate(rivals[:_RIVALS])
        path = [self.base]
        while larger := [item for item in self.tried if self.follows(path[-1], item)]:
            fewest = min(len(item.effects) for item in larger)
            path.append(
                min((item for item in larger if len(item.effects) == fewest), key=lambda item: item.score)
            )
        return path

    def simulate(self, models: Sequence[Candidate]) -> None:
        """Fit models by their simulation, each set of forms once."""
        known = {item.fit.structure.forms for item in self.tried}
        for item in models:
            structure = ForwardStructure(self.base.fit.structure.base, item.fit.structure.forms)
            if structure.forms and structure.forms not in known:
                known.add(structure.forms)
                start = item.fit.linear, item.fit.nonlinear, self.zero_of(item.fit)
                found = simulated(self.experiment, structure, *start, self.evaluations)
                if np.isfinite(found.score):
                    self.tried.append(found)

    def follows(self, before: Candidate, after: Candidate) -> bool:
        """Whether a larger set may be selected after another one."""
        if not set(after.effects) > set(before.effects) or not self.passes(before, after):
            return False
        return before is self.base or self.worthwhile(before, after)

    def further(self, model: Candidate) -> Candidate | None:
        """What was not named turned round is not looked for."""
        return None
