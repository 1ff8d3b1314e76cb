"""The thesis's models of tissue beside a diagnosis: identified on its records, for the page that shows them all."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from lumbar.base.errors import InputError

if TYPE_CHECKING:
    from lumbar.settings.tissue import TissueSettings
    from lumbar.tissue.diagnosis.selection.verdict import Verdict
    from lumbar.tissue.models.fitted_model import FittedModel


@dataclass(frozen=True)
class ThesisModels:
    """Models that can be simulated, and what is to be said of the others."""

    models: list[FittedModel] = field(default_factory=list)
    remark: str = ""
    """Which are missing and why; empty where none is, and where the thesis has none."""


NOT_IDENTIFIED = ThesisModels(
    remark='The thesis\'s models were not identified for this page: "lumbar diagnose --pictures" and "lumbar explore" do so.'
)


def thesis_models(verdict: Verdict, settings: TissueSettings) -> ThesisModels:
    """Identify the thesis's models on the longest record that the diagnosis was trained on.

    Parameters
    ----------
    verdict : Verdict
        Of tissue; for a pendulum the thesis has no such models.
    """
    from lumbar.tissue.identification.identify_tissue import without_intervals

    if verdict.base.fit.structure.base.system != "tissue":
        return ThesisModels()
    experiment = verdict.experiment
    names = [item.name for item in getattr(experiment.training, "parts", (experiment.training,))]
    training = max((record for record in experiment.records if record.name in names), key=len)
    tests = [record for record in experiment.records if record is not training]
    try:
        found = without_intervals(training, tests, settings)
    except InputError as error:
        return ThesisModels(remark=f"The thesis's models could not be identified on these records: {error}")
    unstable = [f"{model.name} ({model.estimator})" for model in found if not model.stable]
    remark = f"Unstable, and without a free run: {', '.join(unstable)}." if unstable else ""
    return ThesisModels([model for model in found if model.stable], remark)
