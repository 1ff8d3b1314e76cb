"""Parsing of the command line; each command lies in a module of its own and imports its library when it
runs."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

from lumbar.environment import use_one_thread
from lumbar.errors import LumbarError

COMMANDS = (
    "check",
    "bandwidth",
    "signals",
    "identify",
    "compare",
    "locate",
    "diagnose",
    "refine",
    "export",
    "survey",
    "lift",
    "basin",
)
"""Modules of `lumbar.cli`, in the thesis's order; each has ``add(commands)``, which sets ``run``."""


class _Version(argparse.Action):
    def __call__(self, parser, namespace, values, option_string=None):
        from importlib.metadata import version

        print(f"lumbar {version('lumbar')}")
        parser.exit()


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = argparse.ArgumentParser(
        prog="lumbar",
        description="Soft-tissue force-feedback models and lifting stability: does on files and folders "
        "what the Snakemake workflow does on a study, with settings that all have defaults.",
        epilog="'lumbar COMMAND --help' explains a command and gives examples.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name in COMMANDS:
        import_module(f"lumbar.cli.{name}").add(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    arguments : sequence of str, optional
        Default: those of the process.

    Returns
    -------
    int
        0; 1 where the data or settings cannot be used (the message is on standard error); argparse exits with
        2 for a wrong command line.
    """
    use_one_thread()
    options = build_parser().parse_args(arguments)
    try:
        options.run(options)
    except LumbarError as error:
        print(f"lumbar: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"lumbar: {error.filename}: {error.strerror}", file=sys.stderr)
        return 1
    return 0
