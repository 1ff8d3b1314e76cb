"""``lumbar.refine``: a base model with effects that are named."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from lumbar.interface.verb import Result, label_of, settings_or_default
from lumbar.records.record import Record, forced
from lumbar.settings.study_settings import StudySettings
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.preparation import Experiment

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lumbar.interface.comparison import Comparisons, Locations
    from lumbar.tissue.diagnosis.residuals.locate import ResidualReport
    from lumbar.tissue.diagnosis.selection.candidate import Candidate
    from lumbar.tissue.models.fitted_model import FittedModel


def refine(
    records: Sequence[Record],
    effects: Iterable[str],
    *,
    base: str | None = None,
    train: str | Sequence[str] | None = None,
    settings: StudySettings | None = None,
    data: str = "",
) -> Refinement:
    """Fit a base model with effects that are named, each added in turn; parameters as of `lumbar.diagnose`.

    Parameters
    ----------
    effects : iterable of str
        Names in the catalogue, in the order in which they are added; none gives the base alone.

    Raises
    ------
    InputError
        For an unknown effect, one that the records lack channels for, or one that they do not excite.
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
    return fit_effects(list(records), list(effects), chosen, settings.seed, label_of(data, records))


def fit_effects(records, effects, settings, seed, data) -> Refinement:
    """Fit the base with these effects, each added in turn, on records of a manageable size."""
    from lumbar.tissue.diagnosis.fitting.decimation import limit_samples
    from lumbar.tissue.diagnosis.selection.refine import not_converged
    from lumbar.tissue.diagnosis.selection.refine import refine as fit_path

    driven = [forced(record) for record in records] if settings.load_drives else list(records)
    used, findings = limit_samples(driven, settings.session)
    experiment, path = fit_path(used, effects, settings)
    if not path[-1].fit.converged:
        findings = (*findings, not_converged(path[-1], experiment))
    return Refinement(used, settings, experiment, path, seed, data, findings)


@dataclass(frozen=True, eq=False, repr=False)
class Refinement(Result):
    """A base model with named effects: the models on the way and their errors."""

    shown = "rows"
    records: list[Record]
    settings: DiagnosisSettings
    experiment: Experiment
    path: list[Candidate]
    """Base, base and first effect, …."""
    seed: int
    data: str
    findings: tuple[Finding, ...] = ()
    """Records that were too long or too fast and what was used of them, and a base whose fit did not converge."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, in the order in which they were added."""
        return self.path[-1].effects

    @cached_property
    def models(self) -> list[FittedModel]:
        """Base, base and first effect, …."""
        from lumbar.tissue.diagnosis.selection.refine import fitted_model

        return [fitted_model(item, self.experiment) for item in self.path]

    @property
    def model(self) -> FittedModel:
        """The base with all effects."""
        return self.models[-1]

    def add(self, *effects: str) -> Refinement:
        """Refit with these effects more."""
        wanted = list(dict.fromkeys([*self.effects, *effects]))
        return fit_effects(self.records, wanted, self.settings, self.seed, self.data)

    def remove(self, *effects: str) -> Refinement:
        """Refit without these effects."""
        wanted = [name for name in self.effects if name not in effects]
        return fit_effects(self.records, wanted, self.settings, self.seed, self.data)

    def compare(self) -> Comparisons:
        """Compare the model with every record."""
        from lumbar.interface.comparison import Comparisons

        return Comparisons(self.model, self._on_records, self.data, self.findings)

    def locate(self) -> Locations:
        """See where the model fails on every record."""
        from lumbar.interface.comparison import Locations

        return Locations(self.model, self._on_records, self.data, self.findings)

    @cached_property
    def _on_records(self) -> list[ResidualReport]:
        from lumbar.tissue.diagnosis.residuals.locate import compare_and_locate

        return compare_and_locate(self.experiment, self.path[-1].fit, self.seed)

    def rows(self) -> list[dict]:
        """The error ladder: one dict per model."""
        from lumbar.tissue.diagnosis.selection.refine import model_name

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
        from lumbar.tissue.diagnosis.selection.refine import refined_document

        yield "refined.json", refined_document(self.path, self.experiment, self.data)
        yield "ladder", self.figure()

    def figure(self) -> Figure:
        """Return the picture of the error ladder."""
        from lumbar.publishing.figures.comparison_figures import ladder_figure, ladder_rungs

        floor, unit = self.experiment.floor, self.experiment.output_unit
        errors = [
            {"effects": item.effects, "train_rms": item.train_rms, "test_rms": item.test_rms}
            for item in self.path
        ]
        rungs = ladder_rungs({"base": self.path[0].fit.structure.base.name, "ladder": errors})
        return ladder_figure(rungs, unit, None if floor is None else floor.rms)

    def __str__(self) -> str:
        from lumbar.tissue.diagnosis.selection.refine import ladder_sentences

        lines = ladder_sentences(self.path, self.experiment)
        return "\n".join([*lines, *(item.sentence for item in self.findings)])

    def __repr__(self) -> str:
        return f"<Refinement of {self.path[0].fit.structure.base.name}: {', '.join(self.effects) or 'no effect'}>"
