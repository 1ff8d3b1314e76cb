"""Answers of the diagnosis to records whose truth is known: what it says, or how it failed, and how long it took."""

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
    "tied": "the right answer is among those that are said to be indistinguishable",
    "part": "nothing false, but of the right answer something is not told",
    "flagged": "no answer, and it says so: unexplained, or incomplete",
    "WRONG": "confidently wrong: a false name, or said to be adequate or complete",
    "refused": "an error that says what to change",
    "crash": "an error that the library does not mean to raise",
}
RIGHT = ("right", "tied")
"""Judgements that count as right."""


def surprise(name: str, judgement: str, why: str, recorded: str) -> str:
    """Words for an answer to a case that is better or worse than recorded; empty where it is as recorded.

    `judgement` is a key of `JUDGEMENTS`, `recorded` today's judgement and reason where it is not right, empty where it is.
    """
    known = recorded.split(":")[0]
    if judgement in RIGHT:
        return f"{name} is {judgement} now: take it off what is not yet right ({recorded})" if known else ""
    if known and (judgement == "WRONG") == (known == "WRONG"):
        return ""
    return f"{name} was {recorded or 'right'}, and is {judgement} now: {why}"


SHARED = Path(os.environ.get("LUMBAR_SHARED", PROJECT.parent / "shared"))
"""Folder of recordings for tests: beside the project, or where LUMBAR_SHARED says."""


def absent(folder: Path, suite: str) -> str:
    """Words for a folder that is not there; empty where it is."""
    if folder.is_dir():
        return ""
    return f"no recordings in {folder}: get those of tests/{suite}/README.md, and set LUMBAR_SHARED to the folder above"


@dataclass(frozen=True)
class Answer:
    """What a diagnosis said of one set of records."""

    document: dict = field(default_factory=dict)
    """``diagnosis.json``, and under ``settled`` whether a tie comes with an experiment that settles it; empty without result."""
    refusal: str = ""
    crash: str = ""
    """Words of an error that the library means to raise, and of one that it does not."""
    seconds: float = 0.0
    """Wall clock of reading and diagnosing."""

    @property
    def verdict(self) -> str:
        return self.document.get("verdict", "")

    @property
    def selected(self) -> tuple[str, ...]:
        return tuple(self.document.get("selected", ()))

    @property
    def alternatives(self) -> set[str]:
        """Effects of the tied sets; what several together would replace stands in one entry, joined by ``+``."""
        return {name for entry in self.document.get("tied_with", ()) for name in entry.split("+")}

    @property
    def findings(self) -> list[str]:
        """Kinds of what is true of the records and is no physical effect."""
        return [item["kind"] for item in self.document.get("findings", ())]

    @property
    def unfinished(self) -> bool:
        """Whether it says of its own model that something is left."""
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
        words = f"{type(error).__name__} at {Path(last.filename).name}:{last.lineno}: {' '.join(str(error).split())}"
        return Answer(crash=words, seconds=time.perf_counter() - start)
