"""kill -9 of a random process at random moments of a run on this machine: the next call ends with the same bytes.

    python benchmarks/cluster/random_kills.py                     20 kills of a coarse study with all chapters
    python benchmarks/cluster/random_kills.py --kills 3 --seed 7

The run's length is divided into as many parts as there are kills, and a moment drawn in each. After the kill a call is made as a
user makes it, who does what its message says. All results must then be those of a run that nothing disturbed, byte for byte,
but for logs and timings, whose names alone must be the same; no other file may lie among the results, no process may have
outlived Snakemake, and a further call must find nothing to do. Prints a line per kill; exits with 1 where something is wrong.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
PROJECT = HERE.parents[1]
sys.path[:0] = [str(HERE.parent), str(PROJECT / "tests"), str(PROJECT / "workflow")]

import psutil  # noqa: E402

from cluster.run_processes import drawn, kind, living, of_session, work  # noqa: E402
from cluster.slurm_node import Call, Node, differing, wait_for  # noqa: E402
from coarse_study import coarse_project  # noqa: E402
from running import NOT_INHERITED  # noqa: E402

RESULTS = Path("results") / "thesis"
SHORT = """
runtime: {compiler_cache: compiler}
lifting: {subjects: [expert]}
stability: {checks: [simulation]}
tissue: {training: [multisine]}
improvement:
  record_sets:
    - name: hip_moment
      base: pendulum
      records:
        - {name: paced, file: hip_moment/paced.csv}
        - {name: fast, file: hip_moment/fast.csv}
"""
"""Laid over the coarse study: less of everything, but all chapters, and a compiler's cache that is nobody else's."""
CONFIGURED = ("--configfile", "config/coarse.yaml", "config/short.yaml")
GRACE_S = 10.0
"""In which processes end whose Snakemake is gone."""
MOST_TRIES = 5
"""Of hitting a run before it ends, in the last part of its length."""


def project(folder: Path) -> Path:
    """Copy the project, with the study."""
    if not folder.exists():
        coarse_project(folder)
        (folder / "config" / "short.yaml").write_text(SHORT, encoding="utf-8")
    return folder


def anew(folder: Path) -> None:
    """Remove what earlier calls made."""
    for name in ("results", ".snakemake", "tmp"):
        shutil.rmtree(folder / name, ignore_errors=True)
    for said in folder.glob("called_*.txt"):
        said.unlink()


@dataclass(frozen=True)
class Here:
    """Runs of Snakemake that start their jobs themselves.

    Attributes
    ----------
    targets : tuple of str
        Of Snakemake; none is the whole study.
    """

    targets: tuple[str, ...] = ()

    def start(self, folder: Path, *arguments: str) -> Call:
        """Call Snakemake in a session of its own, with a folder for temporary files of its own."""
        environment = {key: value for key, value in os.environ.items() if key not in NOT_INHERITED}
        environment["TMPDIR"] = str(folder / "tmp")
        (folder / "tmp").mkdir(exist_ok=True)
        arguments = ("--cores", "2", *arguments, *CONFIGURED, "--", *self.targets)
        return Call.begin(folder, arguments, environment, start_new_session=True)

    def processes(self, call: Call) -> list[psutil.Process]:
        """All of a run."""
        return of_session(call.process.pid)

    def ended(self, call: Call) -> list[str]:
        """Wait for the end of a call, and a little for that of its processes; name those that live on."""
        call.end()
        end = time.monotonic() + GRACE_S
        while (left := self.processes(call)) and time.monotonic() < end:
            time.sleep(0.05)
        return [f"{kind(process, call.process.pid)} {work(process)} outlived Snakemake" for process in left]


@dataclass(frozen=True)
class OnSlurm:
    """Runs whose jobs go through a SLURM of this machine.

    Attributes
    ----------
    node : Node
    targets : tuple of str
    """

    node: Node
    targets: tuple[str, ...]

    def start(self, folder: Path, *arguments: str) -> Call:
        """As `Here.start`."""
        return self.node.start(folder, *arguments, *CONFIGURED, "--", *self.targets)

    def processes(self, call: Call) -> list[psutil.Process]:
        """The Snakemake that submits, the processes of its jobs, and SLURM's own beside those."""
        jobs = {number for job in self.node.jobs("RUNNING") for number in self.node.processes(job)}
        parents = [parent for process in living(jobs) if (parent := process.parent()) is not None]
        beside = {process.pid for process in parents if process.name() == "slurmstepd"}
        return living({call.process.pid, *jobs, *beside})

    def ended(self, call: Call) -> list[str]:
        """Wait for the end of a call; what a killed one submitted is cancelled, as the user is told to."""
        call.end()
        for name in set(re.findall(r"SLURM run ID: (\S+)", call.text)):
            self.node.command("scancel", f"--name={name}")
        wait_for(lambda: not self.node.jobs("RUNNING,COMPLETING"), "the end of the cancelled jobs")
        return []


def lines_of(call: Call) -> int:
    """How many lines a call has said."""
    return call.output.read_bytes().count(b"\n")


@dataclass
class Course:
    """When the lines of a run were said: a moment is so many lines and seconds, whatever else the machine does.

    Attributes
    ----------
    said_s : list of float
        Time of each line.
    length_s : float
    """

    said_s: list[float]
    length_s: float

    @classmethod
    def of(cls, call: Call) -> Course:
        """Follow a call to its end."""
        began, said = time.monotonic(), []
        while True:
            ended = call.process.poll() is not None
            now = time.monotonic() - began
            said += [now] * (lines_of(call) - len(said))
            if ended:
                return cls(said, now)
            time.sleep(0.02)

    def moment(self, seconds: float) -> tuple[int, float]:
        """Number of lines said until then, and seconds since the last."""
        lines = bisect_right(self.said_s, seconds)
        return lines, seconds - (self.said_s[lines - 1] if lines else 0.0)


