"""What `lumbar.diagnose` and ``lumbar.propose`` return: a result with its evidence and page, a proposed law."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import InputError
from lumbar.base.files import write_json, write_text
from lumbar.publishing.explorer.shown import candidates_of, model_key
from lumbar.records.record import Record, require_one_axis
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.tissue import TissueSettings
from lumbar.tissue.diagnosis.evidence.discrimination import separation_sentence
from lumbar.tissue.diagnosis.evidence.evidence import Evidence, gather_evidence, write_diagnosis
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.residuals.compare import comparison_table
from lumbar.tissue.diagnosis.residuals.locate import (
    ResidualReport,
    axis_reports,
    compare_and_locate,
    location_table,
)
from lumbar.tissue.diagnosis.selection.refine import fitted_model, refined_document
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult, Status
from lumbar.tissue.diagnosis.selection.sentences import details, explain, headline
from lumbar.tissue.effects.catalogue import check_name
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.form import Effect

if TYPE_CHECKING:
    from lumbar.interface.refinement import Refinement
    from lumbar.publishing.explorer.explorer_page import ExplorerPage
    from lumbar.tissue.diagnosis.law.proposal import Proposal
    from lumbar.tissue.diagnosis.spatial.spatial_reports import SpatialReport

STATIC = "points of a static test, without a clock"
FORWARD = "records with the force as input (improvement.forward): no law is looked for in them"


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis:
    """Result of `lumbar.diagnose`: what a base model is missing on a set of records, with the evidence."""

    records: list[Record]
    settings: DiagnosisSettings
    """Settings of the diagnosis."""
    result: DiagnosisResult
    """Selected effects, selection path, ranking, ties."""
    study: StudySettings
    """All settings: of the machine, the thesis's models and the intervals too."""
    source_label: str

    @property
    def selected(self) -> tuple[str, ...]:
        """Names of the missing effects, in the order in which they were added."""
        return self.result.selected

    @property
    def status(self) -> Status:
        """Whether the base model lacks something, and what: adequate, named, tied or unexplained."""
        return self.result.status

    @property
    def proposal(self) -> Proposal | None:
        """The search of a law for what the catalogue leaves; None if none was made."""
        return self.result.proposal

    @property
    def candidates(self) -> dict[str, Effect]:
        """The catalogue that was searched."""
        return self.settings.candidates

    @cached_property
    def models(self) -> list[FittedModel]:
        """Base, base and first effect, …."""
        return [fitted_model(item, self.result.experiment) for item in self.result.path]

    @property
    def model(self) -> FittedModel:
        """The base with all selected effects."""
        return self.models[-1]

    @cached_property
    def evidence(self) -> Evidence:
        """Ties, the experiment that settles them, what these records would have shown, what remains."""
        return gather_evidence(self.result, self.settings, self.study.seed, self.study.signals.machine)

    @cached_property
    def reports(self) -> Sequence[ResidualReport | SpatialReport]:
        """Comparison of the base model with every record, and where it fails."""
        return compare_and_locate(self.result.experiment, self.result.base.fit, self.study.seed)

    @property
    def base_on_records(self) -> list[ResidualReport]:
        """`reports` along every axis."""
        return axis_reports(self.reports)

    @property
    def headline(self) -> str:
        """The result in one sentence."""
        return headline(self.result)

    @property
    def sentences(self) -> list[str]:
        """The result, then what a reader asks next."""
        lines = [self.headline, *details(self.result, self.candidates)]
        if self.evidence.separation is not None:
            lines.append(separation_sentence(self.evidence.separation, self.result))
        return lines

    def explain(self) -> list[str]:
        """Return one line per step of the diagnosis: what it did or found, and which step decided the status."""
        return explain(self.result)

    def add(self, *effects: str) -> Refinement:
        """Refit the base with the selected effects and these; effects that are there already are not added twice."""
        wanted = list(dict.fromkeys([*self.selected, *effects]))
        return self.refit(wanted)

    def refit(self, effects: Iterable[str]) -> Refinement:
        """Fit the base with these effects and no others; arguments and errors of `lumbar.refine`."""
        from lumbar.interface.refinement import fit_effects

        return fit_effects(self.records, list(effects), self.settings, self.study.seed, self.source_label)

    def with_effects(self, effects: Iterable[str]) -> Refinement:
        """Return the base with these effects as the page of the diagnosis shows it.

        Models that the search fitted are taken from it, in whatever order their effects were added there; others are
        fitted now, as by `refit`.
        """
        from lumbar.interface.refinement import Refinement

        effects = list(effects)
        known = {model_key(item.effects): item for item in candidates_of(self.result)}
        if model_key(effects) not in known:
            return self.refit(effects)
        steps = [model_key(effects[:number]) for number in range(len(effects) + 1)]
        path = [known[step] for step in steps if step in known]
        seed = self.study.seed
        return Refinement(self.records, self.settings, self.result.experiment, path, seed, self.source_label)

    def propose(self) -> ProposedLaw:
        """Look for a short formula for what the catalogue leaves.

        Raises
        ------
        InputError
            For a pendulum: the library of terms is that of tissue. For records with the force as input, or of several axes.
        """
        if self.settings.system != "tissue":
            raise InputError(
                f"base {self.settings.base}: laws are proposed for tissue; a person's moment is no passive force"
            )
        require_one_axis(self.records, "propose")
        if self.settings.forward:
            raise InputError(FORWARD)
        result = self.result
        if result.experiment.points:
            raise InputError(
                f"{STATIC}: laws are proposed for motions; lumbar diagnose fits the catalogue's static laws"
            )
        from lumbar.tissue.diagnosis.law.proposal import propose

        proposal = self.proposal or propose(result.experiment, result.base, result.model)
        return ProposedLaw(proposal, self.candidates, self.source_label)

    def to_html(self, pictures: Mapping[str, Path] | None = None) -> str:
        """Return the diagnosis as a page without script, for notebooks and mail."""
        from lumbar.publishing.pages.diagnosis_page import diagnosis_page

        return diagnosis_page(
            self.result, self.evidence, self.candidates, self.source_label, dict(pictures or {})
        )

    @cached_property
    def thesis_models(self) -> ThesisModels:
        """The thesis's models, ridge ARX and output error, of the same records; none if the force is the input."""
        return ThesisModels() if self.settings.forward else thesis_models(self.result, self.study.tissue)

    @property
    def without_page(self) -> str:
        """Reason why there is no interactive page; empty if there is one."""
        return f"{STATIC}: there is no motion to look around in" if self.result.experiment.points else ""

    def page(self, pictures: Mapping[str, Path] | None = None, thesis: bool = True) -> ExplorerPage:
        """Return the interactive page: every fitted model with every record.

        Parameters
        ----------
        pictures : mapping of str to path, optional
            SVG files by caption, shown with the evidence.
        thesis : bool
            Whether to add the thesis's models; identifying them takes a few seconds.
        """
        if self.without_page:
            raise InputError(f"{self.without_page}; save and to_html show what was found")
        from lumbar.publishing.explorer.explorer_page import ExplorerPage
        from lumbar.publishing.pages.diagnosis_page import evidence_sections

        beside = self.thesis_models if thesis else NOT_IDENTIFIED
        linear = self.result.linear
        own = [] if linear is None else [fitted_model(linear, self.result.experiment)]
        return ExplorerPage(
            self.result,
            self.evidence,
            self.candidates,
            self.base_on_records,
            self.source_label,
            evidence_sections(self.result, self.evidence, self.candidates, dict(pictures or {})),
            [*own, *beside.models],
            beside.remark,
        )

    def save(
        self, folder: str | os.PathLike, pictures: bool = True, effects: Iterable[str] | None = None
    ) -> None:
        """Write ``diagnosis.json``, ``ladder.csv``, ``refined.json``, ``diagnosis.html`` and a proposed law's file.

        Parameters
        ----------
        folder : path
        pictures : bool
            Draw comparison, location, ladder and signatures too, write the tables ``compare`` and ``location``, and show the
            thesis's models on the page; takes a few seconds more.
        effects : iterable of str, optional
            Effects of the model in ``refined.json``; default those that were selected.
        """
        folder = Path(folder)
        write_diagnosis(self.result, lambda: self.evidence, folder, self.source_label)
        kept = self.result if effects is None else self.with_effects(effects)
        linear = [] if self.result.linear is None else [self.result.linear]
        document = refined_document([*linear, *kept.path], kept.experiment, self.source_label)
        write_json(folder / "refined.json", document)
        # A file that an earlier diagnosis left is removed.
        path = folder / "proposed_law.yaml"
        law = self.propose() if self.proposal is not None else None
        if law is not None and law.found:
            law.save(path, path.stem)
        else:
            path.unlink(missing_ok=True)
        if self.result.experiment.points:
            write_text(folder / "diagnosis.html", self.to_html())
            return
        drawn = self._save_pictures(folder) if pictures else {}
        write_text(folder / "diagnosis.html", self.page(drawn, thesis=pictures).to_html())

    def written(self) -> str:
        """Return the page that `save` writes if there is no interactive one."""
        return self.to_html()

    def _save_pictures(self, folder: Path) -> dict[str, Path]:
        from lumbar.publishing.pages.diagnosis_pictures import draw_pictures

        simulated = self.base_on_records
        comparison_table([item.comparison for item in simulated], self.source_label).write(folder / "compare")
        location_table(self.reports, self.source_label).write(folder / "location")
        given = (self.result, self.reports, self.settings.candidates, folder, self.source_label)
        return draw_pictures(*given, self.proposal)

    def __str__(self) -> str:
        return "\n  ".join(self.sentences)

    def __repr__(self) -> str:
        base = self.result.base.fit.structure.base.name
        return f"<Diagnosis of {base} on {len(self.records)} records: {self.result.status}>"

    def _repr_html_(self) -> str:
        return self.to_html()


