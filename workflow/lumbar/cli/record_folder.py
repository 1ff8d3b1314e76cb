"""What the commands on a folder of records share: the records, and how they are fitted."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from lumbar.study.load_study import load_settings

if TYPE_CHECKING:
    from lumbar.interface.refinement import Refinement
    from lumbar.records.record import RecordSet
    from lumbar.settings.study_settings import StudySettings


def fit_settings(options) -> StudySettings:
    """Settings of the files of ``--config``, with what the other options say of the fit in their place."""
    settings = load_settings(*options.config)
    said = {name: getattr(options, name) for name in ("base", "train", "forward", "session")}
    given = {name: value for name, value in said.items() if value is not None}
    return replace(settings, improvement=replace(settings.improvement, **given))


def read_folder(options) -> tuple[RecordSet, StudySettings, str]:
    """Return the records of the folder with their periods, how they are fitted, and what they are called."""
    from lumbar.interface.reading import read
    from lumbar.study.study import record_layout
    from lumbar.tissue.diagnosis.noise.periods import fold_periods

    settings = fit_settings(options)
    layout, rate = record_layout(settings, settings.improvement.base)
    periods = dict(map(_period, options.period))
    records = read(options.folder, layout=layout, rate=rate).with_periods(periods)
    for name, seconds in periods.items():
        fold_periods(records[name], seconds)  # a period that is asked for and cannot be used is an error
    return records, settings, options.data or options.folder.name


def refined(options) -> Refinement:
    """Fit the base with the effects of ``--add`` to the records of the folder."""
    from lumbar.interface.refinement import refine

    records, settings, data = read_folder(options)
    return refine(records, options.add, settings=settings, data=data)


def _period(text: str) -> tuple[str, float]:
    from lumbar.base.errors import InputError

    name, _, seconds = text.partition("=")
    try:
        value = float(seconds)
    except ValueError:
        value = 0.0
    if not name or not 0 < value < float("inf"):
        raise InputError(f"--period {text!r}: NAME=SECONDS with positive seconds is needed")
    return name, value
