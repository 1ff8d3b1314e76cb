"""The frame of an acceptance suite's run: its options, the cases that are wanted, what is kept of each, and how it ends."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from acceptance_page import write_section
from answers import SHARED, Answer, absent, surprise
from lumbar.base.files import write_json


class AcceptanceRun:
    """One run of a suite (a folder of tests/); ends the process where the command line is wrong or the recordings are missing."""

    def __init__(self, description: str, suite: str, recordings: str):
        style = argparse.RawDescriptionHelpFormatter
        parser = argparse.ArgumentParser(description=description, formatter_class=style)
        names = "beginnings of names, separated by commas"
        parser.add_argument("--only", default="", metavar="NAMES", help=names)
        parser.add_argument("--json", type=Path, help="write every answer whole")
        parser.add_argument("--markdown", type=Path, help="renew the table of this page")
        options = parser.parse_args()
        self.only = tuple(name for name in options.only.split(",") if name)
        if self.only and options.markdown:
            parser.error("--markdown renews the whole table: not with --only")
        self.json, self.markdown = options.json, options.markdown
        self.folder = SHARED / recordings
        if words := absent(self.folder, suite):
            sys.exit(words)
        self.answers: dict[str, dict[str, Any]] = {}
        self.surprises: list[str] = []

    def wanted(self, cases: dict[str, Any]) -> dict[str, Any]:
        """Cases whose names begin as ``--only`` says; all without it."""
        found = {name: case for name, case in cases.items() if not self.only or name.startswith(self.only)}
        if not found:
            sys.exit(f"--only {','.join(self.only)}: no such case; there are {', '.join(cases)}")
        return found

    def keep(self, name: str, answer: Answer, judgement: str, why: str, recorded: str) -> None:
        """Keep a judged answer, and whether it is as recorded (`surprise`)."""
        verdict = {"judgement": judgement, "why": why, "seconds": answer.seconds}
        self.answers[name] = {**verdict, **answer.document}
        if words := surprise(name, judgement, why, recorded):
            self.surprises.append(words)
        if self.json:
            write_json(self.json, self.answers)

    def end(self, section: str, table: Sequence[str]) -> int:
        """Renew the section of the page, tell what is not as recorded, and return the exit status."""
        if self.markdown:
            write_section(self.markdown, section, table)
        for words in self.surprises:
            print(words)
        return int(bool(self.surprises))