@dataclass(frozen=True, eq=False, repr=False)
class ProposedLaw:
    """A law for what is missing, or that no short formula was found."""

    proposal: Proposal
    candidates: dict[str, Effect]
    """The catalogue that did not suffice, whose names the law cannot take."""
    source_label: str
    """Source of the records, for the file and the picture."""

    @property
    def found(self) -> bool:
        """Whether a law is proposed."""
        return self.proposal.law is not None

    @property
    def equation(self) -> str:
        """The law as an expression; empty where none is proposed."""
        return self.proposal.form.equation if self.found else ""

    def to_yaml(self, name: str = "proposed_law") -> str:
        """Return the effect's file.

        Raises
        ------
        InputError
            If no law is proposed, or the name cannot be an effect's.
        """
        if not self.found:
            raise InputError(f"no effect to write: {self.sentences[0]}")
        check_name(name, self.candidates)
        from lumbar.tissue.diagnosis.law.proposal import effect_text

        return effect_text(self.proposal, name, self.source_label)

    def save(self, path: str | os.PathLike, name: str = "proposed_law") -> None:
        """Write the effect's file, for ``improvement: effect_files``; errors of `to_yaml`."""
        write_text(path, self.to_yaml(name))

    def draw(self, stem: str | os.PathLike) -> None:
        """Write the picture of what is missing, ``stem.svg`` and ``stem.pdf``.

        Raises
        ------
        InputError
            If nothing is missing.
        """
        from lumbar.publishing.figures.law_figure import law_figure
        from lumbar.publishing.figures.style import save

        if not self.proposal.is_needed:
            raise InputError(f"nothing to draw: {self.sentences[0]}")
        save(law_figure(self.proposal), Path(stem), self.source_label)

    @property
    def sentences(self) -> list[str]:
        """The proposal, in plain English."""
        return self.proposal.sentences

    def __str__(self) -> str:
        return "\n  ".join(self.sentences)

    def __repr__(self) -> str:
        return f"<ProposedLaw: {self.equation or 'no formula'}>"


