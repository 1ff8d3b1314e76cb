"""Command line: parsers of the commands of ``commands.yaml``, and settings of their options."""

from __future__ import annotations

import argparse
import os
import pkgutil
import re
import sys
import textwrap
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, cast

from lumbar import __version__
from lumbar.base.environment import use_one_thread
from lumbar.base.errors import did_you_mean, printable, user_message
from lumbar.base.files import check_place
from lumbar.base.yaml_file import shipped_yaml

if TYPE_CHECKING:
    from lumbar.settings.study_settings import StudySettings

COMMANDS_FILE = Path(__file__).with_name("commands.yaml")
"""File with group, function (``module:function``), help and options of each command."""
INTERRUPTED = 130
"""Exit status after Ctrl-C."""


class _Parser(argparse.ArgumentParser):
    """Parser that suggests the correct command or option for a misspelt name."""

    def parse_known_args(self, args=None, namespace=None):
        given = sys.argv[1:] if args is None else args
        options = self._option_string_actions
        for option in (word.partition("=")[0] for word in given if word.startswith("--")):
            meant = did_you_mean(option, options)
            if meant and self.get_default("run") and not any(known.startswith(option) for known in options):
                self.error(f"no option {option}{meant}")
        return super().parse_known_args(args, namespace)

    def error(self, message: str):
        wrong = re.match(r"argument COMMAND: invalid choice: '(.+?)'", message)
        super().error(
            f"no command {wrong[1]!r}{did_you_mean(wrong[1], command_names())}" if wrong else message
        )


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands with their options."""
    described = shipped_yaml(COMMANDS_FILE)
    shared = described.pop("shared")
    groups: dict[str, list[str]] = {}
    for name, command in described.items():
        groups.setdefault(command["group"], []).append(f"  {name:<11}{command['help']}")
    listed = "\n\n".join("\n".join([f"{group}:", *lines]) for group, lines in groups.items())
    parser = _Parser(
        prog="lumbar",
        usage="lumbar COMMAND ...",
        description=f"Soft-tissue force-feedback models and lifting stability, on files and folders.\n\n{listed}",
        epilog="'lumbar COMMAND --help' explains a command and gives examples.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    version = f"lumbar {__version__}"
    parser.add_argument("--version", action="version", version=version, help="print the version and exit")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, help=argparse.SUPPRESS)
    for name, command in described.items():
        about = command["help"]
        one = commands.add_parser(
            name,
            description=textwrap.fill(command.get("description", f"{about[0].upper()}{about[1:]}."), 79),
            epilog="\n  ".join(["example:", *command["examples"]]),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        _add_options(one, command["options"], shared)
        one.set_defaults(run=partial(_run, command["run"]), parser=one)
    return parser


def command_names() -> list[str]:
    """Return the names of all commands."""
    return [name for name in shipped_yaml(COMMANDS_FILE) if name != "shared"]


class _Terminal:
    """Standard output without control sequences from files or their names."""

    def __init__(self, inner: TextIO):
        self.inner = inner

    def write(self, text: str) -> int:
        return self.inner.write(printable(text))

    def __getattr__(self, name: str):
        return getattr(self.inner, name)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    arguments : sequence of str, optional
        Arguments of the command; default the arguments of the process.

    Returns
    -------
    int
        0; 1 if the data or settings cannot be used or a file cannot be written (the message is on standard
        error); 130 after Ctrl-C; argparse exits with 2 for a wrong command line.
    """
    use_one_thread()
    try:
        options = build_parser().parse_args(arguments)
        # Reject an output that cannot be written before anything is read: a fit takes minutes.
        for name in ("output", "excitation", "picture"):
            path = getattr(options, name, None)
            if path is not None:
                check_place(path if name == "output" and not path.suffix else path.parent)
        with redirect_stdout(cast(TextIO, _Terminal(sys.stdout))):
            options.run(options)
    except KeyboardInterrupt:
        print("lumbar: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader has ended, as in "lumbar … | head"; Python's buffered output must not raise again at its exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        message = user_message(error)
        if message is None:
            raise
        print(f"lumbar: {message}", file=sys.stderr)
        return 1
    return 0


def _span(text: str, has_name: bool = False) -> tuple:
    name, _, ends = text.partition("=") if has_name else ("", "", text)
    start, colon, stop = ends.partition(":")
    try:
        span = float(start or "-inf"), float(stop or "inf")
    except ValueError:
        span = None
    if not colon or span is None:
        allowed = (
            "NAME=START:STOP is needed, e.g. fit=0:60" if has_name else "START:STOP is needed, e.g. 1.5:20"
        )
        raise argparse.ArgumentTypeError(f"{text!r}: {allowed}")
    return (name, span) if has_name else span


def _port(text: str) -> int:
    if not (text.isdecimal() and 0 <= int(text) <= 65535):
        raise argparse.ArgumentTypeError(f"{text!r}: a number from 0 to 65535 is needed; 0 takes a free one")
    return int(text)


TYPES = {
    "path": Path,
    "float": float,
    "int": int,
    "names": lambda text: [name.strip() for name in text.split(",")],
    "port": _port,
    "span": _span,
    "named_span": partial(_span, has_name=True),
}
"""Functions that convert the text of an option, by their names in ``commands.yaml``."""


def _run(function: str, options: argparse.Namespace) -> None:
    """Import and call the function of a command."""
    pkgutil.resolve_name(f"lumbar.cli.{function}")(options)


def _add_options(parser: Any, options: Sequence[str | Mapping], shared: Mapping[str, Sequence]) -> None:
    """Add options to a parser or group: a string names shared options, and ``one of`` begins a group of exclusive options."""
    for entry in options:
        if isinstance(entry, str):
            _add_options(parser, shared[entry], shared)
            continue
        for names, how in entry.items():
            if names == "one of":
                _add_options(parser.add_mutually_exclusive_group(required=True), how, shared)
            else:
                kind = {"type": TYPES[how["type"]]} if "type" in how else {}
                parser.add_argument(*names.split(", "), **how | kind)


def read_settings(options: argparse.Namespace) -> StudySettings:
    """Return the settings of ``--config`` and ``--trust``; errors as in `lumbar.load_settings`."""
    if not options.config:
        from lumbar.settings.study_settings import StudySettings

        return StudySettings()
    from lumbar.study.load_study import load_settings

    return load_settings(*options.config, trust=options.trust)
