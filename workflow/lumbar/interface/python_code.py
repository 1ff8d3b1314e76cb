"""The Python that fits what a page of a diagnosis shows, to copy: how the records are read, what settings say, the verbs."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import MISSING, fields, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.records.unpacking import stem_of
from lumbar.settings.improvement import is_data
from lumbar.settings.study_settings import StudySettings

if TYPE_CHECKING:
    from lumbar.records.record import Record
    from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
    from lumbar.tissue.diagnosis.selection.verdict import Verdict


def fitting_code(
    records: Sequence[Record],
    verdict: Verdict,
    chosen: DiagnosisSettings,
    study: StudySettings,
    reading: str = "",
) -> str:
    """Return Python that reads the records of a diagnosis and fits the base with effects, for which EFFECTS stands; or nothing.

    Parameters
    ----------
    records, verdict, chosen, study : of a `lumbar.interface.diagnosed.Diagnosis`
    reading : str, optional
        Lines that make ``records``; default those that read the files which the records come from. Files below the working
        directory are named from there, others with their folder alone: a page that is sent tells nothing of the machine.
    """
    used = _used(study, chosen.system)
    base_is_file = not isinstance(chosen.base, str)
    readable = reading or all(record.source for record in records)
    if not readable or (base_is_file and not used.improvement.base_files.get("base")):
        return ""
    names = [item.name for item in verdict.experiment.training.records]
    base = verdict.base.fit.structure.base
    name = base.spatial.base.name if base.spatial else base.name
    # A plane that the tool meets is found by a fit that is left to choose its base.
    given = [] if base_is_file or (base.spatial and base.contact) else [f"base={name!r}"]
    given.append(f"train={(names if len(names) > 1 else names[0])!r}")
    imports, lines = {"import lumbar"}, []
    if used != StudySettings():
        lines.append(f"settings = {as_code(used, imports)}")
        given.append("settings=settings")
    own_layout = used.tissue.layout != StudySettings().tissue.layout
    rate = study.tissue.rate_Hz if own_layout or chosen.system == "tissue" else None
    lines += [
        reading or f"records = {_call('lumbar.read', _files(records, own_layout, rate))}",
        f"refined = {_call('lumbar.refine', ['records', 'EFFECTS', *given])}",
        "print(refined)  # the error ladder",
        "print(refined.compare())  # how well the model agrees with every record",
        "print(refined.locate())  # where it fails",
    ]
    return "\n".join([*sorted(imports, reverse=True), "", *lines, ""])


def _used(study: StudySettings, system: str) -> StudySettings:
    """Return the settings that reading and a fit with named effects depend on; all others are the defaults."""
    default, chosen, tissue = StudySettings(), study.improvement, study.tissue
    moments = system == "pendulum" and tissue.layout == default.tissue.layout
    layout = study.lifting.moment_layout if moments else tissue.layout
    improvement = replace(
        default.improvement,
        base=_named(chosen.base) if chosen.base and is_data(chosen.base) else default.improvement.base,
        forward=chosen.forward,
        session=chosen.session,
        effect_files=tuple(map(_named, chosen.effect_files)),
    )
    gravity = replace(default.stability.pendulum, gravity_m_s2=study.stability.pendulum.gravity_m_s2)
    own = replace(default.tissue, layout=layout, settling_s=tissue.settling_s, force_frame=tissue.force_frame)
    stability = replace(default.stability, pendulum=gravity)
    return StudySettings(seed=study.seed, tissue=own, improvement=improvement, stability=stability)


def _files(records: Sequence[Record], own_layout: bool, rate: float | None) -> list[str]:
    """Arguments of `lumbar.read`."""
    names = [record.name for record in records]
    stems = [stem_of(Path(record.source)) for record in records]
    given = {
        "layout": "settings.tissue.layout" if own_layout else None,
        "rate": rate,
        "names": names if names != stems else None,
        "periods": {record.name: record.period for record in records if record.period is not None},
        "trims": {record.name: record.trim for record in records if record.trim is not None},
    }
    files = repr([_named(record.source) for record in records])
    return [files, *(f"{argument}={value}" for argument, value in given.items() if value)]


def _named(path: str) -> str:
    """A file as it is named on a page."""
    place, here = Path(path), Path.cwd()
    if not place.is_absolute():
        return place.as_posix()
    return place.relative_to(here).as_posix() if place.is_relative_to(here) else "/".join(place.parts[-2:])


def as_code(settings: Any, imports: set[str]) -> str:
    """Return settings as the Python that makes them, without keys that have their default; lines it needs go to `imports`.

    Examples
    --------
    >>> from lumbar.settings.improvement import ImprovementSettings
    >>> as_code(StudySettings(improvement=ImprovementSettings(session=True)), set())
    'StudySettings(improvement=ImprovementSettings(session=True))'
    """
    if isinstance(settings, dict):
        return (
            "{" + ", ".join(f"{name!r}: {as_code(value, imports)}" for name, value in settings.items()) + "}"
        )
    if not is_dataclass(settings):
        return repr(settings)
    kind, given = type(settings), []
    imports.add(f"from {kind.__module__} import {kind.__name__}")
    for item in fields(settings):
        usual = item.default if item.default_factory is MISSING else item.default_factory()
        value = getattr(settings, item.name)
        if value != usual:
            given.append(f"{item.name}={as_code(value, imports)}")
    return _call(kind.__name__, given)


def _call(function: str, arguments: Sequence[str]) -> str:
    """A call in one line, or, where that is long, with a line for each argument."""
    line = f"{function}({', '.join(arguments)})"
    inner = textwrap.indent(",\n".join(arguments), "    ")
    return line if len(line) < 90 else f"{function}(\n{inner},\n)"
