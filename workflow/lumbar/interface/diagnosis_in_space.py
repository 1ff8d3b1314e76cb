"""Result of ``lumbar.diagnose`` for records of several axes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from lumbar.base.files import write_csv, write_json
from lumbar.interface.diagnosis import Diagnosis
from lumbar.tables.table import Table
from lumbar.tissue.diagnosis.evidence.evidence import Evidence, ladder_frame, signal_angles
from lumbar.tissue.diagnosis.residuals.locate import axis_reports
from lumbar.tissue.diagnosis.selection.sentences import details
from lumbar.tissue.diagnosis.selection.thresholds import null_distribution, number_of_forms
from lumbar.tissue.diagnosis.spatial import principal_axes
from lumbar.tissue.diagnosis.spatial.spatial_diagnosis import effects_in_space, usable_in_space
from lumbar.tissue.diagnosis.spatial.spatial_findings import headline_in_space
from lumbar.tissue.diagnosis.spatial.spatial_reports import SpatialReport, spatial_reports
from lumbar.tissue.models.form import Effect

if TYPE_CHECKING:
    from markupsafe import Markup


class SpatialDiagnosis(Diagnosis):
    """Missing effects of a base model on records of several axes."""

    @cached_property
    def candidates(self) -> dict[str, Effect]:
        """Catalogue of effects that was searched, in vector form."""
        return effects_in_space(self.settings.candidates, self.records[0].axes)

    @property
    def headline(self) -> str:
        """Result of the diagnosis in one sentence."""
        return headline_in_space(self.result)

    @property
    def sentences(self) -> list[str]:
        """Sentences of the report: the result, the tissue's symmetry and axes, then the details."""
        fit, experiment = self.result.model.fit, self.result.experiment
        axes = [] if self.result.orientation else principal_axes.axes_sentences(fit, experiment)
        return [self.headline, *axes, *details(self.result, self.candidates)]

    @property
    def axes_table(self) -> Table:
        """Table of principal stiffnesses and viscosities with their axes and intervals."""
        rows = principal_axes.principal_axes(self.result.model.fit, self.result.experiment)
        return principal_axes.principal_axes_table(rows, self.records[0].axes, self.source_label)

    @cached_property
    def reports(self) -> list[SpatialReport]:
        """Comparison of the base model with every record, and locations of its error."""
        return spatial_reports(self.models[0], self.result.experiment, self.study.seed)

    @cached_property
    def evidence(self) -> Evidence:
        """Evidence: remaining errors along every axis, and candidates that add similar forces."""
        experiment, null = self.result.experiment, null_distribution()
        usable = usable_in_space(self.settings.searched, experiment)
        remaining = axis_reports(spatial_reports(self.model, experiment, self.study.seed))
        threshold = null.threshold(number_of_forms(usable))
        return Evidence(remaining, signal_angles(self.result), None, [], threshold, null, [])

    @property
    def no_page_reason(self) -> str:
        """Reason for the missing interactive page: it shows models of one axis."""
        return "records of several axes: the interactive page shows models of one axis"

    def complete_html(self) -> str:
        """Return the page without script with all its pictures."""
        with TemporaryDirectory() as folder:
            return self.to_html(self._save_pictures(Path(folder)))

    def _sections(self, pictures: Mapping[str, Path]) -> dict[str, list[Markup]]:
        from lumbar.publishing.pages.html import table

        axes = self.axes_table
        rows = [[axes.cell(name, row[name]) for name in axes.first] for row in axes.frame.to_dict("records")]
        section = table([axes.header(name) for name in axes.first], rows)
        return {"Stiffness and viscosity in space": [section], **super()._sections(pictures)}

    def _write_result(self, folder: Path) -> None:
        """Write ``diagnosis.json``, ``ladder.csv`` and the table ``principal_axes``."""
        document = {**self.result.to_json(), "data": self.source_label, "headline": self.headline}
        write_json(folder / "diagnosis.json", document)
        write_csv(folder / "ladder.csv", ladder_frame(self.result, self.source_label))
        self.axes_table.write(folder / "principal_axes")
