"""``lumbar check``: read recordings and FMUs and describe them, or tell every problem."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import InputError
from lumbar.cli.options import new_command
from lumbar.settings.plain import plain
from lumbar.study.load_study import load_settings

if TYPE_CHECKING:
    from lumbar.settings.study_settings import StudySettings


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "check",
        "read recordings and FMUs and describe them, or tell every problem of every file; the library in an FMU is a program "
        "and is run, so check only files that you would run",
        "lumbar check recordings/tissue\n  lumbar check --chapter survey survey.csv\n  lumbar check fmu/KB_fmi3.fmu",
    )
    parser.add_argument("paths", type=Path, nargs="+", metavar="FILE|FOLDER")
    parser.add_argument(
        "--chapter",
        choices=("surgeon", "tissue", "survey", "lifting"),
        default="tissue",
        help="whose layout column files have (default tissue; C3D, TRC and BVH files are always "
        "markers of lifting)",
    )
    parser.set_defaults(run=run)


def run(options) -> None:
    """Check the files and print one line for each."""
    from lumbar.lifting.quality.body import read_upright
    from lumbar.records.checking import check_recordings

    settings = load_settings(*options.config)
    files = _files(options.paths)
    fmus = [path for path in files if _is_fmu(path)]
    if fmus:
        from lumbar.interface.fmu_checking import check_fmu

        for check in check_fmu(fmus, settings=settings.runtime):
            print(f"runtime: {check}")
    plan = [_reading(path, options.chapter, settings) for path in files if not _is_fmu(path)]
    for chapter, recordings in check_recordings(plan, read_upright).items():
        for description in recordings:
            print(f"{chapter}: {_line(description)}")


def _is_fmu(path: Path) -> bool:
    return path.suffix == ".fmu"


def _files(paths: list[Path]) -> list[Path]:
    from lumbar.interface.reading import is_column_file, is_marker_file

    kinds = (is_column_file, is_marker_file, _is_fmu)
    files = []
    for path in paths:
        if path.is_dir():
            found = [item for item in sorted(path.iterdir()) if any(kind(item) for kind in kinds)]
            if not found:
                raise InputError(f"{path}: no recordings and no FMUs in this folder")
            files += found
        else:
            files.append(path)
    return files


def _reading(path: Path, chapter: str, settings: StudySettings) -> dict:
    """Entry of the plan of `lumbar.records.checking.check_recordings`."""
    from lumbar.interface.reading import is_marker_file

    if is_marker_file(path):
        layout = plain(settings.lifting.markers)
        return {"chapter": "lifting", "reader": "markers", "path": str(path), "layout": layout}
    if chapter == "survey":
        return {
            "chapter": chapter,
            "reader": "ratings",
            "path": str(path),
            "layout": plain(settings.survey.layout),
        }
    own = getattr(settings, chapter)
    layout = plain(own.moment_layout if chapter == "lifting" else own.layout)
    return {"chapter": chapter, "set": chapter, "reader": "columns", "path": str(path), "layout": layout}


def _line(description: dict) -> str:
    if description["reader"] == "ratings":
        models = ", ".join(description["models"])
        return f"{description['file']}: {description['participants']} participants rated {models}"
    clock = "{file}: {samples} samples, {rate_Hz:g} Hz, {duration_s:g} s".format(**description)
    if description["reader"] == "markers":
        return "; ".join([f"{clock}; markers {', '.join(description['markers'])}", *description["notes"]])
    channels = description["channels"].items()
    return f"{clock}; " + ", ".join(
        f"{role}: {item['quantity']} in {item['unit']}" for role, item in channels
    )
