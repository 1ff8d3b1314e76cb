"""``lumbar.refine``, ``compare`` and ``locate``: a base with named effects, its agreement with records, where it fails."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.errors import InputError
from lumbar.base.files import write_text
from lumbar.interface.result import Result, label_of, settings_or_default
from lumbar.records.record import Record, use_load_as_input
from lumbar.settings.study_settings import StudySettings
from lumbar.tables.table import Table
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import limit_samples
from lumbar.tissue.diagnosis.fitting.preparation import Experiment, prepare, simulate_in_session
from lumbar.tissue.diagnosis.residuals.compare import comparison_table
from lumbar.tissue.diagnosis.residuals.locate import (
    ResidualReport,
    all_reports_sentence,
    axis_reports,
    compare_and_locate,
    expand_axes,
    location_table,
    residual_reports,
)
from lumbar.tissue.diagnosis.selection.candidate import Candidate
from lumbar.tissue.diagnosis.selection.refine import (
    fitted_model,
    ladder_sentences,
    model_name,
    not_converged,
    refined_document,
)
from lumbar.tissue.diagnosis.selection.refine import refine as fit_path
from lumbar.tissue.models.fitted_model import FittedModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lumbar.tissue.diagnosis.spatial.spatial_reports import SpatialReport


def refine(
    records: Sequence[Record],
    effects: Iterable[str],
    *,
    base: str | None = None,
    train: str | Sequence[str] | None = None,
    settings: StudySettings | None = None,
    source_label: str = "",
) -> Refinement:
    """Fit a base model with named effects, added one by one. Other parameters: see `lumbar.diagnose`.

    Parameters
    ----------
    effects : iterable of str
        Names in the catalogue, in the order in which they are added; empty for the base only.

    Raises
    ------
    InputError
        For an unknown effect, or one that the records have no channels for or do not excite.
    NumericalError
        If a fit does not converge, or an effect makes the model worse.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_records
    >>> refined = lumbar.refine(example_records(), ["coulomb_friction"])
    >>> print(str(refined).partition("Verdict")[0].rstrip())
    KB: 0.2299 N in training, 0.2247 unseen
    + coulomb_friction: 0.00989 N in training, 0.009904 unseen (-96 %)
    Noise floor: 0.0101 N (0.00961 to 0.0106) from 5 periods of 4 s.
    >>> f"{refined.model['coulomb_friction.coulomb_force'].value:.2f} N"
    '0.40 N'
    """
    settings = settings_or_default(settings)
    chosen = DiagnosisSettings.from_study(settings, base, train)
    source_label = label_of(source_label, records)
    return fit_effects(list(records), list(effects), chosen, settings.seed, source_label)


def fit_effects(records, effects, settings, seed, data) -> Refinement:
    """Fit the base with these effects, each added in turn, on records of a manageable size."""
    driven = [use_load_as_input(record) for record in records] if settings.load_drives else list(records)
    used, findings = limit_samples(driven, settings.session)
    if any(record.axes for record in used):
        from lumbar.tissue.diagnosis.spatial.spatial_diagnosis import refine as fit_in_space

        experiment, path = fit_in_space(used, effects, settings)
    else:
        experiment, path = fit_path(used, effects, settings)
    if not path[-1].fit.converged:
        findings = (*findings, not_converged(path[-1], experiment))
    return Refinement(used, settings, experiment, path, seed, data, findings)


@dataclass(frozen=True, eq=False, repr=False)
class Refinement(Result):
    """A base model with named effects: the model after each effect, and the errors."""

    records: list[Record]
    settings: DiagnosisSettings
    experiment: Experiment
    path: list[Candidate]
    """Base, base and first effect, …."""
    seed: int
    source_label: str
    findings: tuple[Finding, ...] = ()
    """Used parts of records that were too long or too fast, and a fit of the base that did not converge."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, in the order in which they were added."""
        return self.path[-1].effects

    @cached_property
    def models(self) -> list[FittedModel]:
        """Base, base and first effect, …."""
        return [fitted_model(item, self.experiment) for item in self.path]

    @property
    def model(self) -> FittedModel:
        """The base with all effects."""
        return self.models[-1]

    def add(self, *effects: str) -> Refinement:
        """Refit with additional effects."""
        wanted = list(dict.fromkeys([*self.effects, *effects]))
        return fit_effects(self.records, wanted, self.settings, self.seed, self.source_label)

    def remove(self, *effects: str) -> Refinement:
        """Refit without these effects."""
        wanted = [name for name in self.effects if name not in effects]
        return fit_effects(self.records, wanted, self.settings, self.seed, self.source_label)

    def compare(self) -> OnRecords:
        """Compare the model with every record."""
        return OnRecords(self.model, self._reports, self.source_label, COMPARISONS, self.findings)

    def locate(self) -> OnRecords:
        """Locate the model's error on every record."""
        return OnRecords(self.model, self._reports, self.source_label, LOCATIONS, self.findings)

    @cached_property
    def _reports(self) -> Sequence[ResidualReport | SpatialReport]:
        if self.records[0].axes:
            from lumbar.tissue.diagnosis.spatial.spatial_reports import spatial_reports

            return spatial_reports(self.model, self.experiment, self.seed)
        return compare_and_locate(self.experiment, self.path[-1].fit, self.seed)

    @property
    def table(self) -> list[dict]:
        """The error ladder, see `rows`."""
        return self.rows()

    def rows(self) -> list[dict]:
        """The error ladder: one dict per model."""
        unit = self.experiment.output_unit
        return [
            {
                "model": model_name(item.fit),
                f"training ({unit})": item.train_rms,
                f"unseen ({unit})": item.test_rms,
            }
            for item in self.path
        ]

    def files(self) -> Iterator[tuple[str, Any]]:
        """``refined.json``, every model of the path, ready for export, and ``ladder``, its picture."""
        yield "refined.json", refined_document(self.path, self.experiment, self.source_label)
        yield "ladder", self.figure()

    def figure(self) -> Figure:
        """Return the picture of the error ladder."""
        from lumbar.publishing.figures.comparison_figures import ladder_figure, ladder_rungs

        floor = self.experiment.floor
        errors = [
            {"effects": item.effects, "train_rms": item.train_rms, "test_rms": item.test_rms}
            for item in self.path
        ]
        rungs = ladder_rungs({"base": self.path[0].fit.structure.base.name, "ladder": errors})
        rms = None if floor is None else floor.rms
        return ladder_figure(rungs, self.experiment.output_unit, rms)

    def __str__(self) -> str:
        lines = ladder_sentences(self.path, self.experiment)
        return "\n".join([*lines, *(item.sentence for item in self.findings)])

    def __repr__(self) -> str:
        return f"<Refinement of {self.path[0].fit.structure.base.name}: {', '.join(self.effects) or 'no effect'}>"


