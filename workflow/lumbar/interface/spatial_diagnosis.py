"""What `lumbar.diagnose` returns for records of several axes."""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path

from lumbar.base.files import write_json, write_text
from lumbar.interface.diagnosed import Diagnosis
from lumbar.tables.table import Table
from lumbar.tissue.diagnosis.evidence.evidence import ladder_csv
from lumbar.tissue.diagnosis.selection.refine import refined_document
from lumbar.tissue.diagnosis.selection.verdict import details, headline
from lumbar.tissue.diagnosis.spatial.principal_axes import (
    axes_sentences,
    principal_axes,
    principal_axes_table,
)
from lumbar.tissue.diagnosis.spatial.spatial_diagnosis import in_space
from lumbar.tissue.models.form import Effect


class SpatialDiagnosis(Diagnosis):
    """What a base model is missing on records of several axes, with the evidence."""

    @cached_property
    def candidates(self) -> dict[str, Effect]:
        """The catalogue that was searched, read in space."""
        return in_space(self.settings.candidates, self.records[0].axes)

    @property
    def sentences(self) -> list[str]:
        """The verdict, the tissue's symmetry and axes, then what a reader asks next."""
        axes = axes_sentences(self.verdict.model.fit, self.verdict.experiment)
        return [headline(self.verdict), *axes, *details(self.verdict, self.candidates)]

    @property
    def axes_table(self) -> Table:
        """Principal stiffnesses and viscosities with their axes and intervals."""
        return principal_axes_table(
            principal_axes(self.verdict.model.fit, self.verdict.experiment), self.records[0].axes, self.data
        )

    def save(
        self, folder: str | os.PathLike, pictures: bool = True, effects: Iterable[str] | None = None
    ) -> None:
        """Write ``diagnosis.json``, ``ladder.csv``, ``refined.json`` and the table ``principal_axes``."""
        folder = Path(folder)
        write_json(folder / "diagnosis.json", {**self.verdict.to_json(), "data": self.data})
        write_text(folder / "ladder.csv", ladder_csv(self.verdict, self.data))
        kept = self.verdict if effects is None else self.with_effects(effects)
        write_json(folder / "refined.json", refined_document(kept.path, kept.experiment, self.data))
        self.axes_table.write(folder / "principal_axes")
