"""Options that the commands share."""

from __future__ import annotations

import argparse
from pathlib import Path


def new_command(commands, name: str, help: str, example: str) -> argparse.ArgumentParser:
    """Add a command with the options that all of them have."""
    parser = commands.add_parser(
        name,
        help=help,
        description=help[0].upper() + help[1:] + ".",
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--config",
        type=Path,
        action="append",
        default=[],
        metavar="YAML",
        help="settings laid over the defaults (a study file); may be given several times",
    )
    return parser


def add_output(parser: argparse.ArgumentParser, required: bool = True) -> None:
    """Add ``--output DIR``."""
    text = "folder for the results" + ("" if required else "; without it the result is only printed")
    parser.add_argument("--output", type=Path, required=required, metavar="DIR", help=text)


def add_data(parser: argparse.ArgumentParser) -> None:
    """Add ``--data LABEL``."""
    parser.add_argument(
        "--data",
        metavar="LABEL",
        help="words for the source of the data on tables and figures (default: the name)",
    )


def add_folder(parser: argparse.ArgumentParser) -> None:
    """Add ``FOLDER``, the records of a set."""
    parser.add_argument(
        "folder",
        type=Path,
        metavar="FOLDER",
        help="one file per excitation (time_s,position_mm,force_N unless the layout says otherwise)",
    )


def add_fit(parser: argparse.ArgumentParser) -> None:
    """Add ``--base``, ``--train``, ``--period`` and ``--session``."""
    parser.add_argument(
        "--base",
        metavar="MODEL",
        help="base model: LE, Maxwell, KV, KB, KV-mass, KB-mass or pendulum (default: the settings'); the pendulum's records are "
        "time_s,angle_rad,moment_Nm",
    )
    parser.add_argument(
        "--forward",
        action="store_true",
        default=None,
        help="the records have the force as input and the motion as output (default: the settings')",
    )
    parser.add_argument(
        "--train",
        metavar="NAME",
        action="append",
        help="record to fit on (default: the longest); may be given several times, to fit on several together",
    )
    parser.add_argument(
        "--period",
        action="append",
        default=[],
        metavar="NAME=SECONDS",
        help="period of a record's excitation (default: found from the input)",
    )
    parser.add_argument(
        "--session",
        action="store_true",
        default=None,
        help="the records were cut from one session, in the order of their names: each begins in the state in which the one "
        "before it left the tissue (default: the settings')",
    )


def add_model(parser: argparse.ArgumentParser, effects_required: bool = False) -> None:
    """Add what names a base with effects, the records it is fitted to, and where results go."""
    add_folder(parser)
    add_effects(parser, effects_required)
    add_fit(parser)
    add_output(parser)
    add_data(parser)


def add_effects(parser: argparse.ArgumentParser, required: bool = False) -> None:
    """Add ``--add EFFECT``."""
    parser.add_argument(
        "--add",
        action="append",
        default=[],
        required=required,
        metavar="EFFECT",
        help="effect added to the base; may be given several times",
    )