def compare(
    records: Sequence[Record],
    model: FittedModel,
    *,
    train: str | Sequence[str] | None = None,
    settings: StudySettings | None = None,
    source_label: str = "",
) -> OnRecords:
    """Simulate a model on every record: its errors with intervals, and the part that could be explained.

    Parameters
    ----------
    model : FittedModel
        Result of `identify`, `refine` or `diagnose`, or read from a file.
    train : str or sequence of str, optional
        Record that the noise floor is taken from; default the one the model was fitted to, or the longest.
    settings : StudySettings, optional
        ``improvement.session``: whether the records are parts of one session, in their order; ``tissue.settling_s``: seconds
        at the start of a record that are ignored; ``seed``: that of the intervals.
    source_label : str
        Name of the source of the data; default the folder or file they were read from.

    Raises
    ------
    InputError
        If `model` is not a model, or the records cannot be used.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_records
    >>> records = example_records()
    >>> found = lumbar.compare(records, lumbar.refine(records, ["coulomb_friction"]).model)
    >>> found
    <Comparisons of KB+coulomb_friction on 2 records>
    >>> f"{found['other'].comparison.vaf.value:.1f} % of the variance"
    '100.0 % of the variance'
    """
    return _on_records(records, model, train, settings, source_label, COMPARISONS)


def locate(
    records: Sequence[Record],
    model: FittedModel,
    *,
    train: str | Sequence[str] | None = None,
    settings: StudySettings | None = None,
    source_label: str = "",
) -> OnRecords:
    """Locate a model's error: time, frequency, position and velocity, reversals, causes. Parameters: see `compare`.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_records
    >>> records = example_records()
    >>> found = lumbar.locate(records, lumbar.refine(records, []).model)
    >>> print(found["other"].location.sentences[0].split(";")[0])
    other: 0.224 N of the error's 0.225 N are not noise
    """
    return _on_records(records, model, train, settings, source_label, LOCATIONS)


COMPARISONS, LOCATIONS = "Comparisons", "Locations"
"""Subjects of `OnRecords`: how well a model agrees with records, or where it fails."""


def _on_records(records, model, train, settings, source_label: str, shows: str) -> OnRecords:
    """Simulate the model on the records, compare it and locate its error; `shows` is the subject of the result."""
    settings = settings_or_default(settings)
    session = settings.improvement.session
    source_label = label_of(source_label, records)
    records, findings = limit_samples(list(records), session)
    if not isinstance(model, FittedModel):
        given = f"an object of class {type(model).__name__}"
        raise InputError(f"model is {given}: give one model, e.g. identification['KB'] or diagnosis.model")
    if train is None and model.trained_on in [record.name for record in records]:
        train = model.trained_on
    reports: Sequence[ResidualReport | SpatialReport]
    if any(record.axes for record in records):
        from lumbar.tissue.diagnosis.spatial.spatial_data import prepare as prepare_in_space
        from lumbar.tissue.diagnosis.spatial.spatial_reports import spatial_reports

        chosen = DiagnosisSettings.from_study(settings, None, train)
        reports = spatial_reports(model, prepare_in_space(records, chosen), settings.seed)
    else:
        experiment = prepare(records, train, settling_s=settings.tissue.settling_s).shift_to_rest()
        simulate = simulate_in_session(records, model.simulate) if session else model.simulate
        reports = residual_reports([(item, simulate(item), experiment) for item in records], settings.seed)
    return OnRecords(model, reports, source_label, shows, findings)


