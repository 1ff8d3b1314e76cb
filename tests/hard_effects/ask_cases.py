"""Diagnose the labelled hard cases and judge every answer: a line per case, totals per family, for the documentation too.

    python tests/hard_effects/ask_cases.py [--only f,g,a00] [--markdown docs/tissue/acceptance.md] [--json FILE]

The exit status is 1 if an answer is better or worse than recorded in ``not_yet.toml``.
"""

import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from case_judging import NOT_YET, ask_case, judge, read_labels

from acceptance_run import AcceptanceRun
from answers import JUDGEMENTS

FAMILIES = {
    "a": "weak effects",
    "b": "three or four effects at once",
    "c": "single shots, nothing repeats",
    "d": "coloured noise, hum, spikes, converters",
    "e": "faults of the position sensor and the clock",
    "f": "other linear tissues",
    "g": "contact: palpation, holds, cycles, needles",
    "i": "laws in no catalogue",
    "j": "pairs that the records do not distinguish",
    "k": "nothing hidden, under noise and faults",
}


def main() -> int:
    """Run the suite."""
    run = AcceptanceRun(__doc__, "hard_effects", "hard_effects")
    judged = []
    for case, label in run.wanted(read_labels(run.folder)).items():
        answer = ask_case(run.folder / case)
        judgement, why = judge(label, answer)
        truth = f"{label.tag}, hidden {'+'.join(label.hidden) or '-'}, fault {label.fault or '-'}"
        result = f"{answer.verdict}: {'+'.join(answer.selected) or '-'}, findings {', '.join(answer.findings) or '-'}"
        print(f"{case} {judgement:8} {truth} | {result} | {answer.seconds:.1f} s {why}", flush=True)
        judged.append((label.family, judgement))
        run.keep(case, answer, judgement, why, NOT_YET.get(case, ""))
    table = _table(judged)
    print(*table, sep="\n")
    return run.end("hard effects", table)


def _table(judged: list[tuple[str, str]]) -> list[str]:
    lines = [f"| family | cases | {' | '.join(JUDGEMENTS)} |", "|---" * (len(JUDGEMENTS) + 2) + "|"]
    for family, title in [*FAMILIES.items(), ("all", "")]:
        counts = Counter(judgement for member, judgement in judged if family in (member, "all"))
        numbers = " | ".join(str(counts[name] or "") for name in JUDGEMENTS)
        lines.append(f"| {family}{': ' if title else ''}{title} | {counts.total()} | {numbers} |")
    return lines


if __name__ == "__main__":
    sys.exit(main())
