"""Interactive page of a diagnosis: it starts at the base model, and every effect that the search tried can be added."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from bokeh.document import Document
from bokeh.models import CustomJS
from markupsafe import Markup

from lumbar.base.formats import percent
from lumbar.publishing.explorer.explorer_pictures import ANSWER, MODEL, OTHER, page_models
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
from lumbar.publishing.figures.style import MODELS, SERIES
from lumbar.publishing.pages.diagnosis_page import parameter_tables, verdict_chip
from lumbar.publishing.pages.html import paragraph
from lumbar.tissue.diagnosis.evidence.discrimination import Separation, motion_csv, separation_sentence
from lumbar.tissue.diagnosis.evidence.evidence import EXCITATION, Evidence
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates
from lumbar.tissue.diagnosis.residuals.candidate_causes import CAUSE_EFFECTS
from lumbar.tissue.diagnosis.residuals.locate import Location
from lumbar.tissue.diagnosis.residuals.residual import probability
from lumbar.tissue.diagnosis.selection import sentences
from lumbar.tissue.diagnosis.selection.candidate import Candidate, is_adequate, leaves_noise, likelihood_ratio
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisResult, Status
from lumbar.tissue.diagnosis.selection.sentences import effects_text
from lumbar.tissue.diagnosis.selection.thresholds import number_of_forms
from lumbar.tissue.effects.catalogue import CHANNELS
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.structure import ForwardStructure

PAGE = "publishing/explorer/explorer.html.jinja"
PICTURES = (
    ("course", "Measured and simulated over time", "time"),
    ("residual", "Measured less simulated over time; grey: ± the noise's RMS", "candidate causes"),
    ("loop", "Output over input in the time that is shown: loops", ""),
    ("plane", "Error of the model in the motion", "position and velocity"),
    ("depth", "Mean error over depth; ▲ advancing, ▼ retracting", ""),
    ("turns", "Mean error around reversals, along the motion after them", "reversals"),
    ("spectrum", "Spectrum of the error; grey: noise", "frequency"),
)
"""Pictures: name, caption, and the view of `locate` in the picture."""
LINES = {"circle": "● excited", "square": "■ even", "triangle": "▲ odd ones that were left out"}
"""Meaning of the spectrum's lines by marker."""
FOLDS = (
    *("How likely is a false alarm?", "Can it be distinguished from the others?"),
    *("What these records cannot decide", "All candidates"),
)
"""Titles of sections of the evidence that have a place of their own on the page."""
_PLACES = {
    "time": "over time",
    "position and velocity": "over position and velocity",
    "depth": "over depth",
    "reversals": "around reversals",
    "linear dynamics": "as linear dynamics",
}
"""Places of the error that the page names, by the cause of `rank_causes`."""
_MIN_SHARE, _LISTED_PLACES = 0.05, 3
"""Smallest share of the error, and largest number, of the places that the page names."""


