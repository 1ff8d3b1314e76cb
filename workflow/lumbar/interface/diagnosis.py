"""Result of ``lumbar.diagnose``: which effect a model is missing, with evidence and page."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import InputError
from lumbar.base.files import write_json, write_text
from lumbar.publishing.explorer.page_data import fitted_candidates, model_key
from lumbar.records.record import Record, require_one_axis
from lumbar.settings.study_settings import StudySettings
from lumbar.tissue.diagnosis.evidence.discrimination import separation_sentence
from lumbar.tissue.diagnosis.evidence.evidence import Evidence, gather_evidence, write_diagnosis
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.residuals import locate
from lumbar.tissue.diagnosis.residuals.compare import comparison_table
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisResult, Status
from lumbar.tissue.diagnosis.selection.refine import fitted_model, refined_document
from lumbar.tissue.diagnosis.selection.sentences import details, explain, headline
from lumbar.tissue.effects.notation import NAME
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.form import Effect

if TYPE_CHECKING:
    from markupsafe import Markup

    from lumbar.interface.refinement import Refinement
    from lumbar.publishing.explorer.explorer_page import ExplorerPage
    from lumbar.tissue.diagnosis.law.proposal import Proposal
    from lumbar.tissue.diagnosis.spatial.spatial_reports import SpatialReport
_STATIC_TEST = "points of a static test, without a clock"


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis:
    """Missing effects of a base model on a set of records, with the evidence."""

    records: list[Record]
    settings: DiagnosisSettings
    """Settings of the diagnosis."""
    result: DiagnosisResult
    """Result of the search: selected effects, selection path, ranking, ties."""
    study: StudySettings
    """All settings of the study, with machine, models of the thesis and intervals."""
    source_label: str

    @property
    def selected(self) -> tuple[str, ...]:
        """Names of the missing effects, in the order in which they were added."""
        return self.result.selected

    @property
    def status(self) -> Status:
        """Verdict: adequate, named, tied or unexplained."""
        return self.result.status

    @property
    def candidates(self) -> dict[str, Effect]:
        """Catalogue of effects that was searched."""
        return self.settings.candidates

    @cached_property
    def models(self) -> list[FittedModel]:
        """Base model, then the base with the first effect, the first two effects, and so on."""
        return [fitted_model(item, self.result.experiment) for item in self.result.path]

    @property
    def model(self) -> FittedModel:
        """Base model with all selected effects."""
        return self.models[-1]

    @cached_property
    def evidence(self) -> Evidence:
        """Evidence: ties, an experiment that separates tied effects, detectable effects, remaining errors."""
        return gather_evidence(self.result, self.settings, self.study.seed, self.study.signals.machine)

    @cached_property
    def reports(self) -> Sequence[locate.ResidualReport | SpatialReport]:
        """Comparison of the base model with every record, and locations of its error."""
        return locate.compare_and_locate(self.result.experiment, self.result.base.fit, self.study.seed)

    @property
    def headline(self) -> str:
        """Result of the diagnosis in one sentence."""
        return headline(self.result)

    @property
    def sentences(self) -> list[str]:
        """Sentences of the report: the result, then the details."""
        lines = [self.headline, *details(self.result, self.candidates)]
        if self.evidence.separation is not None:
            lines.append(separation_sentence(self.evidence.separation, self.result))
        return lines

    def explain(self) -> list[str]:
        """Return one line per step of the diagnosis: its result, and which step decided the status."""
        return explain(self.result)

    def add(self, *effects: str) -> Refinement:
        """Refit the base with the selected effects and additional effects.

        Parameters
        ----------
        *effects : str
            Names of the effects; effects that are already selected are not added twice.
        """
        return self._refit(list(dict.fromkeys([*self.selected, *effects])))

    def refine(self, effects: Iterable[str]) -> Refinement:
        """Return the base with exactly these effects, as the page of the diagnosis shows it.

        Models that the search fitted are reused, for any order of the effects; other models are fitted now.

        Parameters
        ----------
        effects : iterable of str
            Names of the effects, in the order in which they are added.
        """
        effects = list(effects)
        known = {model_key(item.effects): item for item in fitted_candidates(self.result)}
        if model_key(effects) not in known:
            return self._refit(effects)
        steps = [model_key(effects[:number]) for number in range(len(effects) + 1)]
        path = [known[step] for step in steps if step in known]
        seed = self.study.seed
        from lumbar.interface.refinement import Refinement

        return Refinement(self.records, self.settings, self.result.experiment, path, seed, self.source_label)

    def _refit(self, effects: list[str]) -> Refinement:
        from lumbar.interface.refinement import fit_effects

        return fit_effects(self.records, effects, self.settings, self.study.seed, self.source_label)

    def propose(self) -> ProposedLaw:
        """Search for a short formula for the error that the catalogue does not explain.

        Raises
        ------
        InputError
            If the base is a pendulum (all terms are of tissue), or the records have the force as input or several axes.
        """
        if self.settings.system != "tissue":
            raise InputError(
                f"base {self.settings.base}: laws are proposed for tissue; a subject's moment is not a passive force"
            )
        from lumbar.tissue.diagnosis.law.proposal import propose

        require_one_axis(self.records, "propose")
        require_motion_input(self.settings.forward)
        result = self.result
        if result.experiment.points:
            raise InputError(
                f"{_STATIC_TEST}: laws are proposed for motions; lumbar diagnose fits the catalogue's static laws"
            )
        proposal = result.proposal or propose(result.experiment, result.base, result.model)
        return ProposedLaw(proposal, self.candidates, self.source_label)

    def to_html(self, pictures: Mapping[str, Path] | None = None) -> str:
        """Return the diagnosis as an HTML page without script, for notebooks and mail.

        Parameters
        ----------
        pictures : mapping of str to path, optional
            SVG files by caption, shown with the evidence.
        """
        from lumbar.publishing.pages.diagnosis_page import diagnosis_page

        return diagnosis_page(self.result, self.headline, self._sections(pictures or {}), self.source_label)

    def _sections(self, pictures: Mapping[str, Path]) -> dict[str, list[Markup]]:
        from lumbar.publishing.pages.diagnosis_page import evidence_sections

        return evidence_sections(self.result, self.evidence, self.candidates, pictures)

    @cached_property
    def thesis_models(self) -> tuple[list[FittedModel], str]:
        """Models of the thesis (ridge ARX, output error) for the longest training record, and a remark on missing models.

        A pendulum and records with the force as input have none.
        """
        experiment = self.result.experiment
        if self.settings.forward or self.settings.system != "tissue":
            return [], ""
        names = [item.name for item in getattr(experiment.training, "parts", (experiment.training,))]
        training = max((record for record in experiment.records if record.name in names), key=len)
        tests = [record for record in experiment.records if record is not training]
        from lumbar.tissue.identification.identify_tissue import identify

        # Without the bootstrap, which takes most of the time and serves the physical parameters only.
        tissue = self.study.tissue
        bootstrap = tissue.bootstrap.model_copy(update={"resamples": 0})
        try:
            models, _ = identify(training, tests, tissue.model_copy(update={"bootstrap": bootstrap}), seed=0)
        except InputError as error:
            return [], f"The thesis's models could not be identified on these records: {error}"
        unstable = [f"{model.name} ({model.estimator})" for model in models if not model.stable]
        remark = f"Unstable, and without a free run: {', '.join(unstable)}." if unstable else ""
        return [model for model in models if model.stable], remark

    @property
    def no_page_reason(self) -> str:
        """Reason for a missing interactive page; empty if the page exists."""
        return f"{_STATIC_TEST}: an interactive page needs motion" if self.result.experiment.points else ""

    def page(self, pictures: Mapping[str, Path] | None = None, thesis: bool = True) -> ExplorerPage:
        """Return the interactive page: every fitted model with every record.

        Parameters
        ----------
        pictures : mapping of str to path, optional
            SVG files by caption, shown with the evidence.
        thesis : bool
            Whether to add the thesis's models; identifying them takes a few seconds.

        Raises
        ------
        InputError
            If the records are points of a static test, or have several axes.
        """
        if self.no_page_reason:
            raise InputError(f"{self.no_page_reason}; save and to_html show the result")
        from lumbar.publishing.explorer.explorer_page import ExplorerPage

        others, remark = self.thesis_models if thesis else ([], _MISSING_MODELS_REMARK)
        linear = self.result.linear
        return ExplorerPage(
            self.result,
            self.evidence,
            self.candidates,
            self.source_label,
            self._sections(pictures or {}),
            [*([] if linear is None else [fitted_model(linear, self.result.experiment)]), *others],
            remark,
        )

    def save(
        self, folder: str | os.PathLike, pictures: bool = True, effects: Iterable[str] | None = None
    ) -> None:
        """Write ``diagnosis.json``, ``ladder.csv``, ``refined.json``, ``diagnosis.html`` and a proposed law's file.

        Parameters
        ----------
        folder : path
            Folder of the files; it is created if needed.
        pictures : bool
            Also draw comparison, location, ladder and signatures, write the tables ``compare`` and ``location``, and show the
            thesis's models on the page; this takes a few seconds more.
        effects : iterable of str, optional
            Effects of the model in ``refined.json``; default the selected ones.
        """
        folder = Path(folder)
        self._write_result(folder)
        refined = self.result if effects is None else self.refine(effects)
        linear = [] if self.result.linear is None else [self.result.linear]
        document = refined_document([*linear, *refined.path], refined.experiment, self.source_label)
        write_json(folder / "refined.json", document)
        # A law that an earlier diagnosis wrote is removed.
        path = folder / "proposed_law.yaml"
        if self.result.proposal is not None and self.propose().has_law:
            self.propose().save(path, path.stem)
        else:
            path.unlink(missing_ok=True)
        drawn = self._save_pictures(folder) if pictures and not self.result.experiment.points else {}
        page = self.to_html(drawn) if self.no_page_reason else self.page(drawn, thesis=pictures).to_html()
        write_text(folder / "diagnosis.html", page)

    def _write_result(self, folder: Path) -> None:
        write_diagnosis(self.result, lambda: self.evidence, folder, self.source_label)

    def complete_html(self) -> str:
        """Return the page without script with all its pictures."""
        return self.to_html()

    def _save_pictures(self, folder: Path) -> dict[str, Path]:
        from lumbar.publishing.pages.diagnosis_pictures import draw_pictures

        comparisons = [item.comparison for item in locate.axis_reports(self.reports)]
        comparison_table(comparisons, self.source_label).write(folder / "compare")
        locate.location_table(self.reports, self.source_label).write(folder / "location")
        return draw_pictures(self.result, self.reports, self.settings.candidates, folder, self.source_label)

    def __str__(self) -> str:
        return "\n  ".join(self.sentences)

    def __repr__(self) -> str:
        base = self.result.base.fit.structure.base.name
        return f"<Diagnosis of {base} on {len(self.records)} records: {self.result.verdict}>"

    def _repr_html_(self) -> str:
        return self.to_html()


_MISSING_MODELS_REMARK = (
    'The thesis\'s models are not shown: "lumbar diagnose --pictures" and "lumbar explore" identify them.'
)


def require_motion_input(forward: bool) -> None:
    """Raise for records with the force as input.

    Parameters
    ----------
    forward : bool
        ``improvement.forward`` of the settings.

    Raises
    ------
    InputError
        If `forward` is true.
    """
    if forward:
        raise InputError(
            "records with the force as input (improvement.forward): no law is looked for in them"
        )


@dataclass(frozen=True, eq=False, repr=False)
class ProposedLaw:
    """Law for the missing force, or the result that no short formula was found."""

    proposal: Proposal
    candidates: dict[str, Effect]
    """Catalogue of effects that did not suffice; the law must have another name."""
    source_label: str
    """Name of the source of the records, for the file and the picture."""

    @property
    def has_law(self) -> bool:
        """True if a law is proposed."""
        return self.proposal.law is not None

    @property
    def equation(self) -> str:
        """The law as an expression; empty if no law is proposed."""
        return self.proposal.form.equation if self.has_law else ""

    @property
    def sentences(self) -> list[str]:
        """Sentences on the proposal."""
        return self.proposal.sentences

    def to_yaml(self, name: str = "proposed_law") -> str:
        """Return the text of the effect's file.

        Parameters
        ----------
        name : str
            Name of the effect: letters a to z, digits and _, a letter first.

        Raises
        ------
        InputError
            If no law is proposed, or the name is not valid for an effect.
        """
        if not self.has_law:
            raise InputError(f"no effect to write: {self.sentences[0]}")
        if not NAME.fullmatch(name):
            raise InputError(f"effect {name!r}: use letters a to z, digits and _, a letter first")
        if name in self.candidates:
            raise InputError(f"effect {name!r} is taken by an effect of the catalogue; choose another name")
        from lumbar.tissue.diagnosis.law.proposal import effect_text

        return effect_text(self.proposal, name, self.source_label)

    def save(self, path: str | os.PathLike, name: str = "proposed_law") -> None:
        """Write the effect's file, for ``improvement: effect_files``.

        Parameters
        ----------
        path : path
            The file.
        name : str
            Name of the effect.

        Raises
        ------
        InputError
            If `to_yaml` raises it.
        """
        write_text(path, self.to_yaml(name))

    def draw(self, stem: str | os.PathLike) -> None:
        """Write the picture of the missing force, ``stem.svg`` and ``stem.pdf``.

        Parameters
        ----------
        stem : path
            Path of the files without their endings.

        Raises
        ------
        InputError
            If nothing is missing.
        """
        from lumbar.publishing.figures.style import save
        from lumbar.publishing.pages.diagnosis_pictures import law_figure

        if not self.proposal.is_needed:
            raise InputError(f"nothing to draw: {self.sentences[0]}")
        save(law_figure(self.proposal), Path(stem), self.source_label)

    def __str__(self) -> str:
        return "\n  ".join(self.sentences)

    def __repr__(self) -> str:
        return f"<ProposedLaw: {self.equation or 'no formula'}>"
