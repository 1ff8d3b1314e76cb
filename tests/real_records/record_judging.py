"""What is known of the public data sets, and whether an answer agrees with it."""

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from answers import Answer
from lumbar.records.record import Record

SHEET = Path(__file__).with_name("expectations.toml")
WITHIN = 1.2
"""Error, in errors of the best published model, up to which a model counts as as good."""


@dataclass(frozen=True)
class Expectation:
    """One entry of ``expectations.toml``, whose head explains the fields."""

    title: str
    truth: str
    missing: tuple[str, ...]
    unit: str
    model: str
    allowed: tuple[str, ...] = ()
    scale: float = 1.0
    linear_rms: dict[str, float] = field(default_factory=dict)
    best_rms: dict[str, float] = field(default_factory=dict)
    linear_nrmse_percent: dict[str, float] = field(default_factory=dict)
    best_nrmse_percent: dict[str, float] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    outside: bool = False
    not_yet: str = ""

    def published(self, which: str, records: Sequence[Record]) -> float:
        """Published error of the ``linear`` or the ``best`` model in `unit`, over all unseen records together."""
        by_name = {record.name: record for record in records}
        errors = getattr(self, f"{which}_rms") or {
            name: percent / 100 * float(np.std(by_name[name]["output"])) / self.scale
            for name, percent in getattr(self, f"{which}_nrmse_percent").items()
        }
        weights = [len(by_name[name]) for name in errors]
        return self.scale * float(np.sqrt(np.average(np.square(list(errors.values())), weights=weights)))


def expectations() -> dict[str, Expectation]:
    """The sheet, by entry."""
    return {name: Expectation(**entry) for name, entry in tomllib.loads(SHEET.read_text("utf-8")).items()}


def judge(expected: Expectation, best: float, answer: Answer) -> tuple[str, str]:
    """Judgement of an answer (`answers.JUDGEMENTS`) and why; `best` is the best published model's error, in its unit."""
    if answer.crash or answer.refusal:
        return ("crash", answer.crash) if answer.crash else ("refused", answer.refusal)
    if answer.verdict == "adequate":
        return "WRONG", "says that nothing is missing"
    if answer.verdict == "unexplained":
        return ("right", "") if expected.outside else ("flagged", "unexplained")
    told = {*answer.selected, *(answer.alternatives if answer.verdict == "tied" else ()), *answer.findings}
    missed = [name for name in expected.missing if not _among(name, told)]
    false = [
        name
        for name in answer.selected
        if not any(re.fullmatch(it, name) for it in (*expected.missing, *expected.allowed))
    ]
    if false and (missed or answer.verdict == "named"):
        return "WRONG", f"names {', '.join(false)}"
    if missed:
        return ("flagged" if answer.unfinished else "WRONG"), f"misses {', '.join(missed)}"
    excluded = [
        name
        for name, (_, low, high, published) in parameters(expected, answer).items()
        if not low <= published <= high
    ]
    lacking = [f"interval of {name} excludes the published value" for name in excluded]
    if answer.errors[1] > WITHIN * best:
        lacking.append(f"error {answer.errors[1] / best:.2g} × the best published one")
    if lacking:
        return "part", ", ".join(lacking)
    return ("tied" if answer.verdict == "tied" else "right"), ""


def parameters(expected: Expectation, answer: Answer) -> dict[str, tuple[float, float, float, float]]:
    """Value, low, high and published value of those published parameters that the selected model has."""
    if not answer.document.get("ranking"):
        return {}
    found = answer.document["ranking"][0]["parameters"]
    return {
        name: (found[name]["value"], found[name]["low"], found[name]["high"], published)
        for name, published in expected.parameters.items()
        if name in found
    }


def _among(pattern: str, names: set[str]) -> bool:
    return any(re.fullmatch(pattern, name) for name in names)
