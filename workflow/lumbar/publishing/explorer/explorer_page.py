"""Interactive page of a diagnosis: pictures, missing effects with their certainty, and the candidates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from bokeh.document import Document
from bokeh.models import CustomJS
from markupsafe import Markup

from lumbar.publishing.explorer.explorer_pictures import ANSWER, ASIDE, FIRST, SECOND, page_models
from lumbar.publishing.explorer.one_file import add_roots, embed_pictures, one_file
from lumbar.publishing.explorer.page_data import (
    RECORD_COLUMNS,
    PageModel,
    RecordData,
    fitted_candidates,
    gather_records,
    model_key,
    simulate_candidate,
    simulate_thesis_model,
)
from lumbar.publishing.pages.diagnosis_page import candidate_role
from lumbar.publishing.pages.html import equation, table
from lumbar.tables.table_layout import unit_in_print
from lumbar.tissue.diagnosis.evidence.discrimination import Separation, motion_csv, separation_sentence
from lumbar.tissue.diagnosis.evidence.evidence import EXCITATION, Evidence
from lumbar.tissue.diagnosis.residuals.locate import ResidualReport
from lumbar.tissue.diagnosis.residuals.residual import probability
from lumbar.tissue.diagnosis.selection import sentences
from lumbar.tissue.diagnosis.selection.candidate import Candidate
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisResult, Ranked, Status
from lumbar.tissue.diagnosis.selection.refine import model_name
from lumbar.tissue.diagnosis.selection.sentences import distinguishing_digits, effects_text, readable
from lumbar.tissue.diagnosis.selection.thresholds import LEVEL
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.form import Effect

PAGE = "publishing/explorer/explorer.html.jinja"
PICTURES = (
    ("course", "Measured and simulated over time", True, "time"),
    ("residual", "Measured less simulated over time; grey: ± the noise's RMS", True, "candidate causes"),
    ("loop", "Output over input in the time that is shown: loops", False, ""),
    ("plane", "Error of the first model in the motion", False, "position and velocity"),
    ("depth", "Mean error over depth; ▲ advancing, ▼ retracting", False, ""),
    ("turns", "Mean error around reversals, along the motion after them", False, "reversals"),
    ("spectrum", "Spectrum of the error; grey: noise", True, "frequency"),
)
"""Pictures: name, caption, True if as wide as the page, and the view of `locate` in the picture."""
CURVES = (
    ("measured", "measured", "var(--ink)", ""),
    ("first", "first model", FIRST, ""),
    ("second", "second model", SECOND, "dashed"),
    ("aside", "the path set aside", ASIDE, "dashed"),
)
"""Curves that can be switched off: name, label, colour, line style."""
LINES = {"circle": "● excited", "square": "■ even", "triangle": "▲ odd ones that were left out"}
"""Meaning of the spectrum's lines by marker."""
_INITIAL_WINDOW_S = 10.0
"""Initial window in s for records that do not repeat; other records show one period."""
_MAX_UNFOLDED = 6
"""Largest number of parameters that a card shows in an unfolded table."""