def until(call: Call, lines: int, seconds: float) -> None:
    """Wait for a moment, or for the end of the call."""
    while lines_of(call) < lines and call.process.poll() is None:
        time.sleep(0.005)
    end = time.monotonic() + seconds
    while time.monotonic() < end and call.process.poll() is None:
        time.sleep(0.005)


def everything_below(folder: Path) -> set[str]:
    """All files and folders, hidden ones too."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


@dataclass(frozen=True)
class Series:
    """Kills of a study, each followed by what a user does, and compared with the study left alone.

    Attributes
    ----------
    place : Here or OnSlurm
    expected : Path
        Folder of the undisturbed run.
    course : Course
        Of that run.
    folder : Path
        Where runs are killed.
    """

    place: Here | OnSlurm
    expected: Path
    course: Course
    folder: Path

    @classmethod
    def begun(cls, place: Here | OnSlurm, folder: Path) -> Series:
        """Run twice undisturbed, so that the compiler's cache and bytecode are there; the second is the one to compare with."""
        expected, disturbed = (project(folder / name) for name in ("undisturbed", "disturbed"))
        for _ in range(2):
            anew(expected)
            course = Course.of(call := place.start(expected))
            if call.process.returncode:
                raise AssertionError(call.text[-4000:])
        return cls(place, expected, course, disturbed)

    def run(self, *arguments: str) -> Call:
        """Call Snakemake and wait for its end."""
        call = self.place.start(self.folder, *arguments)
        call.end()
        return call

    def met(self, number: int, kills: int, seed: int) -> list[str]:
        """Kill in this part of the length, go on as a user does, print a line; return what is wrong."""
        draw = random.Random(f"{seed} {number}")
        call, moment, killed = self.kill(((number - 1) / kills, number / kills), draw)
        outlived = self.place.ended(call)
        status = call.process.returncode
        told, wrong = self.as_told()
        differ = differing(self.expected / RESULTS, self.folder / RESULTS)
        said = f"status {status:3}; then {told:22}  {len(differ)} differ"
        print(f"{number:3}  {moment:26}  {killed:42}  {said}", flush=True)
        return [*outlived, *wrong, *(f"{name} differs" for name in differ), *self.left()]

    def kill(self, part: tuple[float, float], draw: random.Random) -> tuple[Call, str, str]:
        """Run anew and kill at a moment within a part of the length; return call, moment and what was killed.

        Raises
        ------
        AssertionError
            Every run ended before.
        """
        for _ in range(MOST_TRIES):
            anew(self.folder)
            share = draw.uniform(*part)
            lines, later = self.course.moment(share * self.course.length_s)
            call = self.place.start(self.folder)
            until(call, lines, later)
            name, processes = drawn(self.place.processes(call), call.process.pid, draw)
            for process in processes:
                with contextlib.suppress(psutil.NoSuchProcess):
                    process.kill()
            if name and call.process.poll() in (None, -signal.SIGKILL):
                return call, f"{100 * share:.0f} %, line {lines} + {later:.2f} s", name
            self.place.ended(call)
        raise AssertionError(f"{MOST_TRIES} runs ended before the moment of the kill")

    def as_told(self) -> tuple[str, list[str]]:
        """Call again and do what is said; return what that was, and what is wrong."""
        done, again = [], self.run()
        if again.process.returncode and "--unlock" in again.text:
            done.append("--unlock")
            if self.run("--unlock").process.returncode:
                return "--unlock", ["--unlock failed"]
            again = self.run()
        if again.process.returncode:
            return ", ".join([*done, "failed"]), [again.text[-4000:]]
        jobs = re.search(r"^total +(\d+)$", again.text, flags=re.M)
        return ", ".join([*done, f"{jobs[1]} jobs" if jobs else "nothing to do"]), []

    def left(self) -> list[str]:
        """What is not as after the undisturbed run, beside the bytes: names, and what a further call would do."""
        names = everything_below(self.folder / RESULTS) ^ everything_below(self.expected / RESULTS)
        wrong = [f"{name}: only in one of the folders" for name in sorted(names)]
        last = self.run("--dry-run")
        if "Nothing to be done" not in last.text:
            wrong.append(f"a call after that makes something anew:\n{last.text[-2000:]}")
        return wrong


def met(series: Series, numbers: Iterable[int], kills: int, seed: int) -> list[str]:
    """Kill so often and tell how it went; return what is wrong, each with the number of its kill."""
    print(f"undisturbed: {series.course.length_s:.0f} s; kills drawn with seed {seed}", flush=True)
    wrong = []
    for number in numbers:
        found = [f"{number}: {what}" for what in series.met(number, kills, seed)]
        print("".join(f"     WRONG {what}\n" for what in found), end="", flush=True)
        wrong += found
    return wrong


def main() -> int:
    """Kill as often as asked for; return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="+", help="numbers of the kills to do, of so many")
    parser.add_argument("--targets", nargs="+", default=[], help="of Snakemake, instead of the whole study")
    parser.add_argument("--folder", type=Path, help="keep everything there, instead of in a temporary one")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="lumbar_kills_") as name:
        series = Series.begun(Here(tuple(options.targets)), (options.folder or Path(name)).resolve())
        numbers = options.only or range(1, options.kills + 1)
        wrong = met(series, numbers, options.kills, options.seed)
    return min(len(wrong), 1)


if __name__ == "__main__":
    sys.exit(main())
