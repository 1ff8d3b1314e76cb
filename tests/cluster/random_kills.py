"""kill -9 of a random process at random moments of a run on this machine: the next call ends with the same bytes.

    python tests/cluster/random_kills.py                     20 kills of a coarse study with all chapters
    python tests/cluster/random_kills.py --kills 3 --seed 7

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
import sys
import tempfile
import time
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
PROJECT = HERE.parents[1]
sys.path[:0] = [str(HERE), str(HERE.parent), str(PROJECT / "workflow")]

import psutil  # noqa: E402
from run_processes import kind, of_session, victims, work  # noqa: E402
from slurm_node import Call, differing  # noqa: E402

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
ARGUMENTS = ["--cores", "2", "--configfile", "config/coarse.yaml", "config/short.yaml"]
GRACE_S = 5.0
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


def start(folder: Path, *arguments: str) -> Call:
    """Call Snakemake in a session of its own, with a folder for temporary files of its own."""
    environment = {key: value for key, value in os.environ.items() if key not in NOT_INHERITED}
    (folder / "tmp").mkdir(exist_ok=True)
    environment["TMPDIR"] = str(folder / "tmp")
    return Call.begin(folder, [*arguments, *ARGUMENTS], environment, start_new_session=True)


def run(folder: Path, *arguments: str) -> Call:
    """Call Snakemake and wait for its end."""
    call = start(folder, *arguments)
    call.end()
    return call


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


def undisturbed(folder: Path) -> tuple[Path, Course]:
    """Run twice, so that the compiler's cache and bytecode are there as in later runs; return folder and course of the second."""
    for _ in range(2):
        anew(project(folder))
        course = Course.of(call := start(folder))
        if call.process.returncode:
            raise AssertionError(call.text[-4000:])
    return folder, course


def kill(
    folder: Path, course: Course, part: tuple[float, float], draw: random.Random
) -> tuple[Call, str, str]:
    """Run anew, and kill at a moment within a part of the length; return the call, the moment and what was killed.

    Raises
    ------
    AssertionError
        Every run ended before.
    """
    for _ in range(MOST_TRIES):
        anew(folder)
        seconds = course.length_s * draw.uniform(*part)
        lines, later = course.moment(seconds)
        call = start(folder)
        until(call, lines, later)
        name, processes = victims(call.process.pid, draw)
        for process in processes:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()
        if name:
            return call, f"{100 * seconds / course.length_s:.0f} %, line {lines} + {later:.2f} s", name
        call.end()
    raise AssertionError(f"{MOST_TRIES} runs ended before the moment of the kill")


def survivors(call: Call) -> list[str]:
    """Wait for the end of a call, and a little for that of its processes; name those that live on."""
    call.end()
    end = time.monotonic() + GRACE_S
    while (left := of_session(call.process.pid)) and time.monotonic() < end:
        time.sleep(0.05)
    return [f"{kind(process, call.process.pid)} {work(process)} outlived Snakemake" for process in left]


def as_told(folder: Path) -> tuple[str, list[str]]:
    """Call again and do what is said; return what that was, and what is wrong."""
    done, again = [], run(folder)
    if again.process.returncode and "--unlock" in again.text:
        unlocked = run(folder, "--unlock")
        done += ["--unlock"]
        if unlocked.process.returncode:
            return "--unlock", [unlocked.text[-2000:]]
        again = run(folder)
    if again.process.returncode:
        return "failed", [again.text[-4000:]]
    jobs = re.search(r"^total +(\d+)$", again.text, flags=re.M)
    return ", ".join([*done, f"{int(jobs[1]) - 1} jobs" if jobs else "nothing to do"]), []


def wrong_with(folder: Path, expected: Path) -> tuple[list[str], list[str]]:
    """Results that differ from those of the undisturbed run, and whatever else is not as after that."""
    bytes_differ = differing(expected / RESULTS, folder / RESULTS)
    names = everything_below(folder / RESULTS) ^ everything_below(expected / RESULTS)
    wrong = [f"{name}: only in one of the folders" for name in sorted(names)]
    last = run(folder, "--dry-run")
    if "Nothing to be done" not in last.text:
        wrong.append(f"a call after that makes something anew:\n{last.text[-2000:]}")
    return bytes_differ, wrong


def main() -> int:
    """Kill as often as asked for and tell how it went."""
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
        ARGUMENTS.extend(["--", *options.targets])
        work_folder = (options.folder or Path(name)).resolve()
        expected, course = undisturbed(work_folder / "undisturbed")
        print(
            f"undisturbed: {course.length_s:.0f} s, {len(everything_below(expected / RESULTS))} files and folders"
        )
        failed = 0
        for number in options.only or range(1, options.kills + 1):
            part = ((number - 1) / options.kills, number / options.kills)
            draw = random.Random(f"{options.seed} {number}")
            failed += met(number, work_folder / "disturbed", expected, course, part, draw)
        print(f"seed {options.seed}: {failed} kills after which something is wrong")
    return min(failed, 1)


def met(number: int, folder: Path, expected: Path, course: Course, part, draw: random.Random) -> bool:
    """Kill once, go on as a user does, print a line; return whether something is wrong."""
    project(folder)
    call, moment, killed = kill(folder, course, part, draw)
    wrong = survivors(call)
    status = call.process.returncode
    told, also_wrong = as_told(folder)
    bytes_differ, more = wrong_with(folder, expected)
    wrong += also_wrong + more
    print(
        f"{number:3}  {moment:28}  {killed:45}  status {status:3}; then {told:24}  {len(bytes_differ)} differ",
        flush=True,
    )
    for line in [*(f"{name}: differs" for name in bytes_differ), *wrong]:
        print(f"     WRONG: {line}", flush=True)
    return bool(bytes_differ or wrong)


if __name__ == "__main__":
    sys.exit(main())
