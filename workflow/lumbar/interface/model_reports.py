"""Results of ``lumbar.compare`` and ``lumbar.locate``: a model simulated on every record."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.errors import InputError
from lumbar.base.files import write_text
from lumbar.interface.result import Result
from lumbar.tables.table import Table
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.residuals import locate as residuals
from lumbar.tissue.diagnosis.residuals.compare import comparison_table
from lumbar.tissue.effects.catalogue import CATALOGUES, MOTION_SENSOR
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.structure import ForwardStructure, Structure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lumbar.tissue.diagnosis.spatial.spatial_reports import SpatialReport

Reports = Sequence["residuals.ResidualReport | SpatialReport"]
"""Comparison and location of a model's error on every record."""


@dataclass(frozen=True, eq=False, repr=False)
class ModelReports(Result):
    """A model simulated on every record."""

    model: FittedModel
    reports: Reports
    """Report on each record."""
    source_label: str
    findings: tuple[Finding, ...] = ()
    """Remarks on records that were too long or too fast, with the parts that were used."""

    @cached_property
    def simulated(self) -> list[residuals.ResidualReport]:
        """Reports along every axis; if there are several axes, the record's name ends with the axis."""
        return residuals.axis_reports(self.reports)

    def __len__(self) -> int:
        return len(self.simulated)

    def __iter__(self) -> Iterator[residuals.ResidualReport]:
        return iter(self.simulated)

    def __getitem__(self, name: str) -> Any:
        """Return the report of a record, or of one axis of a record, by name, e.g. ``"multisine (x)"``."""
        reports = {item.record.name: item for item in residuals.expand_axes(self.reports)}
        if name not in reports:
            raise InputError(f"no record {name!r}; there are {', '.join(reports)}")
        return reports[name]

    def _report(self, name: str) -> Any:
        """Return the report of a record; `name` may be empty if there is only one record."""
        return self[self.reports[0].record.name if not name and len(self.reports) == 1 else name]

    def save(self, folder: str | os.PathLike) -> None:
        """Write the `files` and a page that shows them, ``compare_page.html`` or ``location_page.html``.

        Parameters
        ----------
        folder : path
            Folder; it is made if it is missing.
        """
        super().save(folder)
        name, page = self._page(Path(folder))
        write_text(Path(folder) / f"{name}_page.html", page)

    @abstractmethod
    def _page(self, folder: Path) -> tuple[str, str]:
        """Return name and content of the page, which shows the pictures in `folder`."""

    def __repr__(self) -> str:
        axes = self.reports[0].record.axes
        records = f"{len(self.reports)} records{f' of {len(axes)} axes' if axes else ''}"
        return f"<{type(self).__name__} of {self.model.name} on {records}>"


class Comparisons(ModelReports):
    """Agreement of a model with every record."""

    @property
    def table(self) -> Table:
        """Table with error, noise and explainable error of every record."""
        return comparison_table([item.comparison for item in self.simulated], self.source_label)

    def figure(self, name: str = "") -> Figure:
        """Return the picture of one record: its measured and simulated output.

        Parameters
        ----------
        name : str
            Name of the record; a single record needs none.
        """
        report = self._report(name)
        if report.record.axes:
            from lumbar.publishing.figures.location_figures import spatial_comparison_figure

            return spatial_comparison_figure(report, self.model.name)
        from lumbar.publishing.figures.comparison_figures import record_comparison_figure

        comparisons = [item.comparison for item in self.simulated]
        return record_comparison_figure(report.record, report.values, comparisons, self.model.name)

    def files(self) -> Iterator[tuple[str, Any]]:
        """Yield the table ``compare`` and a picture per record."""
        yield "compare", self.table
        for report in self.reports:
            yield f"comparison_{report.record.name}", self.figure(report.record.name)

    def _page(self, folder: Path) -> tuple[str, str]:
        from lumbar.publishing.pages.html import comparison_page

        names = [report.record.name for report in self.reports]
        pictures = {name: folder / f"comparison_{name}.svg" for name in names}
        return "compare", comparison_page(self.reports, self.model.name, self.source_label, pictures)

    def __str__(self) -> str:
        lines = [item.comparison.sentence for item in self.simulated]
        remarks = [line for item in self.reports for line in item.remarks]
        return "\n".join([*lines, *remarks, *(item.sentence for item in self.findings)])


class Locations(ModelReports):
    """Locations of a model's error on every record."""

    @property
    def candidate_effects(self) -> list[str]:
        """Names of the effects that leave such an error, of the largest cause first; empty if the error is noise."""
        if not residuals.is_located(self.reports):
            return []
        structure, causes = self.model.structure, self.simulated[0].location.causes
        known = set(CATALOGUES["tissue"])
        if isinstance(structure, Structure):
            known = set(CATALOGUES[structure.base.system]).difference(structure.effects)
        if isinstance(structure, ForwardStructure):
            known |= set(MOTION_SENSOR).difference(structure.effects)
        names = dict.fromkeys(name for cause in causes if cause.is_notable for name in cause.effects)
        return [name for name in names if name in known]

    @property
    def table(self) -> Table:
        """Table with share and p-value of every view of the error."""
        return residuals.location_table(self.reports, self.source_label)

    def figure(self, name: str = "") -> Figure:
        """Return the picture of the error on one record, or along one of its axes.

        Parameters
        ----------
        name : str
            Name of the record; a single record needs none.
        """
        from lumbar.publishing.figures.location_figures import location_figure, spatial_location_figure

        report = self._report(name)
        return spatial_location_figure(report) if report.record.axes else location_figure(report.location)

    @property
    def _pictures(self) -> dict[str, str]:
        """Files of the pictures by name of the record, with the axis if it has several."""
        files = {report.record.name: f"location_{report.record.name}" for report in self.reports}
        for report in self.reports:
            for axis in report.axes if report.record.axes else ():
                # A file is location_multisine_x, the axis of a record "multisine (x)".
                files[axis.record.name] = "_".join(["location", *axis.record.name[:-1].rsplit(" (", 1)])
        return files

    def files(self) -> Iterator[tuple[str, Any]]:
        """Yield the table ``location`` and a picture per record and axis."""
        yield "location", self.table
        for name, file in self._pictures.items():
            yield file, self.figure(name)

    def _page(self, folder: Path) -> tuple[str, str]:
        from lumbar.publishing.pages.html import location_page

        pictures = {name: folder / f"{file}.svg" for name, file in self._pictures.items()}
        return "location", location_page(self.reports, self.model.name, self.source_label, pictures)

    def __str__(self) -> str:
        lines = [residuals.all_reports_sentence(self.reports)]
        for item in self.reports:
            axes = [axis.location.headline for axis in item.axes if axis is not item]
            lines.append("\n  ".join([*item.sentences, *axes]))
        return "\n".join([*lines, *(item.sentence for item in self.findings)])