@dataclass(frozen=True, eq=False)
class ExplorerPage:
    """Interactive page of a diagnosis."""

    result: DiagnosisResult
    evidence: Evidence
    catalogue: dict[str, Effect]
    base_reports: list[ResidualReport]
    """Reports of the base model on every record."""
    source_label: str
    """Origin of the data."""
    sections: Mapping[str, Sequence[Markup]] = field(default_factory=dict)
    """Further evidence by title, shown in folded sections."""
    others: Sequence[FittedModel] = ()
    """Models of the thesis, shown after the models of the diagnosis."""
    others_remark: str = ""
    """Remark on models of the thesis that are not shown."""
    max_values: int = 1_200_000
    """Largest number of values in a page: 4 bytes each, about 6.5 MB as text."""

    @cached_property
    def step(self) -> int:
        """Step between drawn samples: 1, or more for long records."""
        columns = len(fitted_candidates(self.result)) + len(self.others) + RECORD_COLUMNS
        samples = sum(len(record) for record in self.result.experiment.records)
        return max(1, -(-samples * columns // self.max_values))

    @cached_property
    def models(self) -> list[PageModel]:
        """All fitted models: the base first, the thesis's models last."""
        drawn = self.result.experiment, self.records, self.step
        fitted = [self.simulate(candidate) for candidate in fitted_candidates(self.result)]
        return [*fitted, *(simulate_thesis_model(model, *drawn) for model in self.others)]

    def simulate(self, candidate: Candidate) -> PageModel:
        """Return the simulation of a model, from the diagnosis or fitted later, for drawing."""
        return simulate_candidate(candidate, self.result.experiment, self.records, self.step)

    @cached_property
    def records(self) -> list[RecordData]:
        """Data of all records for drawing."""
        return gather_records(self.result, self.step)

    def fill(self, document: Document) -> None:
        """Add pictures and data to a Bokeh document."""
        pictures, sources = page_models(self.result.experiment, self.records, self.models)
        answer = next(source for source in sources if source.name == ANSWER)
        answer.js_on_change("data", CustomJS(code="window.lumbar.answered(cb_obj.data.content[0])"))
        pictures[0].tags = sources  # so that the document has them
        add_roots(document, pictures)

    def variables(self, served: bool = False) -> dict[str, Any]:
        """Return the template's variables; `served` if a server answers the page's requests."""
        verdict, floor = self.result, self.result.experiment.floor
        markers = {marker for record in self.records for marker in record.marker}
        lines = ", ".join(meaning for marker, meaning in LINES.items() if marker in markers)
        meanings = {"spectrum": f"; the first model's lines: {lines}"} if lines else {}
        groups: dict[str, list[PageModel]] = {}
        for model in self.models:
            groups.setdefault(model.group, []).append(model)
        return {
            "title": self.title,
            "data": self.source_label,
            "verdict": verdict.verdict,
            "tone": "tied" if verdict.is_incomplete else verdict.status,
            "headline": sentences.headline(verdict),
            "left": sentences.remaining_error(verdict) if verdict.selected else "",
            "findings": [item.sentence for item in verdict.findings],
            "sure": confidence_sentences(verdict, self.evidence),
            "floor": "" if floor is None else f"{floor.rms:.3g} {verdict.experiment.output_unit}",
            "records": sorted(self.records, key=lambda record: not record.is_training),
            "groups": groups,
            "others_remark": self.others_remark,
            "chosen": model_key(verdict.selected),
            "first_colour": FIRST,
            "second_colour": SECOND,
            "curves": CURVES,
            "pictures": [
                (name, caption + meanings.get(name, ""), wide, view) for name, caption, wide, view in PICTURES
            ],
            "cards": [_card(item, verdict, self.catalogue) for item in verdict.ranking],
            "sections": self.sections,
            "step": self.step,
            "served": served,
            "content": self._content(served),
        }

    @property
    def title(self) -> str:
        """Title of the page."""
        return f"Diagnosis of the {self.result.base.fit.structure.base.name} model"

    def _content(self, served: bool) -> dict[str, Any]:
        """Return the data for the page's script by key: models with errors, and sentences."""
        verdict, experiment, separation = self.result, self.result.experiment, self.evidence.separation
        floor = experiment.floor
        located = {model_key(()): self.base_reports, model_key(verdict.selected): self.evidence.remaining}
        tied = [] if separation is None else [verdict.model, *verdict.tied_with]
        return {
            "unit": experiment.output_unit,
            "test_data": experiment.test_data,
            "noise_rms": None if floor is None else floor.rms,
            "window_s": _INITIAL_WINDOW_S if floor is None else floor.period,
            "base": model_name(verdict.base.fit),
            "selected": list(verdict.selected),
            "served": served,
            "trained": [record.name for record in self.records if record.is_training],
            "pictures": [name for name, *_ in PICTURES],
            "excitations": {model_key(item.effects): excitation_facts(separation, verdict) for item in tied},
            "models": {model.key: model_facts(model, located.get(model.key, [])) for model in self.models},
        }

    def to_html(self) -> str:
        """Return the page as one self-contained file: the same bytes for the same diagnosis."""
        return one_file(embed_pictures(self.fill), PAGE, self.variables())


def model_facts(model: PageModel, located: Sequence[ResidualReport]) -> dict[str, Any]:
    """Return a model and its locations as data for the page's script."""
    return {
        "label": model.label,
        "group": model.group,
        "effects": list(model.effects),
        "train_rms": model.train_rms,
        "test_rms": model.test_rms,
        "merits": model.merits,
        "located": {
            item.record.name: {
                "headline": item.location.headline,
                "views": {name: view.sentence for name, view in item.location.views.items()},
            }
            for item in located
        },
    }


def excitation_facts(separation: Separation, verdict: DiagnosisResult) -> dict[str, str]:
    """Return an excitation as data for the page's script: sentence, and file for the testing machine."""
    return {
        "text": separation_sentence(separation, verdict),
        "name": EXCITATION,
        "file": motion_csv(separation.excitation.motion, verdict.experiment.input_unit),
    }


def confidence_sentences(diagnosis: DiagnosisResult, evidence: Evidence) -> list[str]:
    """Return sentences on chance, on equally good explanations, and on the experiment that would decide between them."""
    lines = ["No effect of the catalogue could be fitted to these records."]
    if diagnosis.ranking:
        best = diagnosis.ranking[0]
        effects, chance = (
            effects_text(diagnosis.selected or best.candidate.effects),
            probability(best.p_value),
        )
        lines = [
            f"Probability of a gain as large as that of {effects} by chance: {chance}."
            if diagnosis.selected
            else f"The best candidate, {effects}, gains no more than chance would ({chance}; {LEVEL:g} is needed) "
            f"or does not lower the error on {diagnosis.experiment.test_data}."
        ]
    if diagnosis.status == Status.TIED:
        others = ", ".join(effects_text(item.effects) for item in diagnosis.tied_with)
        lines.append(f"As good an explanation of these records: {others}.")
    elif diagnosis.selected and sentences.runner_up(diagnosis) is not None:
        second, unit = sentences.runner_up(diagnosis).candidate, diagnosis.experiment.output_unit
        error, other = distinguishing_digits([diagnosis.model.test_rms, second.test_rms], 3)
        lines.append(
            f"The next best, {effects_text(second.effects)}, leaves {other} {unit} instead of {error} {unit} on "
            f"{diagnosis.experiment.test_data}."
        )
    if evidence.separation is not None:
        lines.append(separation_sentence(evidence.separation, diagnosis))
    if diagnosis.experiment.floor is None:
        lines.append("No record repeats: it is unknown how much of the error is noise, or is unexplained.")
    return lines


def _card(item: Ranked, diagnosis: DiagnosisResult, catalogue: dict[str, Effect]) -> dict:
    """Return a ranked candidate as data for the template."""
    candidate, unit = item.candidate, diagnosis.experiment.output_unit
    effects = list(candidate.effects)
    is_tied = any(set(effects) == set(other.effects) for other in diagnosis.tied_with)
    before, after = distinguishing_digits([diagnosis.base.test_rms, candidate.test_rms], 3)
    new = [catalogue[name] for name in effects if name not in diagnosis.selected]
    new = new or [catalogue[name] for name in effects]
    rows = []
    for estimate in item.estimates:
        if estimate.effect:
            value = f"{estimate.value:.4g} {unit_in_print(estimate.unit)}".rstrip()
            known = estimate.low is not None
            interval = f"{estimate.low:.4g} to {estimate.high:.4g}" if known else "not estimated"
            rows.append((readable(estimate.name), value, interval))
    return {
        "key": model_key(effects),
        "title": effects_text(effects).capitalize(),
        "role": candidate_role(item, diagnosis),
        "error": f"Error on {diagnosis.experiment.test_data}: {before} → {after} {unit}; {probability(item.p_value)}.",
        "mechanism": " ".join(f"{effect.mechanism} {effect.sensors}".rstrip() for effect in new),
        "settles": "; ".join(effect.experiment for effect in new) if is_tied else "",
        "effects": effects,
        "forms": [equation(form.latex) for form in candidate.fit.structure.forms],
        "parameters": table(("parameter", "value", "95 % interval"), rows) if rows else "",
        "long": len(rows) > _MAX_UNFOLDED,
    }
