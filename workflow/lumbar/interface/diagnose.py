"""``lumbar.diagnose`` and ``lumbar.propose``: which effect a model is missing; records of several axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from lumbar.base.files import write_csv, write_json
from lumbar.interface.diagnosis import Diagnosis
from lumbar.interface.proposed_law import ProposedLaw, require_motion_input
from lumbar.interface.result import records_label, settings_or_default
from lumbar.records.record import Record, require_one_axis, use_load_as_input
from lumbar.settings.study_settings import StudySettings
from lumbar.tables.table import Table
from lumbar.tissue.diagnosis.evidence.evidence import Evidence, ladder_frame, signal_angles
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import limit_samples
from lumbar.tissue.diagnosis.residuals.locate import axis_reports
from lumbar.tissue.diagnosis.selection.diagnose import diagnose as search
from lumbar.tissue.diagnosis.selection.sentences import details
from lumbar.tissue.diagnosis.selection.thresholds import null_distribution, number_of_forms
from lumbar.tissue.diagnosis.spatial import principal_axes
from lumbar.tissue.diagnosis.spatial.spatial_diagnosis import effects_in_space, usable_in_space
from lumbar.tissue.diagnosis.spatial.spatial_findings import headline_in_space
from lumbar.tissue.diagnosis.spatial.spatial_reports import SpatialReport, spatial_reports
from lumbar.tissue.models.form import Effect

if TYPE_CHECKING:
    from markupsafe import Markup


def diagnose(
    records: Sequence[Record],
    *,
    base: str | None = None,
    train: str | Sequence[str] | None = None,
    settings: StudySettings | None = None,
    source_label: str = "",
) -> Diagnosis:
    """Find the physical effect that a base model is missing, or that nothing is missing.

    Parameters
    ----------
    records : sequence of Record
        One per excitation, with channels ``input`` and ``output``. The period of an excitation is ``Record.period``, or is
        detected from the input.
    base : str, optional
        Base model: LE, Maxwell, KV, KB, pendulum or a user-defined one, BASE.yaml; default the settings'.
    train : str or sequence of str, optional
        Record to fit on, or several that are fitted together; default the settings', or the longest.
    settings : StudySettings, optional
        As `lumbar.load_settings` returns them. Used are ``improvement`` (user-defined effects, how many to add, whether the
        records were cut from one session or have the force as input), ``signals.machine`` (limits of the machine for a
        separating excitation), ``tissue`` (the thesis's models), ``stability.pendulum.gravity_m_s2`` and ``seed``.
    source_label : str
        Name of the source of the data, for pages and figures; default the folder or file they were read from.

    Returns
    -------
    Diagnosis
        A `SpatialDiagnosis` for records of several axes.

    Raises
    ------
    InputError
        For an unknown base and for records that cannot be used.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_records
    >>> one_effect = lumbar.StudySettings(improvement=lumbar.ImprovementSettings(most_effects=1))
    >>> diagnosis = lumbar.diagnose(example_records(), settings=one_effect)
    >>> diagnosis.selected
    ('coulomb_friction',)
    >>> print(str(diagnosis).splitlines()[0])
    The KB model is missing coulomb friction: with it the error on unseen records falls by 96 %, from 0.225 to 0.0099 N.
    """
    settings = settings_or_default(settings)
    chosen = DiagnosisSettings.from_study(settings, base, train)
    source_label = records_label(source_label, records)
    used = [use_load_as_input(record) for record in records] if chosen.load_drives else list(records)
    if any(record.points for record in used):
        return Diagnosis(used, chosen, search(used, chosen), settings, source_label)
    used, findings = limit_samples(used, chosen.session)
    result = search(used, chosen, findings)
    if any(record.axes for record in used):
        return SpatialDiagnosis(used, chosen, result, settings, source_label)
    return Diagnosis(used, chosen, result, settings, source_label)


def propose(
    records: Sequence[Record],
    *,
    base: str | None = None,
    train: str | Sequence[str] | None = None,
    settings: StudySettings | None = None,
    source_label: str = "",
) -> ProposedLaw:
    """Diagnose, and look for a short formula for what the catalogue leaves. For parameters see `lumbar.diagnose`.

    Raises
    ------
    InputError
        See `Diagnosis.propose`.

    Examples
    --------
    >>> import lumbar
    >>> law = lumbar.propose(lumbar.read("recordings/tissue"))  # doctest: +SKIP
    >>> law.save("proposed_law.yaml")                           # doctest: +SKIP
    """
    settings = settings_or_default(settings)
    source_label = records_label(source_label, records)
    require_motion_input(settings.improvement.forward)  # before the diagnosis, which takes seconds
    require_one_axis(records, "propose")
    return diagnose(records, base=base, train=train, settings=settings, source_label=source_label).propose()


class SpatialDiagnosis(Diagnosis):
    """Missing effects of a base model on records of several axes."""

    @cached_property
    def candidates(self) -> dict[str, Effect]:
        """The catalogue that was searched, in vector form."""
        return effects_in_space(self.settings.candidates, self.records[0].axes)

    @property
    def headline(self) -> str:
        """The result in one sentence."""
        return headline_in_space(self.result)

    @property
    def sentences(self) -> list[str]:
        """The result, the tissue's symmetry and axes, then what a reader asks next."""
        fit, experiment = self.result.model.fit, self.result.experiment
        axes = [] if self.result.orientation else principal_axes.axes_sentences(fit, experiment)
        return [self.headline, *axes, *details(self.result, self.candidates)]

    @property
    def axes_table(self) -> Table:
        """Principal stiffnesses and viscosities with their axes and intervals."""
        rows = principal_axes.principal_axes(self.result.model.fit, self.result.experiment)
        return principal_axes.principal_axes_table(rows, self.records[0].axes, self.source_label)

    @cached_property
    def reports(self) -> list[SpatialReport]:
        """Comparison of the base model with every record, and where it fails."""
        return spatial_reports(self.models[0], self.result.experiment, self.study.seed)

    @cached_property
    def evidence(self) -> Evidence:
        """Remaining errors along every axis, and candidates that add similar forces."""
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
