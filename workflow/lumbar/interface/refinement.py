"""``lumbar.refine``: a base model with named effects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from lumbar.interface.model_reports import Comparisons, Locations, Reports
from lumbar.interface.result import Result, records_label, settings_or_default
from lumbar.records.record import Record, use_load_as_input
from lumbar.settings.study_settings import StudySettings
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import limit_samples
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.residuals.locate import compare_and_locate
from lumbar.tissue.diagnosis.selection import refine as refinement
from lumbar.tissue.diagnosis.selection.candidate import Candidate
from lumbar.tissue.effects.catalogue import usable_effects
from lumbar.tissue.models.fitted_model import FittedModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def refine(
    records: Sequence[Record],
    effects: Iterable[str],
    *,
    base: str | None = None,
    train: str | Sequence[str] | None = None,
    settings: StudySettings | None = None,
    source_label: str = "",
) -> Refinement:
    """Fit a base model with named effects, added one by one.

    Parameters
    ----------
    records : sequence of Record
        Records, one per excitation, with channels ``input`` and ``output``.
    effects : iterable of str
        Names in the catalogue, in the order in which they are added; empty for the base only.
    base, train, settings, source_label
        See `lumbar.diagnose`.

    Raises
    ------
    InputError
        If an effect is unknown, needs channels that the records lack, or is not excited.
    NumericalError
        If a fit does not converge, or an effect makes the model worse.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_records
    >>> refined = lumbar.refine(example_records(), ["coulomb_friction"])
    >>> print(str(refined).partition("Verdict")[0].rstrip())
    KB: 0.2299 N in training, 0.2247 on unseen records
    + coulomb_friction: 0.00989 N in training, 0.009904 on unseen records (-96 %)
    Noise floor: 0.0101 N (0.00961 to 0.0106) from 5 periods of 4 s.
    >>> f"{refined.model['coulomb_friction.coulomb_force'].value:.2f} N"
    '0.40 N'
    """
    settings = settings_or_default(settings)
    chosen = DiagnosisSettings.from_study(settings, base, train)
    source_label = records_label(source_label, records)
    return fit_effects(list(records), list(effects), chosen, settings.seed, source_label)


def fit_effects(
    records: Sequence[Record], effects: list[str], settings: DiagnosisSettings, seed: int, source_label: str
) -> Refinement:
    """Fit the base with effects, each added in turn, on records of a manageable size.

    Parameters
    ----------
    records : sequence of Record
        Records of one setup.
    effects : list of str
        Names of the effects, in the order in which they are added.
    settings : DiagnosisSettings
        Settings of the fit, with the base and the training records.
    seed : int
        Random seed of the intervals.
    source_label : str
        Name of the source of the data.
    """
    driven = [use_load_as_input(record) for record in records] if settings.load_drives else list(records)
    used, findings = limit_samples(driven, settings.session)
    if any(record.axes for record in used):
        from lumbar.tissue.diagnosis.spatial.spatial_diagnosis import refine as fit_in_space

        experiment, path = fit_in_space(used, effects, settings)
    else:
        experiment, path = refinement.refine(used, effects, settings)
    model = path[-1]
    if not model.fit.converged:  # the error that the base leaves can still be evaluated
        training, unit = experiment.training.name, experiment.output_unit
        sentence = (
            f"The fit of {refinement.model_name(model.fit)} to {training} did not converge: its parameters are where the "
            "optimiser stopped and are not a result."
        )
        findings = (*findings, Finding("not_converged", sentence, model.train_rms, unit, training))
    return Refinement(used, settings, experiment, path, seed, source_label, findings)


@dataclass(frozen=True, eq=False, repr=False)
class Refinement(Result):
    """A base model with named effects: the model after each effect, and the errors."""

    records: list[Record]
    settings: DiagnosisSettings
    experiment: Experiment
    path: list[Candidate]
    """Fits of the base, then of the base with the first effect, the first two effects, and so on."""
    seed: int
    source_label: str
    findings: tuple[Finding, ...] = ()
    """Remarks on records that were too long or too fast, and on a base fit that did not converge."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, in the order in which they were added."""
        return self.path[-1].effects

    @cached_property
    def models(self) -> list[FittedModel]:
        """Base model, then the base with the first effect, the first two effects, and so on."""
        return [refinement.fitted_model(item, self.experiment) for item in self.path]

    @property
    def model(self) -> FittedModel:
        """Base model with all effects."""
        return self.models[-1]

    @property
    def addable(self) -> list[str]:
        """Names of the effects that can be added to the base on these records."""
        candidates, training = self.settings.candidates, self.experiment.training
        if self.records[0].axes:
            from lumbar.tissue.diagnosis.spatial.spatial_diagnosis import usable_in_space

            return list(usable_in_space(candidates, self.experiment))
        if self.settings.forward:
            from lumbar.tissue.diagnosis.forward.forward_diagnosis import forward_catalogue

            return list(forward_catalogue(candidates, self.path[0].fit.structure.base, training))
        return list(usable_effects(candidates, training.motion.channels, training.scale)[0])

    def add(self, *effects: str) -> Refinement:
        """Refit with additional effects.

        Parameters
        ----------
        *effects : str
            Names of the effects; effects that the model already has are not added twice.
        """
        return self._refit(list(dict.fromkeys([*self.effects, *effects])))

    def remove(self, *effects: str) -> Refinement:
        """Refit without some effects.

        Parameters
        ----------
        *effects : str
            Names of the effects.
        """
        return self._refit([name for name in self.effects if name not in effects])

    def _refit(self, effects: list[str]) -> Refinement:
        return fit_effects(self.records, effects, self.settings, self.seed, self.source_label)

    def compare(self) -> Comparisons:
        """Compare the model with every record."""
        return Comparisons(self.model, self._reports, self.source_label, self.findings)

    def locate(self) -> Locations:
        """Locate the model's error on every record."""
        return Locations(self.model, self._reports, self.source_label, self.findings)

    @cached_property
    def _reports(self) -> Reports:
        if self.records[0].axes:
            from lumbar.tissue.diagnosis.spatial.spatial_reports import spatial_reports

            return spatial_reports(self.model, self.experiment, self.seed)
        return compare_and_locate(self.experiment, self.path[-1].fit, self.seed)

    @property
    def table(self) -> list[dict]:
        """Error ladder: one dict per model."""
        unit = self.experiment.output_unit
        return [
            {
                "model": refinement.model_name(item.fit),
                f"training ({unit})": item.train_rms,
                f"{self.experiment.test_data} ({unit})": item.test_rms,
            }
            for item in self.path
        ]

    def files(self) -> Iterator[tuple[str, Any]]:
        """Yield ``refined.json``, every model of the path, ready for export, and ``ladder``, its picture."""
        yield "refined.json", refinement.refined_document(self.path, self.experiment, self.source_label)
        yield "ladder", self.figure()

    def figure(self) -> Figure:
        """Return the picture of the error ladder."""
        from lumbar.publishing.figures.comparison_figures import ladder_figure

        return ladder_figure(self.path, self.experiment)

    def __str__(self) -> str:
        lines = refinement.ladder_sentences(self.path, self.experiment)
        return "\n".join([*lines, *(item.sentence for item in self.findings)])

    def __repr__(self) -> str:
        return f"<Refinement of {self.path[0].fit.structure.base.name}: {', '.join(self.effects) or 'no effect'}>"
