"""Judgement of answers to labelled protocols by the rules of README.md."""

import json
import tomllib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import lumbar
from answers import Answer, ask
from lumbar.settings.study_settings import record_layout

NOT_YET = tomllib.loads(Path(__file__).with_name("not_yet.toml").read_text("utf-8"))
"""Judgement and reason of the cases with wrong answers."""
_TWO_LEVELS = ("two-level signal", "binary_of_other_clocks")
_ONE_HOLD = ("one relaxation test",)


@dataclass(frozen=True)
class Label:
    """Truth of one case."""

    protocol: str
    hidden: tuple[str, ...]
    forward: bool

    @property
    def may_decline(self) -> bool:
        """True if the records cannot show what is hidden, so that no name is right."""
        name = self.protocol.split(",")[0]
        nonlinear = {"hardening_stiffness", "hysteresis", "coulomb_friction"} & set(self.hidden)
        return name in _ONE_HOLD or (name in _TWO_LEVELS and bool(nonlinear))


def read_labels(folder: Path) -> dict[str, Label]:
    """Return the labels by case."""
    labels = json.loads((folder / "labels.json").read_text())
    return {
        name: Label(item["protocol"], tuple(item["hidden"]), "--forward" in item["args"])
        for name, item in sorted(labels.items())
    }


def ask_case(folder: Path, label: Label) -> Answer:
    """Diagnose the records of one case."""
    return ask(partial(_read, folder, label.forward))


def _read(folder: Path, forward: bool):
    settings = lumbar.StudySettings(improvement=lumbar.ImprovementSettings(forward=forward))
    layout, rate = record_layout(settings, settings.improvement.base)
    return lumbar.read(folder / "records", layout=layout, rate=rate), {"settings": settings}


def judge(label: Label, answer: Answer) -> tuple[str, str]:
    """Return the judgement of an answer (`answers.JUDGEMENTS`) and a short reason."""
    if answer.crash or answer.refusal:
        return ("crash", answer.crash) if answer.crash else ("refused", answer.refusal)
    hidden, selected, verdict = set(label.hidden), set(answer.selected), answer.verdict
    why = f"{verdict}: {'+'.join(answer.selected) or '-'}"
    if answer.alternatives:
        why += f" (tied with {', '.join(sorted(answer.alternatives))})"
    if verdict != "unexplained":
        if selected == hidden:
            return "right", ""
        if verdict == "tied" and hidden and hidden <= selected | answer.alternatives:
            return "tied", ""
    if (
        label.may_decline
        and not selected - hidden
        and (verdict != "adequate" or label.protocol.split(",")[0] in _TWO_LEVELS)
    ):
        return "right", "declined"
    return ("flagged", why) if verdict == "unexplained" else ("WRONG", why)


def tabulate(judged: Sequence[tuple[str, str]]) -> list[str]:
    """Return a table of the number of right answers and of every other judgement, by protocol."""
    lines = ["| protocol | cases | right | others |", "|---|---|---|---|"]
    for name in [*dict.fromkeys(protocol for protocol, _ in judged), "all"]:
        counts = Counter(judgement for protocol, judgement in judged if name in (protocol, "all"))
        right = counts.pop("right", 0) + counts.pop("tied", 0)
        others = ", ".join(f"{count} {judgement}" for judgement, count in counts.items())
        lines.append(f"| {name} | {right + counts.total()} | {right} | {others} |")
    return lines
