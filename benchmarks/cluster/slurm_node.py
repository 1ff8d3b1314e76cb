"""A SLURM of one node on this machine, and calls of the workflow whose jobs go through it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
START = HERE / "start_slurm.sh"
PROGRAMS = ("slurmctld", "slurmd", "sbatch", "munged")
SOON = (
    *("--workflow-profile", "slurm", "--slurm-status-command", "squeue", "--latency-wait", "10"),
    *("--slurm-init-seconds-before-status-checks", "2", "--seconds-between-status-checks", "2"),
)
"""The profile as it is for a laboratory, but that a node without accounting is asked, and often."""


def obstacle() -> str | None:
    """Say what keeps jobs from going through SLURM here, if anything does."""
    if find_spec("snakemake_executor_plugin_slurm") is None:
        return "no SLURM plugin for Snakemake: make cluster"
    path = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin"])
    missing = [program for program in PROGRAMS if shutil.which(program, path=path) is None]
    packages = "slurmctld slurmd slurm-client munge"
    return f"not installed: {', '.join(missing)}; apt-get install {packages}" if missing else None


def wait_for(condition: Callable[[], object], what: str, seconds: float = 1800.0) -> object:
    """Return what a condition gives as soon as it is true; fail after so many seconds."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.1)
    raise TimeoutError(f"{what}: not seen within {seconds:g} s")


@dataclass
class Call:
    """A call of Snakemake under way."""

    process: subprocess.Popen
    output: Path

    @classmethod
    def begin(cls, folder: Path, arguments: Sequence[str], environment: dict[str, str], **how) -> Call:
        """Call Snakemake in a folder; `how` is for `subprocess.Popen`."""
        output = folder / f"called_{time.monotonic_ns()}.txt"
        with output.open("wb") as stream:
            command = [sys.executable, "-m", "snakemake", "--nocolor", *arguments]
            process = subprocess.Popen(
                command, cwd=folder, env=environment, stdout=stream, stderr=stream, **how
            )
        return cls(process, output)

    @property
    def text(self) -> str:
        """What it has said so far."""
        return self.output.read_text(encoding="utf-8")

    def end(self, seconds: float = 3600.0) -> int:
        """Wait for its end and return its status."""
        return self.process.wait(timeout=seconds)


@dataclass(frozen=True)
class Node:
    """The node, while it runs.

    Attributes
    ----------
    environment : dict of str to str
        Variables with which SLURM's commands find it.
    """

    environment: dict[str, str]

    def command(self, *arguments: str) -> str:
        """Call one of SLURM's commands and return what it prints."""
        done = subprocess.run(arguments, env=self.environment, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"{' '.join(arguments)}: {done.stderr}")
        return done.stdout

    def jobs(self, state: str) -> list[str]:
        """Numbers of the jobs in a state, e.g. ``RUNNING``."""
        return self.command("squeue", "--noheader", f"--states={state}", "--format=%i").split()

    def set_state(self, state: str) -> None:
        """Set the node to ``drain``, ``down`` or ``resume``."""
        name = self.command("sinfo", "--noheader", "--format=%n").strip()
        self.command("scontrol", "update", f"NodeName={name}", f"State={state}", "Reason=test")

    def processes(self, job: str) -> list[int]:
        """Processes of a job, the youngest last."""
        lines = self.command("scontrol", "listpids", job).splitlines()[1:]
        return sorted(int(line.split()[0]) for line in lines if int(line.split()[0]) > 0)

    def start(self, folder: Path, *arguments: str) -> Call:
        """Call Snakemake in a copy of the project, its jobs on the node; see `SOON`."""
        return Call.begin(folder, [*SOON, *arguments], self.environment)

    def run(self, folder: Path, *arguments: str) -> Call:
        """Call Snakemake and wait for its end."""
        call = self.start(folder, *arguments)
        call.end()
        return call


@contextmanager
def slurm_node(folder: Path, processors: int) -> Iterator[Node]:
    """Start a node with so many processors, its files in a folder, and stop it at the end."""
    done = subprocess.run(
        [START, folder, str(processors)], capture_output=True, text=True, check=False, timeout=600
    )
    if done.returncode != 0:
        raise RuntimeError(done.stderr)
    variables = dict(entry.split("=", 1) for entry in done.stdout.split()[1:])
    path = variables["PATH"].replace("$PATH", os.environ["PATH"])
    node = Node(os.environ | variables | {"PATH": path})
    try:
        yield node
    finally:
        subprocess.run(["scancel", "--me"], env=node.environment, check=False)
        subprocess.run([START, folder, "stop"], check=True)


def differing(one: Path, other: Path) -> list[str]:
    """Results of which two folders do not hold the same bytes; times, memory and versions are no results."""
    names = {
        path.relative_to(folder)
        for folder in (one, other)
        for path in folder.rglob("*")
        if path.is_file()
        and not {"logs", "benchmarks", "run_environment.json"} & set(path.relative_to(folder).parts)
    }
    return sorted(
        str(name)
        for name in names
        if not ((one / name).is_file() and (other / name).is_file())
        or (one / name).read_bytes() != (other / name).read_bytes()
    )
