"""What a run of the workflow prints at its end: results in a few lines, and the warnings of its logs in groups."""

import csv
from collections import Counter
from collections.abc import Iterable
from pathlib import Path


def summary(results: Path) -> list[str]:
    """Return the results of a study in at most five lines, from the files in its folder.

    The first line is the record set with the largest fall of the error in proportion; a chapter without results has no line.

    Parameters
    ----------
    results : path
        Folder of the study's results.
    """
    from lumbar.publishing.study_report.main_results import (
        find_clearest_diagnosis,
        format_fall,
        read_diagnoses,
    )

    diagnoses, clearest = read_diagnoses(results), find_clearest_diagnosis(results)
    lines = [f"{clearest[0]}: {clearest[1]['headline']}"] if clearest else []
    others = [name for name in diagnoses if not clearest or name != clearest[0]]
    if others:
        errors = (
            f"{name}: {diagnoses[name]['verdict']}, error {format_fall(diagnoses[name], ' to ')}"
            for name in others
        )
        lines.append("; ".join(errors))
    if claims := Counter(row["verdict"] for row in _rows(results / "claims.csv")):
        counted = ", ".join(f"{verdict} {number}" for verdict, number in sorted(claims.items()))
        lines.append(f"{claims.total()} claims of the thesis: {counted}")
    basins, failures = _rows(results / "stability/boa.csv"), _rows(results / "stability/failures.csv")
    if basins or failures:
        lines.append(f"{len(basins)} basins of attraction computed, {len(failures)} not computed")
    if files := _rows(results / "runtime/fmu_check.csv"):
        good = [
            row
            for row in files
            if row["schema_problems"] == "0" and float(row["relative_error"]) <= float(row["tolerance"])
        ]
        late = sum(row["feedthrough"] == "one sample late" for row in files)
        remark = f"; {late} in FMI 2.0 give the force one sample late" if late else ""
        lines.append(f"{len(good)} of {len(files)} FMUs pass their checks{remark}")
    return lines


def grouped_warnings(logs: Iterable[str]) -> list[str]:
    """Return one line per warning of log files: its first line, and where the rest of it is.

    Parameters
    ----------
    logs : iterable of str
        Paths of the log files; a warning begins with ``WARNING``, its further lines are indented.
    """
    counts: Counter[tuple[str, Path]] = Counter()
    for log in map(Path, logs):
        heading = ""
        for line in log.read_text(encoding="utf-8").splitlines() if log.is_file() else ():
            heading = line if line.startswith("WARNING") else heading if line.startswith(" ") else ""
            if heading:
                counts[heading, log] += 1
    return [
        f"{heading.rstrip(':')}{f', {number - 1} more lines' if number > 1 else ''} ({log})"
        for (heading, log), number in counts.items()
    ]


def _rows(path: Path) -> list[dict[str, str]]:
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
