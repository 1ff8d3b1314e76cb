"""Diagnose the labelled hard cases and judge every answer: a line per case, totals per family, a page for the documentation.

    python tests/hard_effects/ask_cases.py [--only f,g,a00] [--markdown docs/tissue/acceptance.md] [--json FILE]

Ends with status 1 where an answer is not what ``not_yet.toml`` says that it is today, for better or worse.
"""

import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from case_judging import NOT_YET, Label, ask_case, judge, read_labels

from acceptance_run import AcceptanceRun
from answers import JUDGEMENTS, Answer

FAMILIES = {
    "a": "weak effects",
    "b": "three or four effects at once",
    "c": "single shots, nothing repeats",
    "d": "coloured noise, hum, spikes, converters",
    "e": "faults of the position sensor and the clock",
    "f": "other linear tissues",
    "g": "contact: palpation, holds, cycles, needles",
    "i": "laws in no catalogue",
    "j": "pairs that the records cannot tell apart",
    "k": "nothing hidden, under noise and faults",
}


def main() -> int:
    """Run the suite."""
    run = AcceptanceRun(__doc__, "hard_effects", "hard_effects")
    judged = []
    for case, label in run.wanted(read_labels(run.folder)).items():
        answer = ask_case(run.folder / case)
        judgement, why = judge(label, answer)
        print(_line(case, label, answer, judgement, why), flush=True)
        judged.append((label.family, judgement, answer.seconds))
        run.keep(case, answer, judgement, why, NOT_YET.get(case, ""))
    print("\n" + _totals(judged))
    return run.end("hard effects", _table(judged))


def _line(case: str, label: Label, answer: Answer, judgement: str, why: str) -> str:
    truth = f"hidden {'+'.join(label.hidden) or '-'}" + (f", fault {label.fault}" if label.fault else "")
    cells = [f"{case} {judgement:8}", f"{label.tag[:44]:44}", truth]
    if answer.document:
        document = answer.document
        before, after = (error / label.noise_rms for error in answer.errors)
        cells += [
            f"{document['base']} {answer.verdict}: {'+'.join(answer.selected) or '-'}",
            f"complete {document['complete']}, after {document['verdict_after']}",
            f"ties {', '.join(document['tied_with']) or '-'}",
            f"findings {', '.join(answer.findings) or '-'}",
            f"{before:.2f} -> {after:.2f} noise",
        ]
    return " | ".join([*cells, f"{answer.seconds:.1f} s", *([why] if why else [])])


def _totals(judged: list[tuple[str, str, float]]) -> str:
    lines = ["family" + "".join(f"{name:>9}" for name in JUDGEMENTS) + "  seconds"]
    for family in [*sorted({item[0] for item in judged}), "all"]:
        own = [item for item in judged if family in (item[0], "all")]
        counts = Counter(item[1] for item in own)
        lines.append(
            f"{family:6}"
            + "".join(f"{counts[name]:9}" for name in JUDGEMENTS)
            + f"{sum(item[2] for item in own):9.0f}"
        )
    return "\n".join(lines)


def _table(judged: list[tuple[str, str, float]]) -> list[str]:
    lines = [f"| family | cases | {' | '.join(JUDGEMENTS)} |", "|---" * (len(JUDGEMENTS) + 2) + "|"]
    for family, words in [*FAMILIES.items(), ("all", "")]:
        own = [item[1] for item in judged if family in (item[0], "all")]
        counts = Counter(own)
        numbers = " | ".join(str(counts[name] or "") for name in JUDGEMENTS)
        lines.append(f"| {family}{': ' if words else ''}{words} | {len(own)} | {numbers} |")
    return lines


if __name__ == "__main__":
    sys.exit(main())
