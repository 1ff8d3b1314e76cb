"""The page of a diagnosis as one document: pictures, and words: what is missing, how sure that is, the candidates."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from bokeh.document import Document
from bokeh.models import CustomJS
from markupsafe import Markup

from lumbar.base.yaml_file import shipped_yaml
from lumbar.publishing.explorer.one_file import embedded_pictures, one_file
from lumbar.publishing.explorer.plots import ANSWER, ASIDE, FIRST, SECOND, page_models
from lumbar.publishing.explorer.shown import (
    ShownModel,
    ShownRecord,
    candidates_of,
    drawing_step,
    model_key,
    shown_candidate,
    shown_fitted,
    shown_records,
)
from lumbar.publishing.pages.diagnosis_page import role_of
from lumbar.publishing.pages.html import equation, table
from lumbar.tables.layout import unit_in_print
from lumbar.tissue.diagnosis.evidence.discrimination import Separation, motion_csv, separation_sentence
from lumbar.tissue.diagnosis.evidence.evidence import EXCITATION, Evidence
from lumbar.tissue.diagnosis.residuals.locate import ResidualReport
from lumbar.tissue.diagnosis.residuals.residual import probability
from lumbar.tissue.diagnosis.selection.candidate import Candidate
from lumbar.tissue.diagnosis.selection.refine import model_name
from lumbar.tissue.diagnosis.selection.result import (
    DiagnosisResult,
    Ranked,
    Status,
    distinguishing_digits,
    effects_text,
    headline,
    readable,
    runner_up,
    what_is_left,
)
from lumbar.tissue.diagnosis.selection.thresholds import LEVEL
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.form import Effect

PAGE = "publishing/explorer/explorer.html.jinja"
_SAID = shipped_yaml(Path(__file__).with_suffix(".yaml"))
PICTURES: list[tuple[str, str, bool, str]] = _SAID["pictures"]
"""Name, caption, whether it takes the page's whole width, and which of `locate`'s views speaks of it."""
CURVES = (
    ("measured", "measured", "var(--ink)", ""),
    ("first", "first model", FIRST, ""),
    ("second", "second model", SECOND, "dashed"),
    ("aside", "the path set aside", ASIDE, "dashed"),
)
"""Curves that are switched: name, words, colour, line."""
LINES: dict[str, str] = _SAID["lines"]
"""Marks of the spectrum's lines in words."""
_SURE: dict[str, str] = _SAID["sure"]
"""Sentences of `how_sure`."""
_FIRST_SHOWN_S = 10.0
"""Seconds that are shown at first of records that do not repeat; of others a period."""


