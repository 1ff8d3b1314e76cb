"""Commands on recordings: ``lumbar import``, ``check`` and ``inspect``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import InputError, Problems
from lumbar.cli.options import Command, given_settings, option, path, say_what_runs
from lumbar.settings.plain import plain

if TYPE_CHECKING:
    from lumbar.settings.study_settings import StudySettings


def run_import(options) -> None:
    """Read the files, show what was guessed, write records and study unless asked not to."""
    if options.output is None and not options.dry_run:
        options.parser.error("give --output DIR, or --dry-run to see what would be written")
    from lumbar.interface.importing import import_recordings

    names = ("time", "position", "force", "time_unit", "position_unit", "force_unit", "rate", "flip_force")
    imported = import_recordings(
        options.files,
        **{
            name: getattr(options, name)
            for name in (*names, "trim", "cut", "cut_by", "table", "encoding", "accept_clipped", "name")
        },
    )
    print(imported)
    if options.dry_run:
        return
    study = imported.save(options.output, data=options.data, licence=options.licence, forward=options.forward)
    written = f"{len(imported)} record{'s' * (len(imported) != 1)} and {study.name}"
    print(f"{study.parent}: {written}; next: {imported.next_command(study)}")


def _span(text: str) -> tuple[float, float]:
    start, colon, stop = text.partition(":")
    try:
        span = float(start or "-inf"), float(stop or "inf")
    except ValueError:
        span = None
    if not colon or span is None:
        raise argparse.ArgumentTypeError(f"{text!r}: START:STOP in seconds is needed, e.g. 1.5:20")
    return span


def _named_span(text: str) -> tuple[str, tuple[float, float]]:
    name, equals, span = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"{text!r}: NAME=START:STOP is needed, e.g. fit=0:60")
    return name, _span(span)


IMPORT = Command(
    "import",
    "turn recordings of any column format into records of a study, and say what was guessed",
    "lumbar import trial_1.txt trial_2.txt --dry-run\n"
    "  lumbar import trial_1.txt trial_2.txt --force 'Load cell' --force-unit '35.15 N' --output records\n"
    "  lumbar diagnose records --output out",
    run_import,
    (
        path("files", nargs="+", metavar="FILE", help="one file per recording"),
        option(
            "--time",
            metavar="COLUMN",
            help="column of time: name, or number; none if there is no such column",
        ),
        option("--position", metavar="COLUMN", help="column of position: name, or number"),
        option("--force", metavar="COLUMN", help="column of force: name, or number"),
        *(
            option(
                f"--{role}-unit",
                metavar="UNIT",
                help=f"its unit ({examples}), or what one of the file's numbers is, as '{calibration}'",
            )
            for role, examples, calibration in (
                ("time", "s, ms, µs", "0.5 ms"),
                ("position", "m, mm, µm, inch, rad, deg; mm/s, rad/s: integrated", "0.01 mm"),
                ("force", "N, mN, kN, lbf, N·m", "35.15 N"),
            )
        ),
        option("--rate", type=float, metavar="HZ", help="sampling rate, where no column is time"),
        option("--flip-force", action="store_true", help="change the sign of the force"),
        option(
            "--trim",
            type=_span,
            metavar="START:STOP",
            help="take this part only, in seconds of the file's clock; either may be left out",
        ),
        option(
            "--cut",
            type=_named_span,
            action="append",
            default=[],
            metavar="NAME=START:STOP",
            help="a part of one file that becomes a record of this name, as of --trim; may be given several times",
        ),
        option(
            "--cut-by",
            metavar="COLUMN",
            help="column that names or numbers the trial: each stretch of one value becomes a record",
        ),
        option(
            "--table",
            "--sheet",
            "--variable",
            metavar="NAME",
            help="part of the file: number of a table in a text file, sheet of a workbook, variable or group of a MATLAB "
            "or HDF5 file",
        ),
        option(
            "--encoding",
            metavar="NAME",
            help="encoding of texts, as Python names it: gbk, shift_jis, … (default: UTF-8, UTF-16, western Windows-1252)",
        ),
        option(
            "--accept-clipped",
            action="store_true",
            help="take records whose force or position lies flat at its extreme",
        ),
        option(
            "--name", metavar="NAME", help="name of the record, where one file is given (default: the file's)"
        ),
        option(
            "--forward",
            action="store_true",
            help="the load drove the tests and the motion was measured: the study takes the load for the input",
        ),
        option("--dry-run", action="store_true", help="show what would be written, and write nothing"),
        option("--data", metavar="LABEL", help="words for the source of the data on tables and figures"),
        option("--licence", metavar="TEXT", help="licence of the data (default: not stated)"),
        path("--output", metavar="DIR", help="folder for records and study"),
    ),
    description="Turn recordings of any column format (text in any dialect, MATLAB, HDF5, Excel) into records "
    "time_s,position_mm,force_N and a study, and say what was guessed and why. Nothing is written where a guess is "
    "not safe: the message has the candidates and the option that decides.",
    config=False,
)


def run_check(options) -> None:
    """Check the files and print one line for each."""
    from lumbar.lifting.quality.body import read_upright
    from lumbar.records.checking import check_recordings

    settings = given_settings(options)
    files = _files(options.paths)
    fmus = [file for file in files if _is_fmu(file)]
    if options.key and not fmus:
        raise InputError("--key verifies FMUs, and there is none among these files")
    if fmus:
        from lumbar.interface.device import check_fmu

        say_what_runs(fmus, options.trust)
        own = settings.improvement.effect_files
        for check in check_fmu(
            fmus, key=options.key, trust=options.trust, effect_files=own, settings=settings.runtime
        ):
            print(f"runtime: {check}")
    plan = [_reading(file, options.chapter, settings) for file in files if not _is_fmu(file)]
    for chapter, recordings in check_recordings(plan, read_upright).items():
        for description in recordings:
            print(f"{chapter}: {_line(description)}")


def _is_fmu(file: Path) -> bool:
    return file.suffix == ".fmu"


def _files(paths: list[Path]) -> list[Path]:
    from lumbar.interface.reading import is_column_file, is_marker_file

    kinds = (is_column_file, is_marker_file, _is_fmu)
    files = []
    for given in paths:
        if given.is_dir():
            found = [item for item in sorted(given.iterdir()) if any(kind(item) for kind in kinds)]
            if not found:
                raise InputError(f"{given}: no recordings and no FMUs in this folder")
            files += found
        else:
            files.append(given)
    return files


def _reading(file: Path, chapter: str, settings: StudySettings) -> dict:
    """Entry of the plan of `lumbar.records.checking.check_recordings`."""
    from lumbar.interface.reading import is_marker_file

    if is_marker_file(file):
        layout = plain(settings.lifting.markers)
        return {"chapter": "lifting", "reader": "markers", "path": str(file), "layout": layout}
    own = getattr(settings, chapter)
    layout = plain(own.moment_layout if chapter == "lifting" else own.layout)
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


CHECK = Command(
    "check",
    "read recordings and FMUs and describe them, or tell every problem of every file; the library in an FMU is a program, "
    "run where this machine makes the same of its record, where --key vouches for it, or with --trust",
    "lumbar check recordings/tissue\n  lumbar check --chapter survey survey.csv\n  lumbar check fmu/KB_fmi3.fmu",
    run_check,
    (
        path("paths", nargs="+", metavar="FILE|FOLDER"),
        path(
            "--key",
            metavar="KEY.pub",
            help="public keys, a line each: every FMU must be signed with one of them (FILE.fmu.sig), or nothing of it is run",
        ),
        option(
            "--chapter",
            choices=("surgeon", "tissue", "survey", "lifting"),
            default="tissue",
            help="whose layout column files have (default tissue; C3D, TRC and BVH files are always "
            "markers of lifting)",
        ),
    ),
)


def run_inspect(options) -> None:
    """Inspect the files, print what was found, draw it where asked; files that cannot be read come last."""
    import json

    from lumbar.interface.inspecting import check_picture, inspect

    if options.picture and len(options.files) > 1:
        raise InputError(f"--picture draws one file; {len(options.files)} are given")
    if options.picture:
        check_picture(options.picture)
    settings = given_settings(options).lifting if options.config else None
    problems, found = Problems("files"), []
    for file in options.files:
        try:
            found.append(inspect(file, settings=settings, height_m=options.height))
        except InputError as error:
            problems.add("", str(error))
    if options.json:
        print(json.dumps([one.as_dict() for one in found], indent=2))
    else:
        print("\n\n".join(map(str, found)))
    if options.picture and found:
        found[0].save_picture(options.picture)
    problems.raise_if_any()


INSPECT = Command(
    "inspect",
    "say what is in marker files, what is wrong with them and what the pipeline makes of them",
    "lumbar inspect expert_23kg.c3d --height 1.75 --picture expert_23kg.svg",
    run_inspect,
    (
        path(
            "files", nargs="+", metavar="FILE", help="C3D, TRC, CSV, MAT or BVH file with markers (.gz too)"
        ),
        option("--height", type=float, metavar="M", help="stature: lengths of the body are compared with it"),
        option("--json", action="store_true", help="print a list of JSON objects, one per file"),
        path("--picture", metavar="FILE", help="draw heights, gaps and findings of one file as .svg or .pdf"),
    ),
)
