"""The page of a diagnosis as one document: pictures, what they show, and the words around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from lumbar.diagnosis.evidence.evidence import Evidence
from lumbar.diagnosis.residuals.residual_report import Simulated
from lumbar.diagnosis.selection.refined_model import model_name
from lumbar.diagnosis.selection.sentences import headline
from lumbar.diagnosis.selection.verdict import Verdict
from lumbar.models.form import Effect
from lumbar.reports.explorer.answers import cards, how_sure
from lumbar.reports.explorer.one_file import beside, one_file
from lumbar.reports.explorer.plots import ANSWER, FIRST, SECOND, page_models
from lumbar.reports.explorer.shown import (
    ShownModel,
    ShownRecord,
    candidates_of,
    drawing_step,
    model_key,
    shown_model,
    shown_records,
)

if TYPE_CHECKING:
    from bokeh.document import Document
    from markupsafe import Markup

PAGE = "reports/explorer/explorer.html.jinja"
PICTURES = (
    ("course", "Measured and simulated over time", True),
    ("residual", "Measured less simulated over time; grey: ± the noise's RMS", True),
    ("loop", "Output over input: loops", False),
    ("plane", "Error of the first model in the motion", False),
    ("spectrum", "Spectrum of the error; grey: noise", True),
)
"""Name, caption, and whether it takes the page's whole width."""
_FIRST_SHOWN_S = 10.0
"""Seconds that are shown at first of records that do not repeat; of others a period."""


@dataclass(frozen=True, eq=False)
class ExplorerPage:
    """A diagnosis as a page.

    Attributes
    ----------
    verdict : Verdict
    evidence : Evidence
    catalogue : dict of str to Effect
    base_on_records : list of Simulated
        The base model on every record, for what is told of where it fails.
    data : str
        Where the data come from.
    blocks : sequence of Markup
        Further evidence, shown below.
    """

    verdict: Verdict
    evidence: Evidence
    catalogue: dict[str, Effect]
    base_on_records: list[Simulated]
    data: str
    blocks: Sequence[Markup] = field(default_factory=tuple)

    @cached_property
    def step(self) -> int:
        """Every how manieth sample is drawn."""
        return drawing_step(self.verdict.experiment, len(candidates_of(self.verdict)))

    @cached_property
    def models(self) -> list[ShownModel]:
        """Every model that was fitted, the base first."""
        return [
            shown_model(candidate, parameters, self.verdict, self.step)
            for candidate, parameters in candidates_of(self.verdict)
        ]

    @cached_property
    def records(self) -> list[ShownRecord]:
        """Every record, as it is drawn."""
        return shown_records(self.verdict, self.step)

    def fill(self, document: Document) -> None:
        """Put pictures and data into a Bokeh document."""
        from bokeh.models import CustomJS

        drawn, held = page_models(self.verdict.experiment, self.records, self.models)
        answer = next(source for source in held if source.name == ANSWER)
        answer.js_on_change("data", CustomJS(code="window.lumbar.answered(cb_obj.data.content[0])"))
        drawn[0].tags = held  # so that the document has them
        for picture in drawn:
            document.add_root(picture)

    def variables(self, served: bool = False, study: str = "") -> dict[str, Any]:
        """Return what the template shows beside the pictures.

        Parameters
        ----------
        served : bool
            Whether a server stands behind the page.
        study : str
            File that chosen effects may be written to; empty without one.
        """
        verdict, experiment = self.verdict, self.verdict.experiment
        floor = experiment.floor
        return {
            "title": self.title,
            "style": beside("explorer.css"),
            "behaviour": beside("dark.js", "explorer.js"),
            "data": self.data,
            "verdict": verdict.verdict,
            "headline": headline(verdict),
            "findings": [item.sentence for item in verdict.findings],
            "sure": how_sure(verdict, self.evidence),
            "floor": "" if floor is None else f"{floor.rms:.3g} {experiment.output_unit}",
            "records": sorted(self.records, key=lambda record: not record.trained),
            "models": self.models,
            "chosen": model_key(verdict.selected),
            "first_colour": FIRST,
            "second_colour": SECOND,
            "pictures": PICTURES,
            "cards": cards(verdict, self.catalogue),
            "blocks": self.blocks,
            "step": self.step,
            "served": served,
            "study": study,
            "content": self._content(served),
        }

    @property
    def title(self) -> str:
        """Title of the page."""
        return f"Diagnosis of the {self.verdict.base.fit.structure.base.name} model"

    def _content(self, served: bool) -> dict[str, Any]:
        """What the page's script knows: models with errors, and sentences, by key."""
        verdict, floor = self.verdict, self.verdict.experiment.floor
        located = {
            model_key(()): self.base_on_records,
            model_key(verdict.selected): self.evidence.remaining,
        }
        return {
            "unit": verdict.experiment.output_unit,
            "noise_rms": None if floor is None else floor.rms,
            "window_s": _FIRST_SHOWN_S if floor is None else floor.period,
            "base": model_name(verdict.base.fit),
            "selected": list(verdict.selected),
            "served": served,
            "models": {model.key: told(model, located.get(model.key, [])) for model in self.models},
        }

    def to_html(self) -> str:
        """Return the page as a file that needs nothing else: the same bytes for the same diagnosis."""
        return one_file(self.fill, PAGE, self.variables())


def told(model: ShownModel, located: Sequence[Simulated]) -> dict[str, Any]:
    """Return what the page's script knows of a model."""
    return {
        "label": model.label,
        "effects": list(model.effects),
        "train_rms": model.train_rms,
        "test_rms": model.test_rms,
        "merits": model.merits,
        "located": {item.record.name: item.location.sentences for item in located},
    }
