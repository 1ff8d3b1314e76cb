"""The Python that fits what a page of a diagnosis shows, to copy: how the records are read, what settings say, the verbs."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, fields, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.records.unpacking import stem_of
from lumbar.settings.study_settings import StudySettings

if TYPE_CHECKING:
    from lumbar.interface.diagnosis import Diagnosis

EFFECTS = "EFFECTS"
"""Stands for the list of effects."""
_WIDTH = 88


def fitting_code(diagnosis: Diagnosis, reading: str = "") -> str:
    """Return Python that reads the records of a diagnosis and fits the base with `EFFECTS`; empty where it cannot be said.

    Parameters
    ----------
    reading : str, optional
        Lines that make ``records``; default those that read the files which the records come from.

    Notes
    -----
    Files below the working directory are named from there, others with their folder alone: a page that is sent to others
    says nothing of the machine it was made on.
    """
    chosen, study, default = diagnosis.settings, _used(diagnosis.study), StudySettings()
    of_file = not isinstance(chosen.base, str)
    own_layout = study.tissue.layout != default.tissue.layout
    own_moments = (
        chosen.system == "pendulum" and diagnosis.study.lifting.moment_layout != default.lifting.moment_layout
    )
    readable = all(record.source for record in diagnosis.records) and (own_layout or not own_moments)
    if not (reading or readable) or (of_file and not study.improvement.base_files.get("base")):
        return ""
    training = diagnosis.verdict.experiment.training
    names = [item.name for item in getattr(training, "parts", (training,))]
    given = [] if of_file else [f"base={diagnosis.verdict.base.fit.structure.base.name!r}"]
    given.append(f"train={(names if len(names) > 1 else names[0])!r}")
    imports, lines = ["import lumbar"], []
    if study != default:
        classes = sorted({(kind.__module__, kind.__name__) for kind in _classes(study)})
        imports += [f"from {module} import {name}" for module, name in classes]
        lines.append(f"settings = {as_code(study)}")
        given.append("settings=settings")
    lines += [
        reading or f"records = {_call('lumbar.read', _files(diagnosis, own_layout))}",
        f"refined = {_call('lumbar.refine', ['records', EFFECTS, *given])}",
        "print(refined)  # the error ladder",
        "print(refined.compare())  # how well the model agrees with every record",
        "print(refined.locate())  # where it fails",
    ]
    return "\n".join([*imports, "", *lines, ""])


def _used(study: StudySettings) -> StudySettings:
    """Return the settings that a fit with named effects depends on; all others are the defaults."""
    default, chosen, tissue = StudySettings(), study.improvement, study.tissue
    improvement = replace(
        default.improvement,
        base=_named(chosen.base) if chosen.base_files.get("base") else default.improvement.base,
        forward=chosen.forward,
        session=chosen.session,
        effect_files=tuple(map(_named, chosen.effect_files)),
    )
    gravity = study.stability.pendulum.gravity_m_s2
    pendulum = replace(default.stability.pendulum, gravity_m_s2=gravity)
    return replace(
        default,
        seed=study.seed,
        tissue=replace(default.tissue, layout=tissue.layout, settling_s=tissue.settling_s),
        improvement=improvement,
        stability=replace(default.stability, pendulum=pendulum),
    )


def _files(diagnosis: Diagnosis, own_layout: bool) -> list[str]:
    """Arguments of `lumbar.read`."""
    records, system = diagnosis.records, diagnosis.settings.system
    given = [repr([_named(record.source) for record in records])]
    if own_layout:
        given.append("layout=settings.tissue.layout")
    elif system == "pendulum":
        given.append("'pendulum'")
    if diagnosis.study.tissue.rate_Hz is not None and (own_layout or system != "pendulum"):
        given.append(f"rate={diagnosis.study.tissue.rate_Hz!r}")
    names = [record.name for record in records]
    if names != [stem_of(Path(record.source)) for record in records]:
        given.append(f"names={names!r}")
    for argument, values in (
        ("periods", {record.name: record.period for record in records}),
        ("trims", {record.name: record.trim for record in records}),
    ):
        known = {name: value for name, value in values.items() if value is not None}
        given += [f"{argument}={known!r}"] if known else []
    return given


def _named(path: str) -> str:
    """A file as it is named on a page."""
    place = Path(path)
    if not place.is_absolute():
        return place.as_posix()
    below = place.is_relative_to(Path.cwd())
    return place.relative_to(Path.cwd()).as_posix() if below else "/".join(place.parts[-2:])


def as_code(settings: Any) -> str:
    """Return settings as the Python that makes them, without keys that have their default.

    Examples
    --------
    >>> from lumbar.settings.improvement import ImprovementSettings
    >>> as_code(StudySettings(improvement=ImprovementSettings(session=True)))
    'StudySettings(improvement=ImprovementSettings(session=True))'
    """
    if is_dataclass(settings):
        return _call(
            type(settings).__name__, [f"{name}={as_code(value)}" for name, value in _changed(settings)]
        )
    if isinstance(settings, dict):
        return "{" + ", ".join(f"{name!r}: {as_code(value)}" for name, value in settings.items()) + "}"
    return repr(settings)


def _changed(settings: Any) -> Iterator[tuple[str, Any]]:
    """Keys whose values are not the default ones."""
    for item in fields(settings):
        usual = item.default if item.default_factory is MISSING else item.default_factory()
        value = getattr(settings, item.name)
        if value != usual:
            yield item.name, value


def _classes(settings: Any) -> Iterator[type]:
    """Classes that `as_code` names."""
    if is_dataclass(settings):
        yield type(settings)
        for _, value in _changed(settings):
            yield from _classes(value)
    elif isinstance(settings, dict):
        for value in settings.values():
            yield from _classes(value)


def _call(function: str, arguments: Sequence[str]) -> str:
    """A call in one line, or, where that is long, with a line for each argument."""
    line = f"{function}({', '.join(arguments)})"
    if len(line) <= _WIDTH:
        return line
    return f"{function}(\n" + "".join(f"{textwrap.indent(item, '    ')},\n" for item in arguments) + ")"
