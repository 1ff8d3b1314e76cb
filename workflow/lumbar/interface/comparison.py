"""``lumbar.compare`` and ``lumbar.locate``: agreement of a model with records, and locations of its error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lumbar.base.errors import InputError
from lumbar.interface.model_reports import Comparisons, Locations, Reports
from lumbar.interface.refinement import Refinement, refine
from lumbar.interface.result import records_label, settings_or_default
from lumbar.records.record import Record
from lumbar.settings.study_settings import StudySettings
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import limit_samples
from lumbar.tissue.diagnosis.fitting.preparation import prepare, simulate_in_session
from lumbar.tissue.diagnosis.residuals import locate as residuals
from lumbar.tissue.models.fitted_model import FittedModel


def compare(
    records: Sequence[Record],
    model: FittedModel | None = None,
    *,
    train: str | Sequence[str] | None = None,
    settings: StudySettings | None = None,
    source_label: str = "",
) -> Comparisons:
    """Simulate a model on every record; return its errors with intervals, and the explainable part of each error.

    Parameters
    ----------
    records : sequence of Record
        Records, one per excitation, with channels ``input`` and ``output``.
    model : FittedModel, optional
        Result of `identify`, `refine` or `diagnose`, or read from a file; default the base of the settings, fitted to the
        records.
    train : str or sequence of str, optional
        Record that determines the noise floor; default the record of the model's fit, or the longest.
    settings : StudySettings, optional
        ``improvement.session``: whether the records are parts of one session, in their order; ``tissue.settling_s``: seconds
        at the start of a record that are ignored; ``seed``: random seed of the intervals.
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
    if model is None:
        return _fit_base(records, train, settings, source_label).compare()
    return Comparisons(*_simulate_on_records(records, model, train, settings, source_label))


def locate(
    records: Sequence[Record],
    model: FittedModel | None = None,
    *,
    train: str | Sequence[str] | None = None,
    settings: StudySettings | None = None,
    source_label: str = "",
) -> Locations:
    """Locate a model's error: time, frequency, position and velocity, reversals, causes.

    Parameters
    ----------
    records : sequence of Record
        Records, one per excitation, with channels ``input`` and ``output``.
    model : FittedModel, optional
        Result of `identify`, `refine` or `diagnose`, or read from a file; default the base of the settings, fitted to the
        records.
    train : str or sequence of str, optional
        Record that determines the noise floor, see `compare`.
    settings : StudySettings, optional
        Settings; ``improvement.session``, ``tissue.settling_s`` and ``seed`` are used, see `compare`.
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
    >>> found = lumbar.locate(records)
    >>> print(found["other"].location.sentences[0].split(";")[0])
    other: 0.224 N of the error's 0.225 N are not noise
    >>> found.candidate_effects[:2]
    ['coulomb_friction', 'viscous_damping']
    """
    if model is None:
        return _fit_base(records, train, settings, source_label).locate()
    return Locations(*_simulate_on_records(records, model, train, settings, source_label))


def _fit_base(
    records: Sequence[Record],
    train: str | Sequence[str] | None,
    settings: StudySettings | None,
    source_label: str,
) -> Refinement:
    return refine(records, [], train=train, settings=settings, source_label=source_label)


def _simulate_on_records(
    records: Sequence[Record],
    model: Any,
    train: str | Sequence[str] | None,
    settings: StudySettings | None,
    source_label: str,
) -> tuple[FittedModel, Reports, str, tuple[Finding, ...]]:
    """Return the values of `ModelReports`; parameters as in `compare`."""
    settings = settings_or_default(settings)
    session = settings.improvement.session
    source_label = records_label(source_label, records)
    records, findings = limit_samples(list(records), session)
    if not isinstance(model, FittedModel):
        given = f"an object of class {type(model).__name__}"
        raise InputError(f"model is {given}: give one model, e.g. identification['KB'] or diagnosis.model")
    if train is None and model.trained_on in [record.name for record in records]:
        train = model.trained_on
    if any(record.axes for record in records):
        from lumbar.tissue.diagnosis.spatial.spatial_data import prepare as prepare_in_space
        from lumbar.tissue.diagnosis.spatial.spatial_reports import spatial_reports

        chosen = DiagnosisSettings.from_study(settings, None, train)
        reports: Reports = spatial_reports(model, prepare_in_space(records, chosen), settings.seed)
    else:
        experiment = prepare(records, train, settling_s=settings.tissue.settling_s).shift_to_rest()
        simulate = simulate_in_session(records, model.simulate) if session else model.simulate
        reports = residuals.residual_reports(
            [(item, simulate(item), experiment) for item in records], settings.seed
        )
    return model, reports, source_label, findings
