"""``lumbar import``: recordings in whatever form a machine wrote them, as records of a study."""

from __future__ import annotations

import argparse
from pathlib import Path


def add(commands) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "import",
        help="turn recordings of any column format into records of a study, and say what was guessed",
        description="Turn recordings of any column format (text in any dialect, MATLAB, HDF5, Excel) into records "
        "time_s,position_mm,force_N and a study, and say what was guessed and why. Nothing is written where a guess is "
        "not safe: the message has the candidates and the option that decides.",
        epilog="example:\n  lumbar import trial_1.txt trial_2.txt --dry-run\n"
        "  lumbar import trial_1.txt trial_2.txt --force 'Load cell' --force-unit '35.15 N' --output records\n"
        "  lumbar diagnose records --output out",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE", help="one file per recording")
    _add_columns(parser)
    _add_samples(parser)
    parser.add_argument(
        "--dry-run", action="store_true", help="show what would be written, and write nothing"
    )
    parser.add_argument(
        "--data", metavar="LABEL", help="words for the source of the data on tables and figures"
    )
    parser.add_argument("--licence", metavar="TEXT", help="licence of the data (default: not stated)")
    parser.add_argument("--output", type=Path, metavar="DIR", help="folder for records and study")
    parser.set_defaults(run=run, parser=parser)


def _add_columns(parser: argparse.ArgumentParser) -> None:
    for role in ("time", "position", "force"):
        none = "; none if there is no such column" if role == "time" else ""
        parser.add_argument(f"--{role}", metavar="COLUMN", help=f"column of {role}: name, or number{none}")
    for role, examples, calibration in (
        ("time", "s, ms, µs", "0.5 ms"),
        ("position", "m, mm, µm, inch, rad, deg", "0.01 mm"),
        ("force", "N, mN, kN, lbf, N·m", "35.15 N"),
    ):
        parser.add_argument(
            f"--{role}-unit",
            metavar="UNIT",
            help=f"its unit ({examples}), or what one of the file's numbers is, as '{calibration}'",
        )


def _add_samples(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--rate", type=float, metavar="HZ", help="sampling rate, where no column is time")
    parser.add_argument("--flip-force", action="store_true", help="change the sign of the force")
    parser.add_argument(
        "--trim",
        type=_span,
        metavar="START:STOP",
        help="take this part only, in seconds of the file's clock; either may be left out",
    )
    parser.add_argument(
        "--table",
        "--sheet",
        "--variable",
        metavar="NAME",
        help="part of the file: number of a table in a text file, sheet of a workbook, variable or group of a MATLAB "
        "or HDF5 file",
    )
    parser.add_argument(
        "--accept-clipped",
        action="store_true",
        help="take records whose force or position lies flat at its extreme",
    )


def _span(text: str) -> tuple[float, float]:
    start, colon, stop = text.partition(":")
    try:
        span = float(start or "-inf"), float(stop or "inf")
    except ValueError:
        span = None
    if not colon or span is None:
        raise argparse.ArgumentTypeError(f"{text!r}: START:STOP in seconds is needed, e.g. 1.5:20")
    return span


def run(options) -> None:
    """Read the files, show what was guessed, write records and study unless asked not to."""
    if options.output is None and not options.dry_run:
        options.parser.error("give --output DIR, or --dry-run to see what would be written")
    from lumbar.interface.importing import import_recordings

    names = ("time", "position", "force", "time_unit", "position_unit", "force_unit", "rate", "flip_force")
    imported = import_recordings(
        options.files,
        **{name: getattr(options, name) for name in (*names, "trim", "table", "accept_clipped")},
    )
    print(imported)
    if options.dry_run:
        return
    study = imported.save(options.output, data=options.data, licence=options.licence)
    written = f"{len(imported)} record{'s' * (len(imported) != 1)} and {study.name}"
    print(f"{study.parent}: {written}; next: {imported.next_command(study)}")
