"""Settings and options that the commands share."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.errors import InputError

if TYPE_CHECKING:
    from lumbar.settings.study import StudySettings
    from lumbar.settings.subject import SubjectSettings


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


def load_settings(files: list[Path]) -> StudySettings:
    """Return the defaults with the settings of `files` laid over them.

    Raises
    ------
    InputError
        With every file that cannot be read, and every wrong key and value of all files.
    """
    from lumbar.config.consistency import check_effects
    from lumbar.config.validation import Origins, laid_over, validated
    from lumbar.config.yaml_file import read_yaml
    from lumbar.errors import Problems
    from lumbar.settings.study import StudySettings

    problems = Problems("configuration")
    read = [read_yaml(path, problems) for path in files]
    origins, content = Origins(read), {}
    for file in read:
        content = laid_over(content, file.content)
    settings = validated(content, StudySettings, problems, origins)
    problems.raise_if_any()
    places = [Path(), *(parent for path in reversed(files) for parent in path.resolve().parents)]
    own = tuple(_first_found(file, places) for file in settings.improvement.effect_files)
    improvement = replace(settings.improvement, effect_files=own)

    def add(key: str, found: str, allowed: str) -> None:
        way = tuple(int(part) if part.isdecimal() else part for part in key.split("."))
        problems.add(origins.place(way), found, allowed)

    check_effects(improvement, Path(), add)
    problems.raise_if_any()
    return replace(settings, improvement=improvement)


def _first_found(file: str, folders: list[Path]) -> str:
    """Path of a file that is named relative to where the user is, or to a folder above the settings that name it."""
    return next((str(folder / file) for folder in folders if (folder / file).is_file()), file)


def load_subject(path: Path) -> SubjectSettings:
    """Return the person of a subject file.

    Raises
    ------
    InputError
        As `load_settings`.
    """
    from lumbar.config.study import read_subject
    from lumbar.errors import Problems

    problems = Problems("subject")
    subject = read_subject(path, str(path), problems)
    problems.raise_if_any()
    return subject


def record_files(folder: Path) -> list[Path]:
    """Column files of a folder, by name.

    Raises
    ------
    InputError
        If there is no such folder, or no such file in it.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    files = [path for path in sorted(folder.iterdir()) if is_column_file(path)]
    if not files:
        raise InputError(f"{folder}: no recordings ({', '.join(COLUMN_ENDINGS)}, also with .gz)")
    return files


COLUMN_ENDINGS = (".csv", ".txt", ".mat")


def is_column_file(path: Path) -> bool:
    """Whether the name is that of a column file."""
    return path.is_file() and path.name.lower().removesuffix(".gz").endswith(COLUMN_ENDINGS)
