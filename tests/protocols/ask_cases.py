"""Diagnose labelled protocols, recorded ones and ones made here, and judge every answer: a line per case and a table.

    python tests/protocols/ask_cases.py [--only o1,p07] [--made FOLDER] [--answers FILE]

Cases that begin with ``o`` are simulated by `simulated_protocols`; the others lie in ``protocols`` of LUMBAR_SHARED. The exit
status is 1 if an answer is better or worse than recorded in ``not_yet.toml``.
"""

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from protocol_judging import NOT_YET, Label, ask_case, judge, read_labels, tabulate
from simulated_protocols import draw_case, list_cases, write_case

from answers import SHARED, surprise
from lumbar.base.files import write_json


def main() -> int:
    """Run the suite."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", default="", metavar="NAMES", help="beginnings of names, separated by commas"
    )
    parser.add_argument("--made", type=Path, help="keep the simulated records in this folder")
    parser.add_argument("--answers", type=Path, help="write every answer whole")
    options = parser.parse_args()
    recorded = SHARED / "protocols"
    labels: dict[str, Label | None] = read_labels(recorded) if recorded.is_dir() else {}
    labels |= dict.fromkeys(list_cases())
    wanted = {
        name: label for name, label in labels.items() if name.startswith(tuple(options.only.split(",")))
    }
    judged, surprises, answers = [], [], {}
    with tempfile.TemporaryDirectory() as scratch:
        for name, label in wanted.items():
            folder = recorded / name
            if label is None:
                folder, label = make(options.made or Path(scratch), name)
            answer = ask_case(folder, label)
            judgement, why = judge(label, answer)
            truth = f"{label.protocol}, hidden {'+'.join(label.hidden) or '-'}"
            print(f"{name} {judgement:8} {truth} | {why} | {answer.seconds:.1f} s", flush=True)
            judged.append((label.protocol.split(",")[0], judgement))
            answers[name] = answer.document
            surprises += filter(None, [surprise(name, judgement, why, NOT_YET.get(name, ""))])
            if options.answers:
                write_json(options.answers, answers)
    print(*tabulate(judged), *surprises, sep="\n")
    return int(bool(surprises))


def make(parent: Path, name: str) -> tuple[Path, Label]:
    """Write the records of a simulated case; return its folder and label."""
    case = draw_case(*list_cases()[name])
    write_case(parent / name, case)
    return parent / name, Label(case.protocol, case.hidden, case.forward)


if __name__ == "__main__":
    sys.exit(main())