@dataclass(frozen=True, eq=False)
class ExplorerPage:
    """A diagnosis as a page."""

    result: DiagnosisResult
    evidence: Evidence
    catalogue: dict[str, Effect]
    base_on_records: list[ResidualReport]
    """The base model on every record, for what is told of where it fails."""
    source_label: str
    """Where the data come from."""
    sections: Sequence[tuple[str, Sequence[Markup]]] = ()
    """Further evidence by titles, folded below."""
    others: Sequence[FittedModel] = ()
    """Models that are shown beside those of the diagnosis: the thesis's."""
    others_remark: str = ""
    """What is to be said of those that are not."""

    @cached_property
    def step(self) -> int:
        """Every how manieth sample is drawn."""
        models = len(candidates_of(self.result)) + len(self.others)
        return drawing_step(self.result.experiment.records, models)

    @cached_property
    def models(self) -> list[ShownModel]:
        """Every model that was fitted, the base first, then the thesis's."""
        fitted = [self.shown(candidate) for candidate in candidates_of(self.result)]
        others = [shown_fitted(model, self.result, self.records, self.step) for model in self.others]
        return [*fitted, *others]

    def shown(self, candidate: Candidate) -> ShownModel:
        """One model of the diagnosis, or one that was fitted later, as it is drawn."""
        return shown_candidate(candidate, self.result, self.records, self.step)

    @cached_property
    def records(self) -> list[ShownRecord]:
        """Every record, as it is drawn."""
        return shown_records(self.result, self.step)

    def fill(self, document: Document) -> None:
        """Put pictures and data into a Bokeh document."""
        pictures, held = page_models(self.result.experiment, self.records, self.models)
        answer = next(source for source in held if source.name == ANSWER)
        answer.js_on_change("data", CustomJS(code="window.lumbar.answered(cb_obj.data.content[0])"))
        pictures[0].tags = held  # so that the document has them
        with document.models.freeze():  # or every root would have all models looked through again
            for picture in pictures:
                document.add_root(picture)

    def variables(self, served: bool = False) -> dict[str, Any]:
        """Return what the template shows beside the pictures.

        `served`: a server stands behind the page.
        """
        verdict, experiment = self.result, self.result.experiment
        floor = experiment.floor
        groups: dict[str, list[ShownModel]] = {}
        for model in self.models:
            groups.setdefault(model.group, []).append(model)
        return {
            "title": self.title,
            "data": self.source_label,
            "verdict": verdict.status,
            "headline": headline(verdict),
            "left": what_is_left(verdict) if verdict.selected else "",
            "findings": [item.sentence for item in verdict.findings],
            "sure": how_sure(verdict, self.evidence),
            "floor": "" if floor is None else f"{floor.rms:.3g} {experiment.output_unit}",
            "records": sorted(self.records, key=lambda record: not record.trained),
            "groups": groups,
            "others_remark": self.others_remark,
            "chosen": model_key(verdict.selected),
            "first_colour": FIRST,
            "second_colour": SECOND,
            "curves": CURVES,
            "pictures": self._captioned(),
            "cards": cards(verdict, self.catalogue),
            "sections": self.sections,
            "step": self.step,
            "served": served,
            "content": self._content(served),
        }

    @property
    def title(self) -> str:
        """Title of the page."""
        return f"Diagnosis of the {self.result.base.fit.structure.base.name} model"

    def _captioned(self) -> list[tuple[str, str, bool, str]]:
        """`PICTURES`, with what the marks of the spectrum's lines mean."""
        found = [
            words for mark, words in LINES.items() if any(mark in record.marker for record in self.records)
        ]
        lines = f"; the first model's lines: {', '.join(found)}" if found else ""
        return [
            (name, caption + (lines if name == "spectrum" else ""), wide, view)
            for name, caption, wide, view in PICTURES
        ]

    def _content(self, served: bool) -> dict[str, Any]:
        """What the page's script knows: models with errors, and sentences, by key."""
        verdict, experiment = self.result, self.result.experiment
        floor = experiment.floor
        located = {model_key(()): self.base_on_records, model_key(verdict.selected): self.evidence.remaining}
        return {
            "unit": experiment.output_unit,
            "noise_rms": None if floor is None else floor.rms,
            "window_s": _FIRST_SHOWN_S if floor is None else floor.period,
            "base": model_name(verdict.base.fit),
            "selected": list(verdict.selected),
            "served": served,
            "trained": [record.name for record in self.records if record.trained],
            "pictures": [name for name, *_ in PICTURES],
            "excitations": self._excitations(),
            "models": {model.key: model_facts(model, located.get(model.key, [])) for model in self.models},
        }

    def _excitations(self) -> dict[str, dict[str, str]]:
        """The excitation that settles a tie, by the models it is between."""
        separation = self.evidence.separation
        if separation is None:
            return {}
        tied = [self.result.model, *self.result.tied_with]
        return {model_key(item.effects): excitation_of(separation, self.result) for item in tied}

    def to_html(self) -> str:
        """Return the page as a file that needs nothing else: the same bytes for the same diagnosis."""
        return one_file(embedded_pictures(self.fill), PAGE, self.variables())


