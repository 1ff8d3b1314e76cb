"""Time and memory per rule, from the benchmark files of a run."""

import csv
from collections.abc import Collection
from pathlib import Path


def timings(folder: Path) -> list[tuple[str, float, float, float]]:
    """Read every benchmark file below a folder: job, wall and processor seconds, peak memory in MB; slowest first."""
    rows = []
    for path in sorted(folder.rglob("*.tsv")):
        with path.open(encoding="utf-8", newline="") as stream:
            for row in csv.DictReader(stream, delimiter="\t"):
                name = str(path.relative_to(folder).with_suffix(""))
                rows.append((name, *(_number(row[key]) for key in ("s", "cpu_time", "max_rss"))))
    return sorted(rows, key=lambda row: -row[1])


def _number(text: str) -> float:
    """Snakemake writes a dash for a job too short to be sampled."""
    try:
        return float(text)
    except ValueError:
        return 0.0


def summary(folder: Path, names: Collection[str]) -> str:
    """Return the timings of these jobs as text, with their sums and the largest memory."""
    rows = [row for row in timings(folder) if row[0] in names]
    if not rows:
        return ""
    width = max(len(row[0]) for row in rows)
    lines = [f"{'job':{width}}  wall s   CPU s  peak MB"]
    lines += [f"{name:{width}}  {wall:6.1f}  {cpu:6.1f}  {memory:7.0f}" for name, wall, cpu, memory in rows]
    total = [sum(row[column] for row in rows) for column in (1, 2)]
    lines.append(
        f"{'sum (largest memory)':{width}}  {total[0]:6.1f}  {total[1]:6.1f}  {max(row[3] for row in rows):7.0f}"
    )
    return "\n".join(lines)
