"""What the commands on a folder of records share: the records, and how they are fitted."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lumbar.study.settings_files import load_settings

if TYPE_CHECKING:
    from lumbar.interface.refinement import Refinement
    from lumbar.records.record import RecordSet
    from lumbar.settings.study_settings import StudySettings


def read_folder(options) -> tuple[StudySettings, RecordSet, dict[str, Any]]:
    """Return settings, records, and what options and settings say of the fit, as keywords of `lumbar.diagnose`."""
    from lumbar.interface.reading import read
    from lumbar.study.study_recordings import record_layout

    settings = load_settings(*options.config)
    layout, rate = record_layout(settings, options.base or settings.improvement.base)
    chosen = {
        "base": options.base,
        "train": options.train,
        "forward": options.forward,
        "periods": dict(map(_period, options.period)),
        "session": options.session,
        "settings": settings.improvement,
        "seed": settings.seed,
        "data": options.data or options.folder.name,
    }
    return settings, read(options.folder, layout=layout, rate=rate), chosen


def refined(options) -> Refinement:
    """Fit the base with the effects of ``--add`` to the records of the folder."""
    from lumbar.interface.refinement import refine

    settings, records, chosen = read_folder(options)
    return refine(records, options.add, gravity_m_s2=settings.stability.pendulum.gravity_m_s2, **chosen)


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
