"""Diagnose the labelled hard cases and judge every answer: a line per case, totals per family, for the documentation too.

    python tests/hard_effects/ask_cases.py [--only f,g,a00] [--markdown docs/tissue/acceptance.md] [--json FILE]

Ends with status 1 where an answer is not what ``not_yet.toml`` says that it is today, for better or worse.
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
        truth = f"{label.tag}, hidden {'+'.join(label.hidden) or '-'}" + (
            f", fault {label.fault}" if label.fault else ""
        )
        told = f"{answer.verdict}: {'+'.join(answer.selected) or '-'}, findings {', '.join(answer.findings) or '-'}"
        print(f"{case} {judgement:8} {truth} | {told} | {answer.seconds:.1f} s {why}", flush=True)
        judged.append((label.family, judgement))
        run.keep(case, answer, judgement, why, NOT_YET.get(case, ""))
    table = _table(judged)
    print(*table, sep="\n")
    return run.end("hard effects", table)


def _table(judged: list[tuple[str, str]]) -> list[str]:
    lines = [f"| family | cases | {' | '.join(JUDGEMENTS)} |", "|---" * (len(JUDGEMENTS) + 2) + "|"]
    for family, words in [*FAMILIES.items(), ("all", "")]:
        own = [item[1] for item in judged if family in (item[0], "all")]
        counts = Counter(own)
        numbers = " | ".join(str(counts[name] or "") for name in JUDGEMENTS)
        lines.append(f"| {family}{': ' if words else ''}{words} | {len(own)} | {numbers} |")
    return lines


if __name__ == "__main__":
    sys.exit(main())