@dataclass(frozen=True)
class ThesisModels:
    """Models that can be simulated, and what is to be said of the others."""

    models: list[FittedModel] = field(default_factory=list)
    remark: str = ""
    """Missing models and the reasons; empty if none is missing, or the thesis has none."""


NOT_IDENTIFIED = ThesisModels(
    remark='The thesis\'s models were not identified for this page: "lumbar diagnose --pictures" and "lumbar explore" do so.'
)


def thesis_models(result: DiagnosisResult, settings: TissueSettings) -> ThesisModels:
    """Identify the thesis's models on the longest record that the diagnosis was trained on; there are none of a pendulum."""
    if result.base.fit.structure.base.system != "tissue":
        return ThesisModels()
    experiment = result.experiment
    names = [item.name for item in getattr(experiment.training, "parts", (experiment.training,))]
    training = max((record for record in experiment.records if record.name in names), key=len)
    tests = [record for record in experiment.records if record is not training]
    from lumbar.tissue.identification.identify_tissue import identify_quickly

    try:
        found = identify_quickly(training, tests, settings)
    except InputError as error:
        return ThesisModels(remark=f"The thesis's models could not be identified on these records: {error}")
    unstable = [f"{model.name} ({model.estimator})" for model in found if not model.stable]
    remark = f"Unstable, and without a free run: {', '.join(unstable)}." if unstable else ""
    return ThesisModels([model for model in found if model.stable], remark)
