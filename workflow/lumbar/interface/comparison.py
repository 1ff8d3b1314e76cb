"""``lumbar.compare`` and ``lumbar.locate``: how well a model agrees with every record, and where it fails."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from lumbar.base.errors import InputError
from lumbar.base.files import write_text
from lumbar.interface.verb import Result, label_of, settings_or_default
from lumbar.records.record import Record
from lumbar.settings.study_settings import StudySettings
from lumbar.tissue.models.fitted_model import FittedModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lumbar.tables.table import Table
    from lumbar.tissue.diagnosis.finding import Finding
    from lumbar.tissue.diagnosis.residuals.locate import ResidualReport


def compare(
    records: Sequence[Record],
    model: FittedModel,
    *,
    train: str | Sequence[str] | None = None,
    settings: StudySettings | None = None,
    data: str = "",
) -> Comparisons:
    """Simulate a model on every record: its errors with intervals, and the part that could be explained.

    Parameters
    ----------
    model : FittedModel
        Of `identify`, `refine` or `diagnose`, or read from a file.
    train : str or sequence of str, optional
        Record that the noise floor is taken from; default the one the model was fitted to, or the longest.
    settings : StudySettings, optional
        ``improvement.session`` says whether the records were cut from one session, in their order, ``tissue.settling_s`` from
        where on they count; ``seed`` is that of the intervals.
    data : str
        Words for the source of the data; default the folder or file they were read from.

    Raises
    ------
    InputError
        If `model` is no model, or the records cannot be used.

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
    return Comparisons(*_on_records(records, model, train, settings, data))


def locate(
    records: Sequence[Record],
    model: FittedModel,
    *,
    train: str | Sequence[str] | None = None,
    settings: StudySettings | None = None,
    data: str = "",
) -> Locations:
    """See where a model fails: time, frequency, motion, depth, reversals; parameters as of `compare`.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_records
    >>> records = example_records()
    >>> found = lumbar.locate(records, lumbar.refine(records, []).model)
    >>> print(found["other"].location.sentences[0].split(";")[0])
    other: 0.224 N of the error's 0.225 N are not noise
    """
    return Locations(*_on_records(records, model, train, settings, data))


def _on_records(
    records, model, train, settings, data
) -> tuple[FittedModel, list[ResidualReport], str, tuple]:
    from lumbar.tissue.diagnosis.fitting.decimation import limit_samples
    from lumbar.tissue.diagnosis.fitting.preparation import prepare
    from lumbar.tissue.diagnosis.fitting.session import in_session
    from lumbar.tissue.diagnosis.residuals.locate import residual_reports

    settings = settings_or_default(settings)
    session = settings.improvement.session
    data = label_of(data, records)
    records, changed = limit_samples(list(records), session)
    if not isinstance(model, FittedModel):
        found = f"an object of class {type(model).__name__}"
        raise InputError(f"model is {found}: give one model, e.g. identification['KB'] or diagnosis.model")
    if train is None and model.trained_on in [record.name for record in records]:
        train = model.trained_on
    experiment = prepare(records, train, settling_s=settings.tissue.settling_s)
    simulate = in_session(records, model.simulate) if session else model.simulate
    reports = residual_reports(records, simulate, experiment, settings.seed)
    return model, reports, data, changed


@dataclass(frozen=True, eq=False, repr=False)
class OnRecords(Result):
    """A model beside every record, which is found by its name."""

    model: FittedModel
    simulated: list[ResidualReport]
    data: str
    findings: tuple[Finding, ...] = ()
    """Records that were too long or too fast, and what was used of them."""
    stem: ClassVar[str]
    picture: ClassVar[str]

    def __len__(self) -> int:
        return len(self.simulated)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.model.name} on {len(self)} records>"

    def __iter__(self) -> Iterator[ResidualReport]:
        return iter(self.simulated)

    def __getitem__(self, name: str) -> ResidualReport:
        """What was found on the record of this name."""
        found = next((item for item in self.simulated if item.record.name == name), None)
        if found is None:
            known = ", ".join(item.record.name for item in self.simulated)
            raise InputError(f"no record {name!r}; there are {known}")
        return found

    @property
    def _finding_lines(self) -> list[str]:
        return [item.sentence for item in self.findings]

    def save(self, folder: str | os.PathLike) -> None:
        """Write the numbers as a table, one picture per record, and a page: ``compare…`` or ``location…``."""
        from lumbar.publishing.figures.style import save

        folder, pictures = Path(folder), {}
        for item in self.simulated:
            stem = folder / f"{self.picture}_{item.record.name}"
            save(self.figure(item.record.name), stem, self.data)
            pictures[item.record.name] = stem.with_name(f"{stem.name}.svg")
        self.table.write(folder / self.stem)
        write_text(folder / f"{self.stem}_page.html", self._page(pictures))

    @property
    @abstractmethod
    def table(self) -> Table:
        """Numbers of every record."""

    @abstractmethod
    def figure(self, name: str) -> Figure:
        """Return the picture of one record."""

    @abstractmethod
    def _page(self, pictures: dict[str, Path]) -> str: ...


@dataclass(frozen=True, eq=False, repr=False)
class Comparisons(OnRecords):
    """How well a model agrees with every record; attributes as of `OnRecords`."""

    stem, picture = "compare", "comparison"

    @property
    def table(self) -> Table:
        """VAF, FIT, error, noise and explainable error of every record."""
        from lumbar.tissue.diagnosis.residuals.compare import comparison_table

        return comparison_table([item.comparison for item in self.simulated], self.data)

    def figure(self, name: str) -> Figure:
        """Return the picture of one record: measured and simulated output, and what is left of every record."""
        from lumbar.publishing.figures.comparison_figures import comparison_figure

        shown = self[name]
        comparisons = [item.comparison for item in self.simulated]
        return comparison_figure(shown.record, shown.values, comparisons, self.model.name)

    def _page(self, pictures: dict[str, Path]) -> str:
        from lumbar.publishing.pages.record_pages import comparison_page

        return comparison_page(self.simulated, self.model.name, self.data, pictures)

    def __str__(self) -> str:
        return "\n".join([*(item.comparison.sentence for item in self.simulated), *self._finding_lines])


@dataclass(frozen=True, eq=False, repr=False)
class Locations(OnRecords):
    """Where a model fails on every record; attributes as of `OnRecords`."""

    stem, picture = "location", "location"

    @property
    def table(self) -> Table:
        """Numbers behind the pictures."""
        from lumbar.tissue.diagnosis.residuals.locate import location_table

        return location_table([item.location for item in self.simulated], self.data)

    def figure(self, name: str) -> Figure:
        """Return the nine pictures of one record's error."""
        from lumbar.publishing.figures.location_figure import location_figure

        return location_figure(self[name].location)

    def _page(self, pictures: dict[str, Path]) -> str:
        from lumbar.publishing.pages.record_pages import location_page

        return location_page(self.simulated, self.model.name, self.data, pictures)

    def __str__(self) -> str:
        from lumbar.tissue.diagnosis.residuals.locate import all_records_sentence

        locations = [item.location for item in self.simulated]
        told = ["\n  ".join(item.sentences) for item in locations]
        return "\n".join([all_records_sentence(locations), *told, *self._finding_lines])