@dataclass(frozen=True, eq=False)
class ExplorerPage:
    """Interactive page of a diagnosis."""

    result: DiagnosisResult
    evidence: Evidence
    catalogue: dict[str, Effect]
    source_label: str
    """Origin of the data."""
    sections: Mapping[str, Sequence[Markup]] = field(default_factory=dict)
    """Further evidence by title, shown in folded sections."""
    others: Sequence[FittedModel] = ()
    """Models of the thesis, shown after the models of the diagnosis."""
    others_remark: str = ""
    """Remark on models of the thesis that are not shown."""
    max_values: int = 300_000
    """Largest number of drawn values in a page, of 2 to 4 bytes each: long records are thinned."""

    @cached_property
    def models(self) -> list[PageModel]:
        """All fitted models: the base first, the thesis's models last."""
        fitted = [self.simulate(candidate) for candidate in fitted_candidates(self.result)]
        experiment = self.result.experiment
        return [*fitted, *(simulate_thesis_model(model, experiment, self.records) for model in self.others)]

    def simulate(self, candidate: Candidate) -> PageModel:
        """Return the simulation of a model, from the diagnosis or fitted later, for drawing."""
        return simulate_candidate(candidate, self.result.experiment, self.records)

    @cached_property
    def records(self) -> list[RecordData]:
        """Data of all records for drawing."""
        columns = len(fitted_candidates(self.result)) + len(self.others) + RECORD_COLUMNS
        return gather_records(self.result, self.max_values // columns)

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
        meanings = {"spectrum": f"; the model's lines: {lines}"} if lines else {}
        groups: dict[str, list[PageModel]] = {}
        for model in self.models:
            groups.setdefault(model.group, []).append(model)
        base = self.models[0].merits
        sections = {title: blocks for title, blocks in self.sections.items() if title != "Parameters"}
        return {
            "title": self.title,
            "data": self.source_label,
            "findings": [item.sentence for item in verdict.findings],
            "floor": "" if floor is None else f"{floor.rms:.3g} {verdict.experiment.output_unit}",
            "test_data": verdict.experiment.test_data,
            # Unseen records first, the record with the largest error first.
            "records": sorted(self.records, key=lambda item: (item.is_training, -base[item.name]["rms"])),
            "groups": groups,
            "others_remark": self.others_remark,
            "tied": [(model_key(item.effects), effects_text(item.effects)) for item in verdict.tied_with],
            "pictures": [(name, caption + meanings.get(name, ""), view) for name, caption, view in PICTURES],
            "folds": {title: sections.pop(title, ()) for title in FOLDS},
            "sections": sections,
            "thinned": ", ".join(
                f"one sample in {item.step} of {item.name}" for item in self.records if item.step > 1
            ),
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
        floor, fitted = experiment.floor, fitted_candidates(verdict)
        separated = [] if separation is None else [verdict.model, *verdict.tied_with]
        # The verdict is shown with the selected effects; without any, if nothing is missing or nothing was tried.
        is_shown = verdict.selected or verdict.status == Status.ADEQUATE or len(fitted) == 1
        solved = [verdict.model, *verdict.tied_with] if is_shown else []
        text, tone = verdict_chip(verdict)
        headline, left = sentences.headline(verdict), sentences.remaining_error(verdict)
        base = verdict.base.fit.structure.base
        models = dict(zip((model_key(item.effects) for item in fitted), fitted, strict=True))
        facts = {model.key: self.facts(model, models.get(model.key)) for model in self.models}
        return {
            "unit": experiment.output_unit,
            "noise_rms": None if floor is None else floor.rms,
            "settling_s": {item.name: item.first * item.record.sampling_time for item in self.records},
            "base": base.name,
            "colours": {
                "base": MODELS.get(base.name, {"color": SERIES[0]})["color"],
                "effects": MODEL,
                "other": OTHER,
            },
            "selected": list(verdict.selected),
            "solved": [model_key(item.effects) for item in solved],
            "verdict": {
                "chip": text,
                "tone": tone,
                "sentence": f"{headline} {left}" if verdict.status == Status.NAMED else headline,
            },
            "command": self._command(),
            "served": served,
            "trained": [record.name for record in self.records if record.is_training],
            "excitations": {
                model_key(item.effects): excitation_facts(separation, verdict) for item in separated
            },
            "effects": {} if verdict.orientation else self._effects(),  # no effect repairs exchanged records
            "models": facts,
        }

    def _command(self) -> str:
        """Return the command that fits effects, without the effects."""
        base = self.result.base.fit.structure.base
        command = f"lumbar refine FOLDER --base {'BASE.yaml' if base.is_user_defined else base.name}"
        trained = [record.name for record in self.records if record.is_training]
        if len(self.records) > 1:
            command += "".join(f" --train {name}" for name in trained)
        return command + " --forward" * isinstance(self.result.base.fit.structure, ForwardStructure)

    def _effects(self) -> dict[str, dict[str, str]]:
        """Return mechanism and reason why it was not tried (empty if it was) of every effect, by name."""
        missing = {form.effect: channels for form, channels in self.result.not_tried}
        tried = {name for item in fitted_candidates(self.result) for name in item.effects}
        facts = {}
        for name, effect in self.catalogue.items():
            if effect.rival and name not in tried:
                continue
            reason = ""
            if name in missing and name not in tried:
                reason = f"needs {' and '.join(CHANNELS.get(role, role) for role in missing[name])}"
            facts[name] = {
                "about": f"{effect.mechanism} {effect.sensors}".rstrip(),
                "reason": reason,
            }
        return facts

    def facts(
        self,
        model: PageModel,
        candidate: Candidate | None,
        base: Candidate | None = None,
        experiment: Experiment | None = None,
    ) -> dict[str, Any]:
        """Return a model as data for the page's script; `base` and `experiment` if it was fitted after the diagnosis."""
        facts = {
            **{
                name: getattr(model, name)
                for name in ("label", "group", "train_rms", "test_rms", "merits", "scales")
            },
            "effects": list(model.effects),
        }
        if candidate is None:
            return facts
        ranked = {item.candidate: item.p_value for item in self.result.ranking}
        is_listed = base is not None or candidate in (*self.result.path, *ranked)
        base, experiment = base or self.result.base, experiment or self.result.experiment
        units = experiment.input_unit, experiment.output_unit
        is_noise = experiment.floor is not None and self._is_noise(candidate, experiment)
        text, tone = ("only noise is left", "good") if is_noise else ("something is missing", "warn")
        chance = ""
        if candidate.effects:
            ratio = likelihood_ratio(base, candidate, experiment)
            forms = number_of_forms(self.catalogue) - len(self.result.not_tried)
            p_value = ranked.get(candidate, self.evidence.null.p_value(ratio, forms))
            chance = probability(p_value).removeprefix("p = ").removeprefix("p ")
        return {
            **facts,
            "chip": text if experiment.floor is not None else "noise unknown",
            "tone": tone,
            "sentence": sentences.model_sentence(candidate, base, experiment, is_noise),
            "chance": chance,
            "located": {
                name: location_facts(item, self.catalogue, is_noise, is_listed)
                for name, item in model.located.items()
            },
            "parameters": Markup().join(
                parameter_tables(candidate, estimates(candidate.fit, experiment.training, *units))
            )
            if is_listed
            else paragraph(
                f"{self._command()} --add {' --add '.join(candidate.effects)} --output out writes them."
            ),
        }

    def _is_noise(self, candidate: Candidate, experiment: Experiment) -> bool:
        """Return whether a model leaves no more than noise, as the verdict counts it."""
        if is_adequate(candidate, experiment):
            return True
        return self.result.refined_status == Status.ADEQUATE and leaves_noise(candidate, experiment)

    def to_html(self) -> str:
        """Return the page as one self-contained file: the same bytes for the same diagnosis."""
        return one_file(embed_pictures(self.fill), PAGE, self.variables())


def location_facts(
    location: Location, catalogue: Mapping[str, Effect], is_noise: bool, is_listed: bool
) -> dict[str, Any]:
    """Return where a model fails on a record: the headline, places with their effects, and sentences by view.

    A model that leaves noise has no places, a model that is not listed no sentences.
    """
    is_noise = is_noise or location.is_noise or location.is_near_noise_floor
    places = [
        (name, share) for name, share in location.shares.items() if share >= _MIN_SHARE and not is_noise
    ]
    return {
        "headline": f"{location.size}. Where it appears:" if places else location.headline,
        "places": [
            (f"{_PLACES[name]} {percent(share)}", [item for item in CAUSE_EFFECTS[name] if item in catalogue])
            for name, share in places[:_LISTED_PLACES]
        ],
        "views": {name: view.sentence for name, view in location.views.items()} if is_listed else {},
    }


def excitation_facts(separation: Separation, verdict: DiagnosisResult) -> dict[str, str]:
    """Return an excitation as data for the page's script: sentence, and file for the testing machine."""
    return {
        "text": separation_sentence(separation, verdict),
        "name": EXCITATION,
        "file": motion_csv(separation.excitation.motion, verdict.experiment.input_unit),
    }
