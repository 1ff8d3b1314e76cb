"""Seconds and memory of the main tasks, and how they grow with samples, records and lifters.

    python benchmarks/growth.py [--longest 5] [--only WORDS]

Prints a row per task; nothing is asserted, because machines differ. Sizes rise tenfold until a task takes longer than
``--longest`` seconds. A row has processor seconds, memory beyond what libraries and data hold, and the exponents of growth over
the last step.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

import one_thread  # noqa: F401 # isort: skip

import numpy as np
import pandas as pd

import lumbar
from lumbar.records.record import Channel, Record
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.tissue import ImprovementSettings, SurgeonSettings
from lumbar.twin.tissue_recordings import tissue_force

STEP_S = 0.02
PLAN = """
study: growth
twin: {{lifting: {{cohort: {{box_masses_kg: [23], groups: {{expert: {{persons: {0}}}, novice: {{persons: {0}}}}}}}}}}}
"""


def cost(task: Callable[[], object]) -> tuple[float, float]:
    """Processor seconds of a task in a process of its own, with those it starts, and MB beyond what it began with."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        status = 1
        try:
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            task()
            own, started = (
                resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
            )
            seconds = time.process_time() + started.ru_utime + started.ru_stime
            memory = max(own.ru_maxrss - before, started.ru_maxrss)
            os.write(write, f"{seconds} {memory / 1024}".encode())
            status = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(status)
    os.close(write)
    with os.fdopen(read) as stream:
        output = stream.read()
    if os.waitpid(child, 0)[1]:
        raise ChildProcessError("a task failed: see the error above")
    seconds, memory = map(float, output.split())
    return seconds, memory


def grow(
    name: str, prepare: Callable[[int], Callable[[], object]], sizes: Sequence[int], longest: float
) -> None:
    """Print the cost of a task at each size, up to the first that takes longest."""
    found: list[tuple[int, float, float]] = []
    prepare(sizes[0])()  # imports what it needs
    for size in sizes:
        task = prepare(size)
        found.append((size, *cost(task)))
        if found[-1][1] > longest:
            break
    costs = "  ".join(f"{size:.0e}: {seconds:.2f} s {memory:.0f} MB" for size, seconds, memory in found)
    print(
        f"{name:42} {costs}   exponents: time {exponent(found, 1)}, memory {exponent(found, 2)}", flush=True
    )


def exponent(rows: Sequence[tuple[int, float, float]], column: int) -> str:
    """Return the slope between the last two sizes in a log-log plot, or an empty text if a value is too small."""
    if len(rows) < 2:
        return "-"
    first, second = rows[-2][0], rows[-1][0]
    low, high = rows[-2][column], rows[-1][column]
    smallest = (0.02, 1.0)[column - 1]
    return f"{math.log(high / low) / math.log(second / first):.2f}" if min(low, high) > smallest else "-"


def tissue_test(samples: int, name: str = "train", seed: int = 1) -> Record:
    """Ten sines on a Kelvin–Boltzmann tissue, with noise."""
    rng = np.random.default_rng(seed)
    clock = STEP_S * np.arange(samples)
    position = sum(0.5 * np.sin(2 * np.pi * f * clock + rng.uniform(0, 6)) for f in rng.uniform(0.2, 5, 10))
    force = tissue_force(clock, position, 1.8, 0.9, 0.15, 0.0) + 0.01 * rng.standard_normal(samples)
    channels = {"input": Channel(position, "position", "mm"), "output": Channel(force, "force", "N")}
    return Record(name, clock, channels, source="growth")


def identified(samples: int, records: int) -> Callable[[], object]:
    """Identify all models on one record and test them on the others."""
    tests = [tissue_test(samples, f"test {number}", number + 2) for number in range(records)]
    return lambda: lumbar.identify([tissue_test(samples), *tests], "train")


def diagnosed(samples: int, records: int) -> Callable[[], object]:
    """Say what Kelvin–Boltzmann's model misses, one effect at most."""
    tests = [tissue_test(samples, f"test {number}", number + 2) for number in range(records)]
    settings = StudySettings(improvement=ImprovementSettings(most_effects=1))
    return lambda: lumbar.diagnose(
        [tissue_test(samples), *tests], base="KB", train="train", settings=settings
    )


def spectra(samples: int, records: int) -> Callable[[], object]:
    """Bandwidth of the motion in records of four surgeons."""
    settings = SurgeonSettings()
    motion = [tissue_test(samples, f"trial {number}", number) for number in range(records)]
    trials = [Record(item.name, item.time, {"position": item.channels["input"]}) for item in motion]
    return lambda: lumbar.bandwidth(trials, [f"surgeon {n % 4}" for n in range(records)], settings=settings)


def files_read(folder: Path, samples: int, records: int) -> Callable[[], object]:
    """Read records from CSV files."""
    paths = [folder / f"{samples}_{number}.csv" for number in range(records)]
    for number, path in enumerate(paths):
        if not path.is_file():
            test = tissue_test(samples, seed=number)
            columns = {"time_s": test.time, "position_mm": test["input"], "force_N": test["output"]}
            pd.DataFrame(columns).round(6).to_csv(path, index=False)
    return lambda: lumbar.read(paths)


def planned(folder: Path, people: int) -> Callable[[], object]:
    """Build the graph of a cohort with three lifts a person, of which nothing is made yet."""
    from running import copy_project

    project = folder / "project"
    if not project.exists():
        copy_project(project)
    study = project / "growth.yaml"
    study.write_text(PLAN.format(max(1, people // 2)), encoding="utf-8")
    command = [sys.executable, "-m", "snakemake", "--dry-run", "--quiet", "all", "--cores", "2"]
    command += ["--configfile", "config/studies/cohort.yaml", str(study)]
    return lambda: subprocess.run(command, cwd=project, check=True, capture_output=True)


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--longest", type=float, default=5.0)
    parser.add_argument("--only", default="", help="words in the names of the tasks wanted")
    options = parser.parse_args()
    samples, records, people = [10**n for n in range(3, 7)], [1, 10, 100, 1000], [2, 20, 200, 1000]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for task, prepare, sizes in (
            ("samples: read a CSV file", lambda size: files_read(folder, size, 1), samples),
            ("samples: bandwidth of four trials", lambda size: spectra(size, 4), samples),
            ("samples: identify on one, test on one", lambda size: identified(size, 1), samples),
            ("samples: diagnose on one, test on one", lambda size: diagnosed(size, 1), samples),
            ("records of 1000: read CSV files", lambda size: files_read(folder, 1000, size), records),
            ("records of 1000: bandwidth", lambda size: spectra(1000, max(size, 4)), records),
            ("records of 1000: identify, test on them", lambda size: identified(1000, size), records),
            ("records of 1000: diagnose, test on them", lambda size: diagnosed(1000, size), records),
            ("lifters: plan of three lifts each", lambda size: planned(folder, size), people),
        ):
            if options.only in task:
                grow(task, prepare, sizes, options.longest)


if __name__ == "__main__":
    main()
