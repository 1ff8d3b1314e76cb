"""Judgement of answers to labelled cases by the table of README.md."""

import json
import re
import tomllib
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import lumbar
from answers import Answer, ask
from lumbar.settings.study_settings import record_layout

FINDINGS = {
    "pos_noise": "position_noise",
    "pos_step": "quantisation",
    "jitter": "jitter",
    "skew": "clock_skew",
    "skew_ppm": "clock_skew",
    "lag": "lag",
    "silent_drop": "dropped_samples",
    "hold": "held_samples",
    "gap": "gap|dropped_samples",
    "force_zero": "force_(offset|zero)",
    "springpot": "linear",
}
"""Regular expression of the kind of finding that reports each fault."""
NOT_YET = tomllib.loads(Path(__file__).with_name("not_yet.toml").read_text("utf-8"))
"""Judgement and reason of the cases with wrong answers."""
MIN_VISIBLE = 0.25
"""Ratio of residual and noise of an effect that adds 3 % to the error; below it the base may be called adequate."""


@dataclass(frozen=True)
class Label:
    """Truth of one case, as in ``labels.json``."""

    family: str
    tag: str
    kind: str
    hidden: tuple[str, ...]
    fault: str
    allowed: tuple[str, ...]
    residual_over_noise: tuple[float, ...]
    noise_rms: float
    note: str

    @property
    def permitted(self) -> set[str]:
        """Names that are not wrong; in palpation contact may also be a part of the base."""
        contact = {"contact_loss"} if self.tag.startswith("palpation") else set()
        return {*self.hidden, *self.allowed, *contact}

    @property
    def other_tissue(self) -> bool:
        """True if the linear tissue has more branches than the base."""
        return self.fault == "springpot" or (self.family == "f" and bool(self.allowed))


def read_labels(folder: Path) -> dict[str, Label]:
    """Return the labels by case."""
    labels = json.loads((folder / "labels.json").read_text())
    return {name: Label(**labels[name]) for name in sorted(labels)}


def ask_case(folder: Path) -> Answer:
    """Diagnose one case, with its own settings if it has some."""
    return ask(partial(_read, folder))


def _read(folder: Path):
    config = folder / "config.yaml"
    settings = lumbar.load_settings(*([config] if config.exists() else []))
    layout, rate = record_layout(settings, settings.improvement.base)
    records = lumbar.read(folder / "records", layout=layout, rate=rate)
    return records, {"settings": settings}


def judge(label: Label, answer: Answer) -> tuple[str, str]:
    """Return the judgement of an answer (`answers.JUDGEMENTS`) and a short reason."""
    if answer.crash or answer.refusal:
        return ("crash", answer.crash) if answer.crash else ("refused", answer.refusal)
    if label.family == "i":  # a law outside the catalogue
        if answer.verdict != "unexplained" and not answer.unfinished:
            return "WRONG", "claims to have explained a law that no catalogue has"
        return ("right", "") if "proposed_law" in answer.findings else ("part", "no law is proposed")
    if label.kind == "tie":  # effects that the records cannot distinguish
        if answer.verdict == "tied" and set(label.hidden) <= {*answer.selected, *answer.alternatives}:
            return ("right", "") if answer.document["settled"] else ("part", "no experiment that settles it")
        judgement, why = _judge_names(label, answer)
        return judgement, why or "named without a tie"
    judgement, why = _judge_names(label, answer) if label.hidden else _judge_linear(label, answer)
    if judgement in ("right", "tied") and label.fault and not set(answer.selected) & set(label.allowed):
        reported = any(re.search(FINDINGS[label.fault], kind) for kind in answer.findings)
        return (judgement, why) if reported else ("part", f"{label.fault} is not reported")
    return judgement, why


def _judge_linear(label: Label, answer: Answer) -> tuple[str, str]:
    """Judge the answer to a linear tissue, perhaps with a fault of a sensor."""
    linear = any("linear" in kind for kind in answer.findings)
    false = sorted(set(answer.selected) - label.permitted)
    if answer.verdict == "unexplained":
        is_right = label.other_tissue and linear
        return ("right", "linear dynamics") if is_right else ("flagged", _unexplained(answer))
    if false:
        return "WRONG", f"accuses {', '.join(false)}"
    if label.other_tissue and answer.verdict == "adequate" and not linear:
        return "WRONG", "called adequate although the tissue has more branches"
    return "right", ""


def _judge_names(label: Label, answer: Answer) -> tuple[str, str]:
    """Judge the answer to one or several hidden effects."""
    hidden, selected = set(label.hidden), set(answer.selected)
    if answer.verdict == "adequate":
        weak = max(label.residual_over_noise) <= MIN_VISIBLE
        return ("flagged", "weaker than can be seen") if weak else ("WRONG", "called adequate")
    if answer.verdict == "unexplained":
        return "flagged", _unexplained(answer)
    if answer.verdict == "tied" and hidden <= selected | answer.alternatives:
        return "tied", ""
    if selected - label.permitted:
        return "WRONG", f"names {', '.join(sorted(selected - label.permitted))}"
    missed = ", ".join(sorted(hidden - selected))
    if missed and answer.unfinished:
        return ("right" if label.family == "b" else "flagged"), f"misses {missed}, says incomplete"
    return ("WRONG", f"misses {missed}") if missed else ("right", "")


def _unexplained(answer: Answer) -> str:
    candidate = f", best candidate {', '.join(answer.selected)}" if answer.selected else ""
    return f"unexplained{candidate}"
