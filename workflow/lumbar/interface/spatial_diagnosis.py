"""What `lumbar.diagnose` returns for records of several axes."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory

from lumbar.base.files import write_csv, write_json, write_text
from lumbar.interface.diagnosed import Diagnosis
from lumbar.tables.table import Table
from lumbar.tissue.diagnosis.evidence.evidence import Evidence, ladder_frame, signal_angles
from lumbar.tissue.diagnosis.residuals.locate import axis_reports
from lumbar.tissue.diagnosis.selection.refine import refined_document
from lumbar.tissue.diagnosis.selection.sentences import details
from lumbar.tissue.diagnosis.selection.thresholds import null_distribution, number_of_forms
from lumbar.tissue.diagnosis.spatial.principal_axes import (
    axes_sentences,
    principal_axes,
    principal_axes_table,
)
from lumbar.tissue.diagnosis.spatial.spatial_diagnosis import effects_in_space, usable_in_space
from lumbar.tissue.diagnosis.spatial.spatial_findings import headline_in_space
from lumbar.tissue.diagnosis.spatial.spatial_reports import SpatialReport, spatial_reports
from lumbar.tissue.models.form import Effect


class SpatialDiagnosis(Diagnosis):
    """Result of `lumbar.diagnose` for records of several axes."""

    @cached_property
    def candidates(self) -> dict[str, Effect]:
        """The catalogue that was searched, read in space."""
        return effects_in_space(self.settings.candidates, self.records[0].axes)

    @property
    def headline(self) -> str:
        """The result in one sentence."""
        return headline_in_space(self.result)

    @property
    def sentences(self) -> list[str]:
        """The result, the tissue's symmetry and axes, then what a reader asks next."""
        fit, experiment = self.result.model.fit, self.result.experiment
        axes = [] if self.result.orientation else axes_sentences(fit, experiment)
        return [self.headline, *axes, *details(self.result, self.candidates)]

    @property
    def axes_table(self) -> Table:
        """Principal stiffnesses and viscosities with their axes and intervals."""
        return principal_axes_table(
            principal_axes(self.result.model.fit, self.result.experiment),
            self.records[0].axes,
            self.source_label,
        )

    @cached_property
    def reports(self) -> list[SpatialReport]:
        """Comparison of the base model with every record, and where it fails."""
        return spatial_reports(self.models[0], self.result.experiment, self.study.seed)

    @cached_property
    def evidence(self) -> Evidence:
        """Remaining errors along every axis, and candidates that add similar forces."""
        experiment, null = self.result.experiment, null_distribution()
        usable = usable_in_space(self.settings.searched, self.records[0].axes, experiment)
        remaining = axis_reports(spatial_reports(self.model, experiment, self.study.seed))
        threshold = null.threshold(number_of_forms(usable))
        return Evidence(remaining, signal_angles(self.result), None, [], threshold, null, [])

    @property
    def without_page(self) -> str:
        """Reason why there is no interactive page: it shows models of one axis only."""
        return "records of several axes: one can look around in models of one axis"

    def written(self) -> str:
        """Return the page that `save` writes, with its pictures."""
        with TemporaryDirectory() as folder:
            return self.to_html(self._save_pictures(Path(folder)))

    def to_html(self, pictures: Mapping[str, Path] | None = None) -> str:
        """Return the diagnosis as a page without script, for notebooks and mail."""
        from lumbar.publishing.pages.diagnosis_page import diagnosis_page
        from lumbar.publishing.pages.html import table

        axes = self.axes_table
        rows = [[axes.cell(name, row[name]) for name in axes.first] for row in axes.frame.to_dict("records")]
        sections = {
            "Stiffness and viscosity in space": [table([axes.header(name) for name in axes.first], rows)],
        }
        given = self.result, self.evidence, self.candidates, self.source_label
        return diagnosis_page(*given, dict(pictures or {}), sections, self.headline)

    def save(
        self, folder: str | os.PathLike, pictures: bool = True, effects: Iterable[str] | None = None
    ) -> None:
        """Write ``diagnosis.json``, ``ladder.csv``, ``refined.json``, ``diagnosis.html`` and the table ``principal_axes``.

        With `pictures` those of comparison, location and ladder too, and the tables ``compare`` and ``location``.
        """
        folder = Path(folder)
        told = {**self.result.to_json(), "data": self.source_label, "headline": self.headline}
        write_json(folder / "diagnosis.json", told)
        write_csv(folder / "ladder.csv", ladder_frame(self.result, self.source_label))
        kept = self.result if effects is None else self.with_effects(effects)
        write_json(folder / "refined.json", refined_document(kept.path, kept.experiment, self.source_label))
        self.axes_table.write(folder / "principal_axes")
        drawn = self._save_pictures(folder) if pictures else {}
        write_text(folder / "diagnosis.html", self.to_html(drawn))
