"""What the commands on a folder of tissue tests share: reading it, and which model and records are meant."""

from __future__ import annotations

import argparse
from pathlib import Path

from lumbar.cli.settings import record_files
from lumbar.errors import InputError


def add_selection(parser: argparse.ArgumentParser) -> None:
    """Add ``--base``, ``--train`` and ``--period``."""
    parser.add_argument(
        "--base", metavar="MODEL", help="base model: LE, Maxwell, KV or KB (default: the settings')"
    )
    parser.add_argument("--train", metavar="NAME", help="record to fit on (default: the longest)")
    parser.add_argument(
        "--period",
        action="append",
        default=[],
        metavar="NAME=SECONDS",
        help="period of a record's excitation (default: found from the input)",
    )


def read_folder(folder: Path, tissue: dict) -> list:
    """Read every column file of a folder as a record."""
    from lumbar.records.columns import read_record
    from lumbar.records.record import same_units

    records = [read_record(path, tissue["layout"], rate=tissue["rate_Hz"]) for path in record_files(folder)]
    same_units(records)
    return records


def selection(options, improvement: dict):
    """Return the `lumbar.improvement.diagnosis.Settings` of the options and the configuration."""
    from lumbar.improvement.diagnosis import Settings

    return Settings.from_config(
        improvement, base=options.base, train=options.train, periods=dict(map(_period, options.period))
    )


def _period(text: str) -> tuple[str, float]:
    name, _, seconds = text.partition("=")
    try:
        value = float(seconds)
    except ValueError:
        value = 0.0
    if not name or not 0 < value < float("inf"):
        raise InputError(f"--period {text!r}: NAME=SECONDS with positive seconds is needed")
    return name, value
