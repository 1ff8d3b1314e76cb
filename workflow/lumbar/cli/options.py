"""The commands of ``commands.yaml`` as parsers, and the settings that their options name."""

from __future__ import annotations

import argparse
import pkgutil
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.yaml_file import shipped_yaml

if TYPE_CHECKING:
    from lumbar.settings.study_settings import StudySettings


def _span(text: str) -> tuple[float, float]:
    start, colon, stop = text.partition(":")
    try:
        span = float(start or "-inf"), float(stop or "inf")
    except ValueError:
        span = None
    if not colon or span is None:
        raise argparse.ArgumentTypeError(f"{text!r}: START:STOP is needed, e.g. 1.5:20")
    return span


def _named_span(text: str) -> tuple[str, tuple[float, float]]:
    name, equals, span = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"{text!r}: NAME=START:STOP is needed, e.g. fit=0:60")
    return name, _span(span)


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


def _port(text: str) -> int:
    if not (text.isdecimal() and 0 <= int(text) <= 65535):
        raise argparse.ArgumentTypeError(f"{text!r}: a number from 0 to 65535 is needed; 0 takes a free one")
    return int(text)


TYPES = {
    "path": Path,
    "float": float,
    "int": int,
    "names": _names,
    "port": _port,
    "span": _span,
    "named_span": _named_span,
}
"""Types of options by their names in ``commands.yaml``."""


def add_commands(commands: Any, runs: Mapping[str, str]) -> None:
    """Add the parser of every command with its options; `runs` names the function of each, as in ``module:function``."""
    described = shipped_yaml(Path(__file__).with_name("commands.yaml"))
    shared = described.pop("shared")
    for name, command in described.items():
        about = command["help"]
        parser = commands.add_parser(
            name,
            help=about,
            description=command.get("description", f"{about[0].upper()}{about[1:]}."),
            epilog="\n  ".join(["example:", *command["examples"]]),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        _add_options(parser, command["options"], shared)
        parser.set_defaults(run=partial(_run, runs[name]), parser=parser)


def _run(function: str, options: argparse.Namespace) -> None:
    """Import and call the function of a command."""
    pkgutil.resolve_name(f"lumbar.cli.{function}")(options)


def _add_options(parser: Any, options: Sequence[str | Mapping], shared: Mapping[str, Sequence]) -> None:
    """Add options to a parser or group: a string names shared options, ``one of`` a group of exclusive options."""
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


def given_settings(options: argparse.Namespace) -> StudySettings:
    """Return the settings of ``--config`` and ``--trust``; errors as in `lumbar.load_settings`."""
    if not options.config:
        from lumbar.settings.study_settings import StudySettings

        return StudySettings()
    from lumbar.study.load_study import load_settings

    return load_settings(*options.config, trust=options.trust)
