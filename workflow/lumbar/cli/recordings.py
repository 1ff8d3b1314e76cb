"""Commands on recordings and lifts: ``lumbar import``, ``check``, ``inspect``, ``new-study``, ``lift`` and ``basin``."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path

import lumbar
from lumbar.base.errors import InputError, NumericalError, Problems
from lumbar.base.files import read_json
from lumbar.cli.command import read_settings
from lumbar.interface.reading import is_column_file, is_marker_file
from lumbar.settings.study_settings import StudySettings


def run_import(options) -> None:
    """Read the files, print the guesses, write records and study unless ``--dry-run`` is given."""
    if options.output is None and not options.dry_run:
        options.parser.error("give --output DIR, or --dry-run to see what would be written")
    names = (
        *("time", "position", "force", "time_unit", "position_unit", "force_unit", "rate", "flip_force"),
        *("trim", "cut", "cut_by", "table", "encoding", "accept_clipped", "forward", "name"),
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
    from lumbar.lifting.quality.body import read_upright
    from lumbar.records.checking import check_recordings

    settings, files = read_settings(options), []
    for path in options.paths:
        inside = (
            [item for item in sorted(path.iterdir()) if is_column_file(item) or is_marker_file(item)]
            if path.is_dir()
            else [path]
        )
        if not inside:
            raise InputError(f"{path}: no recordings in this folder")
        files += inside
    plan = [_reading(file, options.chapter, settings) for file in files]
    for chapter, recordings in check_recordings(plan, read_upright).items():
        for description in recordings:
            print(f"{chapter}: {_describe(description)}")


def _reading(file: Path, chapter: str, settings: StudySettings) -> dict:
    """Return an entry of the plan of `lumbar.records.checking.check_recordings`."""
    section = getattr(settings, chapter)
    if is_marker_file(file):
        chapter, reader, layout = "lifting", "markers", settings.lifting.markers
    elif chapter == "lifting":
        reader, layout = "columns", section.moment_layout
    else:
        reader, layout = "ratings" if chapter == "survey" else "columns", section.layout
    entry = {
        "chapter": chapter,
        "reader": reader,
        "path": str(file),
        "layout": layout.model_dump(mode="json"),
    }
    return entry | ({"set": chapter} if reader == "columns" else {})


def _describe(description: dict) -> str:
    if description["reader"] == "ratings":
        models = ", ".join(description["models"])
        return f"{description['file']}: {description['participants']} participants rated {models}"
    clock = "{file}: {samples} samples, {rate_Hz:g} Hz, {duration_s:g} s".format(**description)
    if description["reader"] == "markers":
        return "; ".join([f"{clock}; markers {', '.join(description['markers'])}", *description["notes"]])
    channels = (
        f"{role}: {item['quantity']} in {item['unit']}" for role, item in description["channels"].items()
    )
    return f"{clock}; {', '.join(channels)}"


def run_inspect(options) -> None:
    """Inspect the files, print the reports, draw one if requested; report unreadable files last."""
    from lumbar.interface.inspecting import check_picture_format

    if options.picture and len(options.files) > 1:
        raise InputError(f"--picture draws one file; {len(options.files)} are given")
    if options.picture:
        check_picture_format(options.picture)
    settings = read_settings(options).lifting if options.config else None
    problems, results = Problems("files"), []
    for file in options.files:
        try:
            results.append(lumbar.inspect(file, settings=settings, height_m=options.height))
        except InputError as error:
            problems.add("", str(error))
    if options.json:
        print(json.dumps([one.to_dict() for one in results], indent=2))
    else:
        print("\n\n".join("\n".join(one.lines(options.details)) for one in results))
    if options.picture and results:
        results[0].save_picture(options.picture)
    problems.raise_if_any()


def run_new_study(options) -> None:
    """Inspect the recordings, write the files, print the entries that the user must complete."""
    study = lumbar.new_study(options.folder, options.name)
    study.save(options.project)
    print(study)


def run_lift(options) -> None:
    """Analyse a lift, write its pendulums, print its events, its measures and the checks of its centres of mass."""
    study = read_settings(options)
    result = lumbar.lift(
        options.markers,
        options.subject,
        options.box_mass,
        trial=options.trial,
        settings=study.lifting if options.config else None,
        static=options.static,
        source_label=options.data or options.markers.name,
    )
    result.save(options.output)
    measures = lumbar.measure_movement(result, settings=study.stability)
    measures.save(options.output)
    # Reasons for missing pendulums are printed last.
    print(result if result.analysed.states else result.recording_summary)
    print(measures)
    lines = [*result.checks, f"pendulum.csv and pendulum.json are in {options.output}"]
    if not result.analysed.states:
        lines[-1] = f"no pendulum: pendulum.csv in {options.output} has no rows"
        lines += result.missing_pendulums
        if result.facts["no_deposit"]:
            lines.append("set these events in the trial: events: {deposit_start_s: …, release_s: …}")
    print("\n".join(lines))
    if options.page:
        lumbar.lift_page(result, settings=study.stability).save(options.page)
        print(f"{options.page} shows the lift.")
    else:
        print(f"Its page: {_explore_command(options.output, options)}")


def _explore_command(folder: Path, options) -> str:
    """Return the command that shows a folder's lifts with the settings of `options`."""
    given = [part for path in options.config for part in ("--config", str(path))]
    return shlex.join(["lumbar", "explore", str(folder), *given])


def run_basin(options) -> None:
    """Compute and check the basins, write areas and funnels; end with an error if a basin of the study is missing."""
    from lumbar.lifting.stability.model.pendulum_trajectories import announcement

    settings = read_settings(options)
    facts = read_json(options.facts) if options.facts else None
    result = lumbar.basins(options.states, facts=facts, settings=settings.stability, seed=settings.seed)
    result.save(options.output)
    if not result.areas.empty:
        print(f"{result}\n{len(result.areas)} basins are in {options.output / 'boa.csv'}")
        print(f"To push the pendulums: {_explore_command(options.states.parent, options)}")
    if (failures := result.failures()).empty:
        return
    message = announcement(failures, len(result.areas), options.output / "failures.csv")
    if not result.complete:
        raise NumericalError(message)
    print(f"WARNING: {message}", file=sys.stderr)
