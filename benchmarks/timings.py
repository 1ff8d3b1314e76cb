"""Timings and memory: the default study from nothing, and the fits against simpler ways of doing the same.

    python benchmarks/timings.py

Prints a table; nothing is asserted, because machines differ. Each ratio compares two ways in the same process.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

PROJECT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(PROJECT / "tests"))
sys.path.insert(0, str(PROJECT / "workflow"))


def best_time(function: Callable[[], object], repeats: int = 5) -> float:
    """Shortest of several runs in seconds."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def default_study() -> None:
    """Run the complete default study on two cores with a filled compiler cache; print time and memory of every rule."""
    from running import copy_project

    with tempfile.TemporaryDirectory() as folder:
        project = copy_project(Path(folder))
        start = time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "snakemake", "--cores", "2", "--quiet"], cwd=project, check=True
        )
        wall = time.perf_counter() - start
        print(rules(project / "results" / "thesis" / "benchmarks"))
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print(f"default study from nothing: {wall:.1f} s wall on 2 cores, largest process {peak:.0f} MB")


def rules(folder: Path) -> str:
    """Return jobs, seconds and peak memory of every rule, from the benchmark files of a run."""
    parts = [
        pd.read_csv(path, sep="\t", na_values="-").assign(
            rule=path.relative_to(folder).with_suffix("").parts[0]
        )
        for path in sorted(folder.rglob("*.tsv"))
    ]
    groups = pd.concat(parts).groupby("rule")
    table = groups.agg(
        jobs=("s", "size"), wall_s=("s", "sum"), cpu_s=("cpu_time", "sum"), peak_MB=("max_rss", "max")
    ).sort_values("wall_s", ascending=False)
    table.loc["sum, or largest"] = [*table[["jobs", "wall_s", "cpu_s"]].sum(), table["peak_MB"].max()]
    return table.round(1).to_string()


def ridge_path() -> None:
    """One factorisation for the whole grid of ridge coefficients against one solve each."""
    from lumbar.tissue.identification.arx_search import RidgePath

    random = np.random.default_rng(1)
    regressors = random.standard_normal((10000, 9))
    target = regressors @ random.standard_normal(9) + random.standard_normal(10000)
    alphas = np.concatenate([[0.0], np.geomspace(1e-3, 100.0, 26)])

    def path():
        fitted = RidgePath.factorise(regressors, target, len(target))
        return [fitted.solution(alpha) for alpha in alphas]

    def solves():
        scale = np.sqrt(np.mean(regressors**2, axis=0))
        scaled = regressors / scale
        identity = np.eye(9)
        return [
            np.linalg.solve(scaled.T @ scaled + alpha**2 * identity, scaled.T @ target) for alpha in alphas
        ]

    one, many = best_time(path), best_time(solves)
    print(
        f"ridge path of {len(alphas)} coefficients: {1e3 * one:.1f} ms, one solve each {many / one:.1f} times as long"
    )


def diagnosis() -> None:
    """One blind diagnosis from the shell, start-up included."""
    import json

    from lumbar.settings.twin import TwinSettings
    from lumbar.twin.two_hidden_effects import two_hidden_effects, write_records

    with tempfile.TemporaryDirectory() as folder:
        records, output = Path(folder) / "records", Path(folder) / "out"
        twin = TwinSettings()
        write_records(records, two_hidden_effects(twin.two_hidden_effects, twin.seed))
        command = [sys.executable, "-c", "import sys; from lumbar.cli import main; sys.exit(main())"]
        command += ["diagnose", str(records), "--output", str(output)]
        seconds = best_time(lambda: subprocess.run(command, check=True, capture_output=True), repeats=3)
        verdict = json.loads((output / "diagnosis.json").read_text(encoding="utf-8"))
    print(
        f"diagnosis of two effects from the shell: {seconds:.1f} s, selected {', '.join(verdict['selected'])}"
    )


if __name__ == "__main__":
    ridge_path()
    diagnosis()
    default_study()
