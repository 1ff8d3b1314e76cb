"""A command as a row of a table, and the options that several commands share."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lumbar.settings.study_settings import StudySettings


@dataclass(frozen=True)
class Option:
    """One option or argument, as `argparse.ArgumentParser.add_argument` takes it."""

    names: tuple[str, ...]
    how: dict[str, Any]

    def add_to(self, parser) -> None:
        """Add it to a parser or group."""
        parser.add_argument(*self.names, **self.how)


@dataclass(frozen=True)
class OneOf:
    """Options of which exactly one must be given."""

    options: tuple[Option, ...]

    def add_to(self, parser) -> None:
        """Add them to a parser."""
        group = parser.add_mutually_exclusive_group(required=True)
        for item in self.options:
            item.add_to(group)


def option(*names: str, **how: Any) -> Option:
    """Return an option; parameters as of `argparse.ArgumentParser.add_argument`."""
    return Option(names, how)


def path(*names: str, **how: Any) -> Option:
    """Return an option that is a path."""
    return Option(names, {"type": Path, **how})


CONFIG = path(
    "--config",
    action="append",
    default=[],
    metavar="YAML",
    help="settings laid over the defaults (a study file); may be given several times",
)

TRUST = option(
    "--trust",
    action="store_true",
    help="run programs from outside of this project: Python that settings name as an effect, libraries in FMUs",
)


def say_what_runs(fmus: list[Path], trust: bool) -> None:
    """Say before it happens that libraries of anybody are run."""
    if fmus and trust:
        names = ", ".join(file.name for file in fmus)
        print(
            f"--trust: the program in {names} is run with your rights, whoever made it, unless the file is refused",
            file=sys.stderr,
        )


def given_settings(options: argparse.Namespace) -> StudySettings:
    """Return the settings that ``--config`` and ``--trust`` give; errors as of `lumbar.load_settings`."""
    from lumbar.study.load_study import load_settings

    return load_settings(*options.config, trust=options.trust)


@dataclass(frozen=True)
class Command:
    """One command of the command line."""

    name: str
    help: str
    example: str
    """Without the indent of the first line."""
    run: Callable[[argparse.Namespace], None]
    """Takes the options, with the `parser` among them."""
    options: tuple[Option | OneOf, ...]
    description: str = ""
    """Default: the help as a sentence."""
    config: bool = True
    """Whether it takes ``--config`` and ``--trust``."""

    def add_to(self, commands) -> None:
        """Add the command to the parser of all."""
        parser = commands.add_parser(
            self.name,
            help=self.help,
            description=self.description or f"{self.help[0].upper()}{self.help[1:]}.",
            epilog=f"example:\n  {self.example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        for item in (CONFIG, TRUST, *self.options) if self.config else self.options:
            item.add_to(parser)
        parser.set_defaults(run=self.run, parser=parser)


OUTPUT = path("--output", required=True, metavar="DIR", help="folder for the results")
OUTPUT_OR_PRINTED = path(
    "--output", metavar="DIR", help="folder for the results; without it the result is only printed"
)
DATA = option(
    "--data",
    metavar="LABEL",
    help="words for the source of the data on tables and figures (default: the name)",
)
FOLDER = path(
    "folder",
    metavar="FOLDER",
    help="one file per excitation (time_s,position_mm,force_N unless the layout says otherwise)",
)
FIT = (
    option(
        "--base",
        metavar="MODEL",
        help="base model: LE, Maxwell, KV, KB, KV-mass, KB-mass, pendulum or a file of your own, BASE.yaml (default: the "
        "settings'); the pendulum's records are time_s,angle_rad,moment_Nm",
    ),
    option(
        "--forward",
        action="store_true",
        default=None,
        help="the records have the force as input and the motion as output (default: the settings')",
    ),
    option(
        "--train",
        metavar="NAME",
        action="append",
        help="record to fit on (default: the longest); may be given several times, to fit on several together",
    ),
    option(
        "--period",
        action="append",
        default=[],
        metavar="NAME=SECONDS",
        help="period of a record's excitation (default: found from the input)",
    ),
    option(
        "--session",
        action="store_true",
        default=None,
        help="the records were cut from one session, in the order of their names: each begins in the state in which the one "
        "before it left the tissue (default: the settings')",
    ),
)
"""How records are fitted, in the place of what the settings say."""
