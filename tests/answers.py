"""Answers of the diagnosis to records with a known truth: its result or error, and the time it took."""

import os
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import lumbar
from lumbar.base.errors import InputError, NumericalError
from running import PROJECT

JUDGEMENTS = {
    "right": "the right answer, whole",
    "tied": "the right answer is among those that are reported as indistinguishable",
    "part": "nothing false, but a part of the right answer is missing",
    "flagged": "no answer, but reported as unexplained or incomplete",
    "WRONG": "confidently wrong: a false name, or reported as adequate or complete",
    "refused": "an input error or numerical error",
    "crash": "any other error",
}
RIGHT = ("right", "tied")
"""Judgements that count as right."""


def surprise(name: str, judgement: str, why: str, recorded: str) -> str:
    """Return a message if an answer is better or worse than recorded, else an empty text.

    `judgement` is a key of `JUDGEMENTS`; `recorded` is the known judgement and reason, empty if that is right.
    """
    known = recorded.split(":")[0]
    if judgement in RIGHT:
        return (
            f"{name} is {judgement} now: remove it from the list of wrong answers ({recorded})"
            if known
            else ""
        )
    if known and (judgement == "WRONG") == (known == "WRONG"):
        return ""
    return f"{name} was {recorded or 'right'}, and is {judgement} now: {why}"


SHARED = Path(os.environ.get("LUMBAR_SHARED", PROJECT.parent / "shared"))
"""Folder of recordings for tests: that of LUMBAR_SHARED, by default next to the project."""


def absent(folder: Path, suite: str) -> str:
    """Return a message if a folder does not exist, else an empty text."""
    if folder.is_dir():
        return ""
    return f"no recordings in {folder}: get those of tests/{suite}/README.md, and set LUMBAR_SHARED to the folder above"


@dataclass(frozen=True)
class Answer:
    """Answer of a diagnosis to one set of records."""

    document: dict = field(default_factory=dict)
    """``diagnosis.json``; ``settled`` is true if a tie comes with an experiment that settles it. Empty after an error."""
    refusal: str = ""
    """Message of an input error or numerical error."""
    crash: str = ""
    """Message of any other error."""
    seconds: float = 0.0
    """Wall-clock time of reading and diagnosing."""

    @property
    def verdict(self) -> str:
        return self.document.get("verdict", "")

    @property
    def selected(self) -> tuple[str, ...]:
        return tuple(self.document.get("selected", ()))

    @property
    def alternatives(self) -> set[str]:
        """Effects of the tied sets; an entry with ``+`` is a set of several effects."""
        return {name for entry in self.document.get("tied_with", ()) for name in entry.split("+")}

    @property
    def findings(self) -> list[str]:
        """Kinds of the findings, which are properties of the records."""
        return [item["kind"] for item in self.document.get("findings", ())]

    @property
    def unfinished(self) -> bool:
        """True if it reports that its own model is incomplete."""
        return self.document["complete"] is False or self.document["verdict_after"] != "adequate"

    @property
    def errors(self) -> tuple[float, float]:
        """Error on unseen records of the base, and of the refined model."""
        ladder = self.document["ladder"]
        return ladder[0]["test_rms"], ladder[-1]["test_rms"]


def ask(read: Callable[[], tuple[list, dict[str, Any]]]) -> Answer:
    """Diagnose what a function reads: records and keywords of `lumbar.diagnose`."""
    start = time.perf_counter()
    try:
        records, keywords = read()
        diagnosis = lumbar.diagnose(records, **keywords)
        document = diagnosis.result.to_json()
        seconds = time.perf_counter() - start
        if document["verdict"] == "tied":
            document["settled"] = diagnosis.evidence.separation is not None
        return Answer(document, seconds=seconds)
    except (InputError, NumericalError) as error:
        return Answer(refusal=" ".join(str(error).split()), seconds=time.perf_counter() - start)
    except Exception as error:  # a crash of one case is a result of the suite, not its end
        last = traceback.extract_tb(error.__traceback__)[-1]
        message = " ".join(str(error).split())
        crash = f"{type(error).__name__} at {Path(last.filename).name}:{last.lineno}: {message}"
        return Answer(crash=crash, seconds=time.perf_counter() - start)
