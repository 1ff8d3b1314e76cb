"""``lumbar.diagnose`` and ``lumbar.propose``: which effect a model is missing."""

from __future__ import annotations

from collections.abc import Sequence

from lumbar.interface.diagnosis import Diagnosis, ProposedLaw, require_motion_input
from lumbar.interface.result import records_label, settings_or_default
from lumbar.records.record import Record, require_one_axis, use_load_as_input
from lumbar.settings.study_settings import StudySettings
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import limit_samples
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose as search


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
        Records, one per excitation, with channels ``input`` and ``output``. The period is ``Record.period``, or is detected
        from the input.
    base : str, optional
        Base model: LE, Maxwell, KV, KB, pendulum or a user-defined base, BASE.yaml; default the base of the settings.
    train : str or sequence of str, optional
        Record to fit on, or several that are fitted together; default the settings', or the longest.
    settings : StudySettings, optional
        Result of `lumbar.load_settings`. Used are ``improvement`` (user-defined effects, how many to add, whether the
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
        If the base is unknown or the records cannot be used.

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
        from lumbar.interface.diagnosis_in_space import SpatialDiagnosis

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
    """Diagnose, and search for a short formula for the error that the catalogue does not explain.

    Parameters
    ----------
    records : sequence of Record
        Records of one axis with the position as input.
    base : str, optional
        Base model, see `lumbar.diagnose`.
    train : str or sequence of str, optional
        Record to fit on, or several that are fitted together.
    settings : StudySettings, optional
        Settings that `lumbar.diagnose` uses.
    source_label : str
        Name of the source of the data; default the folder or file they were read from.

    Raises
    ------
    InputError
        If `Diagnosis.propose` raises it.

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
