"""Effects that are Python: run only where the study that names them is one's own, or where that is said."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import Problems
from lumbar.settings.improvement import ImprovementSettings, is_data

if TYPE_CHECKING:
    from lumbar.study.validation import Origins


def check_code(
    improvement: ImprovementSettings,
    files: Sequence[Path],
    project: Path | None,
    problems: Problems,
    origins: Origins,
) -> None:
    """Check, before anything is run, that Python and every file of settings lie in the project that one works in.

    A study that was sent by somebody else could otherwise run what it likes; an effect in YAML is data.
    `files` are those of the settings, `project` is its folder, None outside of any.
    """
    for number, effect in enumerate(improvement.effect_files):
        if is_data(effect):
            continue
        strange = [file for file in (*files, Path(project or "", effect)) if not _lies_in(file, project)]
        if strange:
            place = origins.place(("improvement", "effect_files", number))
            problems.add(
                place,
                f"{effect} is Python, which would be run, and {strange[0]} lies in no project that you work in",
                "read it first; then write the effect in YAML, copy study and effect into your project, or say --trust "
                "(lumbar.load_settings: trust=True)",
            )


def _lies_in(file: Path, project: Path | None) -> bool:
    return project is not None and file.resolve().is_relative_to(project.resolve())
