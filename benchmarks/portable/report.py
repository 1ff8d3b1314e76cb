"""The tables of `make test-portable`: exit statuses, and what agrees to how many digits."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from pathlib import Path

import pandas as pd

from portable.outputs import DIFFERENT, SAME_BYTES, compare_folders
from portable.runs import CENTRE, Run

STEPS = {"unit": "unit tests", "study": "`make`, `make check-results`", "blind": "blind cases"}
KINDS = {"kernels, threads": ("kernel", "threads"), "Pythons, dependencies": ("python", "dependencies")}


def report(output: Path, runs: list[Run]) -> int:
    """Print and write the tables over all runs that were made; return the exit status."""
    folders = {run.name: output / run.name.replace(" ", "_").replace("'", "") for run in runs}
    records = {
        run.name: json.loads((folders[run.name] / "record.json").read_text(encoding="utf-8"))
        for run in runs
        if (folders[run.name] / "record.json").is_file()
    }
    lines = ["| run | kernel used | " + " | ".join(STEPS.values()) + " |", "|---|---|" + "---|" * len(STEPS)]
    bad = False
    for run in runs:
        if run.name not in records:
            lines.append(f"| {run.name} | {run.obstacle or 'not asked for'} |" + " |" * len(STEPS))
            continue
        record, cells = records[run.name], []
        for step in STEPS:
            made = record["steps"].get(step)
            cells.append("" if made is None else f"{made['status']}: {made['summary']}, {made['s']} s")
            bad |= made is not None and made["status"] != 0
        lines.append(f"| {run.name} | {record['used']} | " + " | ".join(cells) + " |")
    others = [run for run in runs if run.name in records and run.name != CENTRE]
    if CENTRE in records:
        answers = [
            text for run in others for text in other_answers(folders[CENTRE], folders[run.name], run.name)
        ]
        bad |= bool(answers)
        lines += ["", *(answers or [f'Every claim and every verdict is that of the run "{CENTRE}".'])]
        lines += ["", *agreement(folders, others)]
    text = "\n".join(lines) + "\n"
    (output / "report.md").write_text(text, encoding="utf-8")
    print(text)
    return int(bad)


def other_answers(centre: Path, folder: Path, name: str) -> list[str]:
    """Return a sentence for every claim and every blind verdict that is not the centre's."""
    found = []
    claims = [path / "project" / "results" / "thesis" / "claims.csv" for path in (centre, folder)]
    if all(path.is_file() for path in claims):
        one, other = (pd.read_csv(path).set_index("claim")["verdict"] for path in claims)
        found += [
            f'- {name}: claim {claim} is "{other.get(claim)}", not "{verdict}".'
            for claim, verdict in one.items()
            if other.get(claim) != verdict
        ]
    if (centre / "blind").is_dir() and (folder / "blind").is_dir():
        for path in sorted((centre / "blind").glob("*/diagnosis.json")):
            one, other = (_answer(item / "blind" / path.parent.name / path.name) for item in (centre, folder))
            if one != other:
                found.append(f"- {name}: {path.parent.name} is {other}, not {one}.")
    return found


def _answer(path: Path):
    if not path.is_file():
        return None
    content = json.loads(path.read_text(encoding="utf-8"))
    return content["verdict"], *content["selected"], *sorted(map(str, content["tied_with"]))


def agreement(folders: dict[str, Path], runs: list[Run]) -> list[str]:
    """Return the table of outputs: by folder and kind of file, how many are the same bytes, and the digits of the rest."""
    least: dict[str, dict[str, dict[str, float]]] = {}
    for title, kinds in KINDS.items():
        least[title] = defaultdict(dict)
        for run in runs:
            if run.kind not in kinds:
                continue
            for part in ("project/results/thesis", "blind"):
                if (folders[CENTRE] / part).is_dir() and (folders[run.name] / part).is_dir():
                    compared = compare_folders(folders[CENTRE] / part, folders[run.name] / part)
                    for name, value in compared.items():
                        group = _group(part, name)
                        before = least[title][group].get(name, SAME_BYTES)
                        least[title][group][name] = min(before, value)
    groups = sorted({group for table in least.values() for group in table})
    lines = ["| outputs | " + " | ".join(f"same bytes: {title} | the others" for title in KINDS) + " |"]
    lines.append("|---|" + "---|---|" * len(KINDS))
    for group in groups:
        cells = []
        for title in KINDS:
            files = least[title].get(group, {})
            same = sum(value == SAME_BYTES for value in files.values())
            cells += [f"{same} of {len(files)}" if files else "", _rest(files)]
        lines.append(f"| {group} | " + " | ".join(cells) + " |")
    return lines


def _group(part: str, name: str) -> str:
    top = "blind cases" if part == "blind" else Path(name).parts[0] if len(Path(name).parts) > 1 else ""
    return f"{top}/*{Path(name).suffix}".lstrip("/")


def _rest(files: dict[str, float]) -> str:
    """Say to how many digits the files that are not the same bytes agree, worst file first."""
    moved = {name: value for name, value in files.items() if value != SAME_BYTES}
    if not moved:
        return ""
    other = sorted(name for name, value in moved.items() if value == DIFFERENT)
    numbers = {name: value for name, value in moved.items() if value != DIFFERENT}
    said = []
    if numbers:
        worst = min(numbers, key=numbers.get)
        said.append(f"{math.floor(numbers[worst])} digits or more (least: {worst})")
    if other:
        said.append(f"{len(other)} other text or bytes ({other[0]}{', …' * (len(other) > 1)})")
    return "; ".join(said)
