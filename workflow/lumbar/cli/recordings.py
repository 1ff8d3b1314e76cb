"""Commands on recordings: ``lumbar import``, ``check`` and ``inspect``."""

from __future__ import annotations

import json
from pathlib import Path

import lumbar
from lumbar.base.errors import InputError, Problems
from lumbar.cli.command import read_settings
from lumbar.interface.reading import is_column_file, is_marker_file
from lumbar.settings.study_settings import StudySettings


def run_import(options) -> None:
    """Read the files, print the guesses, write records and study unless ``--dry-run`` is given."""
    if options.output is None and not options.dry_run:
        options.parser.error("give --output DIR, or --dry-run to see what would be written")
    names = (
        *("time", "position", "force", "time_unit", "position_unit", "force_unit", "rate", "flip_force"),
        *("trim", "cut", "cut_by", "table", "encoding", "accept_clipped", "name"),
    )
    choices = {name: getattr(options, name) for name in names}
    imported = lumbar.import_recordings(options.files, **choices)
    print(imported)
    if options.dry_run:
        return
    study = imported.save(
        options.output, source_label=options.data, licence=options.licence, forward=options.forward
    )
    written = f"{len(imported)} record{'s' * (len(imported) != 1)} and {study.name}"
    print(f"{study.parent}: {written}; next: {imported.next_command(study)}")


def run_check(options) -> None:
    """Check the files and print one line for each."""
    settings = read_settings(options)
    plan = [_reading(file, options.chapter, settings) for file in _files(options.paths)]
    from lumbar.lifting.quality.body import read_upright
    from lumbar.records.checking import check_recordings

    for chapter, recordings in check_recordings(plan, read_upright).items():
        for description in recordings:
            print(f"{chapter}: {_line(description)}")


def _files(paths: list[Path]) -> list[Path]:
    kinds = (is_column_file, is_marker_file)
    files = []
    for given in paths:
        if given.is_dir():
            found = [item for item in sorted(given.iterdir()) if any(kind(item) for kind in kinds)]
            if not found:
                raise InputError(f"{given}: no recordings in this folder")
            files += found
        else:
            files.append(given)
    return files


def _reading(file: Path, chapter: str, settings: StudySettings) -> dict:
    """Return an entry of the plan of `lumbar.records.checking.check_recordings`."""
    if is_marker_file(file):
        layout = settings.lifting.markers.model_dump(mode="json")
        return {"chapter": "lifting", "reader": "markers", "path": str(file), "layout": layout}
    own = getattr(settings, chapter)
    layout = (own.moment_layout if chapter == "lifting" else own.layout).model_dump(mode="json")
    if chapter == "survey":
        return {"chapter": chapter, "reader": "ratings", "path": str(file), "layout": layout}
    return {"chapter": chapter, "set": chapter, "reader": "columns", "path": str(file), "layout": layout}


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


def run_inspect(options) -> None:
    """Inspect the files, print the reports, draw one if asked; errors of unreadable files come last."""
    from lumbar.interface.inspecting import check_picture

    if options.picture and len(options.files) > 1:
        raise InputError(f"--picture draws one file; {len(options.files)} are given")
    if options.picture:
        check_picture(options.picture)
    settings = read_settings(options).lifting if options.config else None
    problems, found = Problems("files"), []
    for file in options.files:
        try:
            found.append(lumbar.inspect(file, settings=settings, height_m=options.height))
        except InputError as error:
            problems.add("", str(error))
    if options.json:
        print(json.dumps([one.as_dict() for one in found], indent=2))
    else:
        print("\n\n".join(map(str, found)))
    if options.picture and found:
        found[0].save_picture(options.picture)
    problems.raise_if_any()
