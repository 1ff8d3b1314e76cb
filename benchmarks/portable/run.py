"""Is the answer the same everywhere? Unit tests, default study and blind cases under each run of `runs.star`.

    python benchmarks/portable/run.py                          all of it, one after the other: hours
    python benchmarks/portable/run.py --only Prescott Haswell  some runs; the report adds them to those already made
    python benchmarks/portable/run.py --steps study            without unit tests and blind cases

Prints a table of exit statuses and one of what agrees to how many digits, and writes both to report.md in the
output folder. Exits with 1 where a step failed or an answer (a claim, a verdict) is another one.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
PROJECT = HERE.parents[1]
sys.path[:0] = [str(HERE.parent), str(PROJECT / "tests")]

from portable.environments import interpreter_of  # noqa: E402
from portable.report import report  # noqa: E402
from portable.runs import Run, star  # noqa: E402
from running import copy_project  # noqa: E402

STEPS = ("unit", "study", "blind")


def main() -> int:
    """Make the runs asked for, then the report over all that are there."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", nargs="*", metavar="RUN", help="names as --list gives them; none: report alone"
    )
    parser.add_argument("--steps", nargs="+", choices=STEPS, default=list(STEPS))
    parser.add_argument(
        "--python", nargs="+", type=Path, default=[], help="interpreters beside those on the PATH"
    )
    parser.add_argument("--output", type=Path, default=PROJECT / "results" / "portable")
    parser.add_argument(
        "--list", action="store_true", help="print the runs, and why some cannot be made here"
    )
    options = parser.parse_args()
    runs = star(options.python)
    unknown = set(options.only or ()) - {run.name for run in runs}
    if unknown:
        parser.error(f"no run {', '.join(sorted(unknown))}; there are {', '.join(run.name for run in runs)}")
    for run in runs:
        if options.list:
            print(run.name, f"(cannot be made: {run.obstacle})" if run.obstacle else "")
        elif options.only is None or run.name in options.only:
            make(run, options.output, options.steps)
    return 0 if options.list else report(options.output, runs)


def make(run: Run, output: Path, steps: list[str]) -> None:
    """Make one run and keep what it gave in ``<output>/<run>/record.json``."""
    if run.obstacle:
        print(f"{run.name}: skipped, {run.obstacle}", flush=True)
        return
    folder = output / run.name.replace(" ", "_").replace("'", "")
    folder.mkdir(parents=True, exist_ok=True)
    kept = folder / "record.json"
    record = json.loads(kept.read_text(encoding="utf-8")) if kept.is_file() else {"steps": {}}
    python = interpreter_of(run, output, folder / "install.log")
    environment = environment_of(run, python)
    probe = subprocess.run(
        [python, HERE / "probe.py"], env=environment, capture_output=True, text=True, check=True
    )
    record["used"] = probe.stdout.strip()
    for step in steps:
        started = time.monotonic()
        status, summary = globals()[f"{step}_step"](run, python, environment, folder)
        record["steps"][step] = {"status": status, "summary": summary, "s": round(time.monotonic() - started)}
        print(f"{run.name} ({record['used']}): {step}: {status}, {summary}", flush=True)
        kept.write_text(json.dumps(record, indent=1), encoding="utf-8")


def environment_of(run: Run, python: Path) -> dict[str, str]:
    """Return the variables of a run; nothing that a user has set for threads or kernels remains."""
    own = {
        name: value
        for name, value in os.environ.items()
        if not name.endswith("_NUM_THREADS") and name not in ("OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES")
    }
    own["PATH"] = os.pathsep.join([str(python.parent), own.get("PATH", "")])
    own["PYTHONPATH"] = str(PROJECT / "workflow")
    return {**own, "OPENBLAS_NUM_THREADS": str(run.threads), **run.variables}


def call(command: list, environment: dict[str, str], cwd: Path, log: Path) -> tuple[int, str]:
    """Run a command with its output in a file; return its exit status and the output."""
    with log.open("w", encoding="utf-8") as stream:
        status = subprocess.run(
            command, env=environment, cwd=cwd, stdout=stream, stderr=subprocess.STDOUT
        ).returncode
    return status, log.read_text(encoding="utf-8", errors="replace")


def unit_step(run: Run, python: Path, environment: dict[str, str], folder: Path) -> tuple[int, str]:
    """Run the unit tests."""
    command = [python, "-m", "pytest", "tests/unit", "-m", "not acceptance", "-q", "-p", "no:cacheprovider"]
    status, text = call(command, environment, PROJECT, folder / "unit.log")
    counts = re.findall(r"^.*\b(?:passed|failed|error)\b.* in .*$", text, flags=re.M)
    return status, counts[-1].strip("= ") if counts else "did not end"


def study_step(run: Run, python: Path, environment: dict[str, str], folder: Path) -> tuple[int, str]:
    """Run the default study in a copy of the project and compare it with the reference."""
    shutil.rmtree(folder / "project", ignore_errors=True)
    project = copy_project(folder / "project")
    environment = {name: value for name, value in environment.items() if name != "PYTHONPATH"}
    command = [python, "-m", "snakemake", "--nocolor", "--cores", "2"]
    if run.threads > 1:  # Snakemake gives a job's libraries as many threads as the rule has
        rules = subprocess.run(
            [python, "-m", "snakemake", "--list-rules"],
            env=environment,
            cwd=project,
            capture_output=True,
            text=True,
        ).stdout.split()
        command += ["--set-threads", *(f"{rule}={run.threads}" for rule in rules)]
    status, _ = call(command, environment, project, folder / "study.log")
    if status:
        return status, "the default study failed"
    check = [python, PROJECT / "tests" / "reference" / "check_results.py"]
    check += ["--results", project / "results" / "thesis"]
    status, text = call(check, environment, PROJECT, folder / "check_results.log")
    return status, text.splitlines()[-1]


def blind_step(run: Run, python: Path, environment: dict[str, str], folder: Path) -> tuple[int, str]:
    """Diagnose the blind cases."""
    cases = Path(os.environ.get("LUMBAR_SHARED", PROJECT.parent / "shared")) / "hidden_effects"
    if not cases.is_dir():
        return 0, f"not run: no blind cases in {cases} (set LUMBAR_SHARED)"
    shutil.rmtree(folder / "blind", ignore_errors=True)
    status, text = call(
        [python, HERE / "blind_cases.py", cases, folder / "blind"], environment, PROJECT, folder / "blind.log"
    )
    return status, text.splitlines()[-1]


if __name__ == "__main__":
    sys.exit(main())
