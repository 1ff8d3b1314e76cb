"""The workflow through a real SLURM: same bytes as without, and what is killed is tried again.

    python benchmarks/cluster/run.py                          both studies and all faults; installs SLURM on Debian as root
    python benchmarks/cluster/run.py --only cohort node_lost  some of it
    python benchmarks/cluster/run.py --processors 1           of the node that is started

Prints what was done, how long it took and what differs; exits with 1 where something does.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
PROJECT = HERE.parents[1]
sys.path[:0] = [str(HERE.parent), str(PROJECT / "tests"), str(PROJECT / "workflow")]

from cluster.faults import CHAPTER, FAULTS, RESULTS, anew  # noqa: E402
from cluster.random_kills import OnSlurm, Series, met  # noqa: E402
from cluster.slurm_node import Node, differing, slurm_node  # noqa: E402
from running import PLAIN, copy_project, snakemake  # noqa: E402

SMALL_COHORT = """
twin: {lifting: {cohort: {box_masses_kg: [23], groups: {expert: {persons: 10}, novice: {persons: 10}}}}}
"""
KILLS = 6
STUDIES = {"thesis": (), "cohort": ("--configfile", "config/studies/cohort.yaml", "config/small_cohort.yaml")}


def project(folder: Path) -> Path:
    """Copy the project, with a cohort of twenty persons and three lifts each."""
    if not folder.exists():
        copy_project(folder)
        (folder / "config" / "small_cohort.yaml").write_text(SMALL_COHORT, encoding="utf-8")
    return folder


def locally(folder: Path, *arguments: str) -> None:
    """Run without SLURM."""
    run = snakemake(folder, "--cores", "1", *arguments, program=PLAIN)
    if run.status != 0:
        raise AssertionError(run.text[-4000:])


def study(node: Node, work: Path, name: str) -> list[str]:
    """Run a study with and without SLURM; return the files that differ."""
    folders = [project(work / "local"), project(work / "slurm")]
    locally(folders[0], *STUDIES[name])
    call = node.run(folders[1], *STUDIES[name])
    if call.process.returncode != 0:
        raise AssertionError(call.text[-4000:])
    print(f"{name}: {call.text.count('has been submitted with SLURM jobid')} jobs submitted", flush=True)
    return differing(*(folder / "results" / name for folder in folders))


def fault(node: Node, work: Path, meet) -> list[str]:
    """Run a chapter that meets with a fault; return the files that differ from those of an undisturbed run."""
    expected, folder = project(work / "undisturbed"), project(work / "disturbed")
    if not (expected / RESULTS).exists():
        locally(expected, CHAPTER)
    anew(folder)
    meet(node, folder)
    return differing(expected / RESULTS, folder / RESULTS)


def random_kills(node: Node, work: Path) -> list[str]:
    """kill -9 of any process of a run, also of those that SLURM has beside a job, at random moments."""
    series = Series.begun(OnSlurm(node, (CHAPTER,)), work / "random_kills")
    return met(series, range(1, KILLS + 1), KILLS, seed=1)


def main() -> int:
    """Do what is asked for and tell how it went."""
    parts = {name: lambda node, work, name=name: study(node, work, name) for name in STUDIES}
    parts |= {meet.__name__: lambda node, work, meet=meet: fault(node, work, meet) for meet in FAULTS}
    parts["random_kills"] = random_kills
    meanings = {"random_kills": random_kills.__doc__} | {meet.__name__: meet.__doc__ for meet in FAULTS}
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=list(parts), default=list(parts))
    parser.add_argument("--processors", type=int, default=os.cpu_count())
    parser.add_argument("--folder", type=Path, help="keep everything there, instead of in a temporary one")
    options = parser.parse_args()
    if find_spec("snakemake_executor_plugin_slurm") is None:
        parser.error(
            "no SLURM plugin for Snakemake in this Python: make cluster, then .venv/bin/python benchmarks/cluster/run.py"
        )
    failed = 0
    with tempfile.TemporaryDirectory(prefix="lumbar_slurm_") as name:
        work = (options.folder or Path(name)).resolve()
        with slurm_node(work / "node", options.processors) as node:
            for part in options.only:
                began = time.monotonic()
                try:
                    wrong = parts[part](node, work)
                except (AssertionError, TimeoutError, RuntimeError) as error:
                    wrong = [str(error)]
                failed += bool(wrong)
                told = "the same bytes" if not wrong else "FAILED: " + "\n".join(wrong[:20])
                print(f"{part} ({time.monotonic() - began:.0f} s): {told}", flush=True)
                if part in meanings:
                    print(f"    {meanings[part]}", flush=True)
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
