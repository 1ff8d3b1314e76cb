"""Diagnose the public data sets and compare with what is known: a table, and a page for the documentation.

    python tests/real_records/ask_records.py [--only friction_damper,…] [--markdown docs/tissue/acceptance.md] [--json FILE]

Ends with status 1 where an answer is not what ``expectations.toml`` says that it is today, for better or worse.
"""

import sys
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from data_sets import READERS
from record_judging import expectations, judge, parameters

from acceptance_run import AcceptanceRun
from answers import ask
from lumbar.tissue.diagnosis.selection.sentences import effects_text

HEAD = "| data | known to be missing | named | error, unseen: base → named | published: linear → best | judgement |"


def main() -> int:
    """Run the suite."""
    run = AcceptanceRun(__doc__, "real_records", "real")
    rows = []
    for name, expected in run.wanted(expectations()).items():
        answer = ask(partial(READERS[name], run.folder))
        records = READERS[name](run.folder)[0] if answer.document else []
        linear, best = (
            expected.published(which, records) if records else 0.0 for which in ("linear", "best")
        )
        judgement, why = judge(expected, best, answer)
        rows.append(_row(expected, answer, linear, best, f"{judgement}: {why}" if why else judgement))
        print(f"{name}, {answer.seconds:.1f} s: {rows[-1]}", flush=True)
        for item, (value, low, high, published) in parameters(expected, answer).items():
            print(f"  {item} {value:.4g} ({low:.4g} to {high:.4g}), published {published:g}")
        run.keep(name, answer, judgement, why, expected.not_yet)
    return run.end("real records", [HEAD, "|---|---|---|---|---|---|", *rows])


def _named(answer) -> str:
    if not answer.document:
        return "no result"
    names = effects_text(answer.selected) if answer.selected else "nothing"
    return f"{names} ({answer.verdict})"


def _errors(before: float, after: float) -> str:
    return f"{before:.3g} → {after:.3g}"


def _row(expected, answer, linear, best, judgement) -> str:
    errors = f"{_errors(*answer.errors)} {expected.unit}" if answer.document else "–"
    published = f"{_errors(linear, best)} {expected.unit}" if best else "–"
    cells = (expected.title, expected.truth, _named(answer), errors, published, judgement)
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    sys.exit(main())
