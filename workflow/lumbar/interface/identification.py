"""``lumbar.identify``: the thesis's models of a set of tissue tests."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pandas as pd

from lumbar.base.errors import InputError
from lumbar.interface.result import Result, records_label, settings_or_default
from lumbar.records.record import Record, RecordSet, require_clock, require_one_axis
from lumbar.settings.runtime import RuntimeSettings
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.tissue import TissueSettings
from lumbar.tables.table import Table
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.refine import fitted_model, refine
from lumbar.tissue.identification.identify_tissue import distinct
from lumbar.tissue.identification.identify_tissue import identify as identify_one
from lumbar.tissue.identification.model_tables import physical_parameters_table, table_3_1
from lumbar.tissue.models.bases import CHOSEN_BY_DATA
from lumbar.tissue.models.fitted_model import FittedModel, models_document
from lumbar.tissue.models.model_data import ARX

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lumbar.tissue.haptics.passive_models import PassiveFits


def identify(
    records: Sequence[Record],
    train: str | Sequence[str] | None = None,
    *,
    settings: StudySettings | None = None,
    source_label: str = "",
) -> Identification:
    """Identify MW, Maxwell, KB, HO, LE and IL, by ridge ARX as in the thesis and also by output error.

    Parameters
    ----------
    records : sequence of Record
        Records, one per excitation, all at one rate.
    train : str or sequence of str, optional
        Record to identify on, or several, one after another; all others are for testing. Default: the training record of the
        settings, or the longest.
    settings : StudySettings, optional
        Settings; ``tissue`` and ``seed`` are used. If ``improvement`` has ``effects``, the result also has the model of its
        ``base`` with these effects.
    source_label : str
        Name of the source of the data; default the folder or file they were read from.

    Raises
    ------
    InputError
        If records differ in units or sampling time, or a training record is too short.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_records
    >>> identification = lumbar.identify(example_records(), "multisine")
    >>> identification["KB"]
    <FittedModel KB, arx on multisine, VAF 94.52 %>
    >>> stiffness = identification["KB"]["spring_stiffness"]
    >>> f"{stiffness.value:.2f} {stiffness.unit}"
    '0.62 N/mm'
    """
    settings = settings_or_default(settings)
    tissue, improvement = settings.tissue, settings.improvement
    source_label, records = records_label(source_label, records), RecordSet(records)
    require_clock(records)
    require_one_axis(records, "identify")
    train = train or tissue.training or max(records, key=len).name
    chosen = [records[name] for name in ([train] if isinstance(train, str) else train)]
    models, grid = [], []
    for training in chosen:
        tests = [record for record in records if record is not training]
        identified, rows = identify_one(training, tests, tissue, settings.seed)
        models += identified
        if improvement.effects:
            # Table 3.1 has the refined model and the thesis's, so its base does not depend on the data.
            base = "KB" if improvement.base == CHOSEN_BY_DATA else improvement.base
            chosen_settings = DiagnosisSettings.from_study(settings, base, train=training.name)
            experiment, path = refine([training, *tests], list(improvement.effects), chosen_settings)
            models.append(fitted_model(path[-1], experiment))
        grid += rows
    return Identification(models, pd.DataFrame(grid).assign(data=source_label), tissue, source_label)


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Result):
    """Identified models by name."""

    models: list[FittedModel]
    """Identified models by training record, in the order of Table 3.1."""
    search: pd.DataFrame
    """Table of the search: one row per tested structure and ridge coefficient."""
    settings: TissueSettings
    source_label: str

    def __getitem__(self, name: str) -> FittedModel:
        """Return the model of this name; among several, the ridge ARX fit on the first training record."""
        return self.get(name)

    def get(self, name: str, estimator: str = ARX, trained_on: str | None = None) -> FittedModel:
        """Return one model.

        Parameters
        ----------
        name : str
            Name of the model, e.g. ``"KB"``.
        estimator : str
            Estimator; if the model was not fitted with it, a fit by another estimator is returned.
        trained_on : str, optional
            Training record; default the first.

        Raises
        ------
        InputError
            If the model does not exist.
        """
        models = [model for model in self.models if model.name == name]
        if not models:
            known = ", ".join(dict.fromkeys(model.name for model in self.models))
            raise InputError(f"no model {name!r}; there are {known}")
        models = [model for model in models if trained_on in (None, model.trained_on)]
        if not models:
            raise InputError(f"{name} was not identified on {trained_on!r}")
        return next((model for model in models if model.estimator == estimator), models[0])

    def __iter__(self) -> Iterator[FittedModel]:
        return iter(self.models)

    def __len__(self) -> int:
        return len(self.models)

    @property
    def table(self) -> Table:
        """Table 3.1 with the error metrics."""
        return self.table_3_1

    @property
    def table_3_1(self) -> Table:
        """Error metrics of all models on all training records."""
        return table_3_1(self.models, self.settings, self.source_label)

    @property
    def physical_parameters(self) -> Table:
        """Table of physical parameters with intervals."""
        return physical_parameters_table(self.models, self.settings.bootstrap.confidence, self.source_label)

    def free_run_figure(self, record: Record) -> Figure:
        """Return Figure 3.5: a record with the free runs of the models of the thesis and of models with effects.

        Parameters
        ----------
        record : Record
            Record that is simulated.
        """
        from lumbar.publishing.figures.tissue_figures import free_run_figure

        first = self.models[0].trained_on
        models = [model for model in self.models if model.trained_on == first and model.stable]
        drawn = {
            model.name: model.simulate(record)
            for model in models
            if not model.discrete or (model.estimator == ARX and model.name in ("MW", "KB", "HO"))
        }
        return free_run_figure(record, drawn, self.settings.segment_s)

    def passive(
        self, records: Sequence[Record], train: str | None = None, *, settings: RuntimeSettings | None = None
    ) -> PassiveFits:
        """Fit the models again as passive models, with and without a device; compare the errors.

        Parameters
        ----------
        records : sequence of Record
            Records that the models were identified on.
        train : str, optional
            Record to fit on; default the models' first training record.
        settings : RuntimeSettings, optional
            Settings; ``models``, moving average and device are used.

        Returns
        -------
        PassiveFits
            ``table(source_label)`` has the errors; ``save(folder, source_label)`` writes ``passive_models.json`` and the table.
        """
        from lumbar.tissue.haptics.passive_models import fit_passive_models

        training = RecordSet(records)[train or str(self.models[0].trained_on)].name
        settings, settling_s = settings or RuntimeSettings(), self.settings.settling_s
        return fit_passive_models(self.models, records, training, settings, settling_s)

    def files(self) -> Iterator[tuple[str, Any]]:
        """Yield ``models.json``, ``search.csv``, tables ``table_3_1`` and ``physical_parameters``."""
        yield "models.json", models_document(distinct(self.models), self.source_label)
        yield "search.csv", self.search
        yield "table_3_1", self.table_3_1
        yield "physical_parameters", self.physical_parameters

    def __repr__(self) -> str:
        return f"<Identification: {len(self)} models>"

    def __str__(self) -> str:
        lines = []
        for model in self.models:
            vaf = model.scores.vaf_percent
            score = "unstable" if vaf is None else f"{vaf:.1f} %VAF"
            lines.append(f"{model.name} ({model.estimator}, {model.trained_on}): {score}")
        return "\n".join(lines)
