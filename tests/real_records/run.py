"""Diagnose the public data sets and compare with what is known: a table, and a page for the documentation.

    python tests/real_records/run.py [--only friction_damper,…] [--markdown docs/acceptance.md] [--json FILE]

Ends with status 1 where an answer is not what ``expectations.toml`` says that it is today, for better or worse.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from data_sets import READERS
from record_judging import expectations, judge, parameters

from acceptance_page import write_section
from answers import SHARED, absent, ask, surprise
from lumbar.diagnosis.selection.sentences import effects_text
from lumbar.files import write_json

HEAD = "| data | known to be missing | named | error, unseen: base → named | published: linear → best | judgement |"


def main() -> int:
    """Run the suite."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="data sets, separated by commas")
    parser.add_argument("--json", type=Path, help="write every answer whole")
    parser.add_argument("--markdown", type=Path, help="renew the table of this page")
    options = parser.parse_args()
    if options.only and options.markdown:
        parser.error("--markdown renews the whole table: not with --only")
    folder = SHARED / "real"
    if words := absent(folder, "real_records"):
        sys.exit(words)
    only = [name for name in options.only.split(",") if name]
    rows, answers, surprises = [], {}, []
    for name, expected in expectations().items():
        if only and not any(name.startswith(item) for item in only):
            continue
        answer = ask(partial(READERS[name], folder))
        records = READERS[name](folder)[0] if answer.document else []
        linear, best = (
            expected.published(which, records) if records else 0.0 for which in ("linear", "best")
        )
        judgement, why = judge(expected, best, answer)
        print(_text(name, expected, answer, linear, best, f"{judgement} {why}".strip()), flush=True)
        rows.append(_row(expected, answer, linear, best, f"{judgement}: {why}" if why else judgement))
        answers[name] = {"judgement": judgement, "why": why, "seconds": answer.seconds, **answer.document}
        surprises.append(surprise(name, judgement, why, expected.not_yet))
    if options.json:
        write_json(options.json, answers)
    if options.markdown:
        write_section(options.markdown, "real records", [HEAD, "|---|---|---|---|---|---|", *rows])
    print("\n".join(filter(None, surprises)))
    return int(any(surprises))


def _named(answer) -> str:
    if not answer.document:
        return "no result"
    names = effects_text(answer.selected) if answer.selected else "nothing"
    return f"{names} ({answer.verdict})"


def _errors(before: float, after: float) -> str:
    return f"{before:.3g} → {after:.3g}"


def _text(name, expected, answer, linear, best, judgement) -> str:
    lines = [f"{name}: {judgement}", f"  named       {_named(answer)}"]
    if answer.document:
        document = answer.document
        lines += [
            f"  base        {document['base']}, fitted to {document['train']}, complete {document['complete']}, after "
            f"{document['verdict_after']}; ties {', '.join(document['tied_with']) or '-'}; findings {answer.findings or '-'}",
            f"  error       {_errors(*answer.errors)} {expected.unit}, published {_errors(linear, best)}",
        ]
        lines += [
            f"  {item:11} {value:.4g} ({low:.4g} to {high:.4g}), published {published:g}"
            for item, (value, low, high, published) in parameters(expected, answer).items()
        ]
    return "\n".join([*lines, f"  seconds     {answer.seconds:.1f}"])


def _row(expected, answer, linear, best, judgement) -> str:
    errors = f"{_errors(*answer.errors)} {expected.unit}" if answer.document else "–"
    published = f"{_errors(linear, best)} {expected.unit}" if best else "–"
    cells = (
        expected.title,
        expected.truth,
        _named(answer),
        errors,
        published,
        judgement,
    )
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    sys.exit(main())
