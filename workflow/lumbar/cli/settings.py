"""Settings and options that the commands share."""

from __future__ import annotations

import argparse
from pathlib import Path

from lumbar.errors import InputError

PROJECT = Path(__file__).resolve().parents[3]
"""Folder of the project; its config/config.yaml holds the defaults."""


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
        help="settings laid over config/config.yaml (a study file); may be given several times",
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


def load_settings(files: list[Path], *sections: str) -> dict:
    """Return the configuration with `files` laid over the project's defaults, its `sections` checked.

    Raises
    ------
    InputError
        A file that is absent or no YAML mapping, and every wrong key of the sections.
    """
    from lumbar.config.schemas import check_sections

    defaults = PROJECT / "config" / "config.yaml"
    if not defaults.is_file():
        raise InputError(f"{defaults} is absent: lumbar takes its default settings from the project's folder")
    settings: dict = {}
    for path in [defaults, *files]:
        settings = _laid_over(settings, _read_mapping(path))
    check_sections(settings, sections, PROJECT)
    if "improvement" in sections:
        improvement = settings["improvement"]
        improvement["effect_files"] = [_here_or_in_project(file) for file in improvement["effect_files"]]
    return settings


def _here_or_in_project(file: str) -> str:
    """Path of a file that a study names relative to the project, or a user relative to the folder they are in."""
    return file if Path(file).exists() else str(PROJECT / file)


def read_subject(path: Path) -> dict:
    """Return the person of a subject file, checked.

    Raises
    ------
    InputError
        As `load_settings`.
    """
    from lumbar.config.schemas import check_sections

    content = _read_mapping(path)
    if "subject" not in content:
        raise InputError(f"{path}: no key 'subject'; config/subjects/expert.yaml shows what is needed")
    check_sections({"subject": content}, ["subject"], PROJECT)
    return content["subject"]


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


def _read_mapping(path: Path) -> dict:
    import yaml

    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not valid YAML ({error})") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds no settings; 'key: value' lines are needed")
    return content


def _laid_over(base: dict, upper: dict) -> dict:
    """Merge as Snakemake does: mappings merge, lists and scalars replace."""
    merged = dict(base)
    for key, value in upper.items():
        below = merged.get(key)
        merged[key] = (
            _laid_over(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
        )
    return merged