def model_facts(model: ShownModel, located: Sequence[ResidualReport]) -> dict[str, Any]:
    """Return what the page's script knows of a model."""
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


def excitation_of(separation: Separation, verdict: DiagnosisResult) -> dict[str, str]:
    """Return what the page's script knows of an excitation: what it tells, and the file to play."""
    return {
        "text": separation_sentence(separation, verdict),
        "name": EXCITATION,
        "file": motion_csv(separation.excitation.motion, verdict.experiment.input_unit),
    }


_MANY = 6
"""Parameters from which on a card folds their table."""


def how_sure(diagnosis: DiagnosisResult, evidence: Evidence) -> list[str]:
    """Sentences on chance, on what explains the records as well, and on what would settle it."""
    lines = [_chance(diagnosis)]
    if diagnosis.status == Status.TIED:
        others = ", ".join(effects_text(item.effects) for item in diagnosis.tied_with)
        lines.append(f"As good an explanation of these records: {others}.")
    elif diagnosis.selected and runner_up(diagnosis) is not None:
        second, unit = runner_up(diagnosis).candidate, diagnosis.experiment.output_unit
        own, other = distinguishing_digits([diagnosis.model.test_rms, second.test_rms], 3)
        lines.append(
            f"The next best, {effects_text(second.effects)}, leaves {other} {unit} on unseen records instead of {own} {unit}."
        )
    if evidence.separation is not None:
        lines.append(separation_sentence(evidence.separation, diagnosis))
    if diagnosis.experiment.floor is None:
        lines.append(_SURE["no_record_repeats"])
    return lines


def _chance(diagnosis: DiagnosisResult) -> str:
    if not diagnosis.ranking:
        return _SURE["nothing_fitted"]
    found = diagnosis.ranking[0]
    effects = effects_text(diagnosis.selected or found.candidate.effects)
    told = _SURE["by_chance" if diagnosis.selected else "no_gain"]
    return told.format(effects=effects, chance=probability(found.p_value), level=LEVEL)


def cards(diagnosis: DiagnosisResult, catalogue: dict[str, Effect]) -> list[dict[str, Any]]:
    """What the template shows of every ranked candidate, the best first."""
    return [_card(item, diagnosis, catalogue) for item in diagnosis.ranking]


def _card(item: Ranked, diagnosis: DiagnosisResult, catalogue: dict[str, Effect]) -> dict:
    candidate = item.candidate
    effects = list(candidate.effects)
    tied = [set(other.effects) for other in diagnosis.tied_with]
    forms = candidate.fit.structure.forms
    unit = diagnosis.experiment.output_unit
    before, after = distinguishing_digits([diagnosis.base.test_rms, candidate.test_rms], 3)
    new = [name for name in effects if name not in diagnosis.selected] or effects
    return {
        "key": model_key(effects),
        "title": effects_text(effects).capitalize(),
        "role": role_of(item, diagnosis),
        "error": f"Error on unseen records: {before} → {after} {unit}; {probability(item.p_value)}.",
        "mechanism": " ".join(
            f"{catalogue[name].mechanism} {catalogue[name].sensors}".rstrip() for name in new
        ),
        "settles": "; ".join(catalogue[name].experiment for name in new) if set(effects) in tied else "",
        "effects": effects,
        "forms": [equation(form.latex) for form in forms],
        "parameters": _parameters(item),
        "long": sum(bool(found.effect) for found in item.estimates) > _MANY,
    }


def _parameters(item: Ranked) -> Markup | str:
    rows = [
        (readable(found.name), f"{found.value:.4g} {unit_in_print(found.unit)}".rstrip(), _interval(found))
        for found in item.estimates
        if found.effect
    ]
    return table(("parameter", "value", "95 % interval"), rows) if rows else ""


def _interval(found) -> str:
    return "not estimated" if found.low is None else f"{found.low:.4g} to {found.high:.4g}"