@dataclass(frozen=True, eq=False, repr=False)
class OnRecords(Result):
    """A model on every record: how well it agrees with them, or where it fails."""

    model: FittedModel
    reports: Sequence[ResidualReport | SpatialReport]
    """One of every record."""
    source_label: str
    shows: str
    """`COMPARISONS` or `LOCATIONS`."""
    findings: tuple[Finding, ...] = ()
    """Used parts of records that were too long or too fast."""

    @cached_property
    def simulated(self) -> list[ResidualReport]:
        """Reports along every axis; with several axes the record's name ends with the axis."""
        return axis_reports(self.reports)

    def __len__(self) -> int:
        return len(self.simulated)

    def __iter__(self) -> Iterator[ResidualReport]:
        return iter(self.simulated)

    def __getitem__(self, name: str) -> Any:
        """Return the report of the record of this name, or of one of its axes, e.g. ``"multisine (x)"``."""
        reports = {item.record.name: item for item in expand_axes(self.reports)}
        if name not in reports:
            raise InputError(f"no record {name!r}; there are {', '.join(reports)}")
        return reports[name]

    @property
    def table(self) -> Table:
        """Errors, noise and explainable error of every record; or share and p-value of every view of the error."""
        if self.shows == LOCATIONS:
            return location_table(self.reports, self.source_label)
        return comparison_table([item.comparison for item in self.simulated], self.source_label)

    def figure(self, name: str = "") -> Figure:
        """Return the picture of one record: its output with the simulated one, or its error.

        The name of a single record may be left out.
        """
        name = name or (self.reports[0].record.name if len(self.reports) == 1 else name)
        report = self[name]
        if report.record.axes:
            from lumbar.publishing.figures.location_figures import comparison_in_space, location_in_space

            located = self.shows == LOCATIONS
            return location_in_space(report) if located else comparison_in_space(report, self.model.name)
        if self.shows == LOCATIONS:
            from lumbar.publishing.figures.location_figures import location_figure

            return location_figure(report.location)
        from lumbar.publishing.figures.comparison_figures import comparison_figure

        comparisons = [item.comparison for item in self.simulated]
        return comparison_figure(report.record, report.values, comparisons, self.model.name)

    @property
    def pictured(self) -> dict[str, str]:
        """File of the picture by name of the record; where the error is located of every axis too."""
        stem = "location" if self.shows == LOCATIONS else "comparison"
        files = {report.record.name: f"{stem}_{report.record.name}" for report in self.reports}
        if self.shows == LOCATIONS:
            for report in self.reports:
                for axis in report.axes if report.record.axes else ():
                    # A file is multisine_x, the axis of a record "multisine (x)".
                    files[axis.record.name] = "_".join([stem, *axis.record.name[:-1].rsplit(" (", 1)])
        return files

    def files(self) -> Iterator[tuple[str, Any]]:
        """The table, ``compare`` or ``location``, and a picture per record."""
        yield "location" if self.shows == LOCATIONS else "compare", self.table
        for name, file in self.pictured.items():
            yield file, self.figure(name)

    def save(self, folder: str | os.PathLike) -> None:
        """Write the `files` and a page that shows them: ``compare_page.html`` or ``location_page.html``."""
        from lumbar.publishing.pages.html import comparison_page, location_page

        super().save(folder)
        pictures = {name: Path(folder) / f"{file}.svg" for name, file in self.pictured.items()}
        page, stem = (location_page, "location") if self.shows == LOCATIONS else (comparison_page, "compare")
        text = page(self.reports, self.model.name, self.source_label, pictures)
        write_text(Path(folder) / f"{stem}_page.html", text)

    def __repr__(self) -> str:
        axes = self.reports[0].record.axes
        records = f"{len(self.reports)} records{f' of {len(axes)} axes' if axes else ''}"
        return f"<{self.shows} of {self.model.name} on {records}>"

    def __str__(self) -> str:
        if self.shows == LOCATIONS:
            lines = [all_reports_sentence(self.reports)]
            for item in self.reports:
                along = [axis.location.headline for axis in item.axes if axis is not item]
                lines.append("\n  ".join([*item.sentences, *along]))
        else:
            resting = [line for item in self.reports for line in item.remarks]
            lines = [*(item.comparison.sentence for item in self.simulated), *resting]
        return "\n".join([*lines, *(item.sentence for item in self.findings)])
