"""Runs that are disturbed as machines and people disturb them end with the same bytes, and leave nothing running.

    python benchmarks/reliability.py                              all disturbances of a coarse study with all chapters
    python benchmarks/reliability.py --only full_disk read_only   some of them
    python benchmarks/reliability.py --targets results/thesis/tables/table_3_2.csv

After each disturbance a call is made as a user makes it, who does what the message says; all results must then be those of a
run that nothing disturbed, byte for byte. Prints a line per disturbance; exits with 1 where something is wrong. `kill -9` at
random moments is in ``benchmarks/cluster/random_kills.py``. A full disk and read-only results need the right to mount; without
it they are said to be left out.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from cluster.random_kills import RESULTS, Here, Series, anew
from cluster.slurm_node import Call, differing

MESSAGES = ("Traceback (most recent call last)",)
FULL_MB = 1
"""Of the disk that is full at once."""


class LeftOut(Exception):
    """A disturbance that cannot be made here, and why."""


def under_way(series: Series) -> Call:
    """A run that has said a third of its lines."""
    anew(series.folder)
    call = series.place.start(series.folder)
    while (
        call.output.read_bytes().count(b"\n") < len(series.course.said_s) / 3 and call.process.poll() is None
    ):
        time.sleep(0.01)
    return call


def gone_after(series: Series, call: Call) -> tuple[str, list[str]]:
    """Wait for the end of a run and all of its processes; how long that took, and what lives on."""
    began = time.monotonic()
    left = series.place.ended(call)
    return f"nothing of it runs after {time.monotonic() - began:.1f} s", left


@contextmanager
def loaded() -> Iterator[int]:
    """Keep three busy processes per core beside what is done; their number."""
    count = 3 * (os.cpu_count() or 1)
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield count
    finally:
        for process in busy:
            process.kill()
            process.wait()


def load(series: Series) -> tuple[str, list[str]]:
    """Run beside busy processes."""
    with loaded() as count:
        anew(series.folder)
        call = series.place.start(series.folder)
        return f"beside {count} busy processes, status {call.end()}", []


@contextmanager
def at_interrupt(handler: signal.Handlers | Callable) -> Iterator[None]:
    """Begin processes that inherit what SIGINT does."""
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def interrupt(series: Series) -> tuple[str, list[str]]:
    """Press Ctrl-C: every process of the terminal gets SIGINT."""
    with at_interrupt(signal.default_int_handler):
        call = under_way(series)
    os.killpg(call.process.pid, signal.SIGINT)
    return gone_after(series, call)


def background(series: Series) -> tuple[str, list[str]]:
    """End a run with SIGTERM that a shell started with ``&``: SIGINT is ignored by all of it."""
    with at_interrupt(signal.SIG_IGN):
        call = under_way(series)
    call.process.terminate()
    return gone_after(series, call)


def background_loaded(series: Series) -> tuple[str, list[str]]:
    """The same beside busy processes."""
    with loaded():
        return background(series)


def two_runs(series: Series) -> tuple[str, list[str]]:
    """Give the same command twice at once: the second says that the folder is locked, the first goes on."""
    first = under_way(series)
    second = series.run()
    said = "--unlock" in second.text and second.process.returncode != 0
    status = first.end()
    wrong = (
        []
        if said and status == 0
        else [f"statuses {status}, {second.process.returncode}: {second.text[-2000:]}"]
    )
    return f"the second is refused, the first ends with {status}", wrong


def told(call: Call, words: str) -> tuple[str, list[str]]:
    """Whether a run failed with these words and without a traceback."""
    text = call.text
    wrong = [] if call.process.returncode else ["it ended as if nothing had been"]
    wrong += [] if words in text else [f"{words!r} is not said: {text[-2000:]}"]
    wrong += [f"{mark!r} is printed" for mark in MESSAGES if mark in text]
    (line, *_) = [line.strip() for line in text.splitlines() if words in line] or [""]
    return f"told: {line[:100]}", wrong


@contextmanager
def mounted(folder: Path, *arguments: str) -> Iterator[None]:
    """Mount something at a folder."""
    done = subprocess.run(["mount", *arguments, str(folder)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise LeftOut(done.stderr.strip())
    try:
        yield
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def full_disk(series: Series) -> tuple[str, list[str]]:
    """Let the disk of the results be full soon."""
    anew(series.folder)
    results = series.folder / "results"
    results.mkdir()
    with mounted(results, "-t", "tmpfs", "-o", f"size={FULL_MB}m", "tmpfs"):
        return told(series.run(), "No space left on device")


def read_only(series: Series) -> tuple[str, list[str]]:
    """Make the folder of results read-only, a table missing."""
    anew(series.folder)
    series.run()
    max((series.folder / RESULTS / "tables").glob("*.csv")).unlink()
    results = series.folder / "results"
    with mounted(results, "--bind", str(results)):
        subprocess.run(["mount", "-o", "remount,ro,bind", str(results)], check=True)
        return told(series.run(), "Write-protected")


DISTURBANCES: dict[str, Callable[[Series], tuple[str, list[str]]]] = {
    disturbance.__name__: disturbance
    for disturbance in (load, interrupt, background, background_loaded, two_runs, full_disk, read_only)
}


def met(series: Series, name: str) -> list[str]:
    """Disturb, go on as a user does, print a line; return what is wrong."""
    try:
        said, wrong = DISTURBANCES[name](series)
    except LeftOut as reason:
        print(f"{name:18}left out: {reason}", flush=True)
        return []
    done, failed = series.as_told()
    differ = differing(series.expected / RESULTS, series.folder / RESULTS)
    print(f"{name:18}{said}; then {done}, {len(differ)} files differ", flush=True)
    found = [*wrong, *failed, *(f"{file} differs" for file in differ), *series.left()]
    print("".join(f"     WRONG {what}\n" for what in found), end="", flush=True)
    return found


def main() -> int:
    """Disturb as asked for; return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=DISTURBANCES, default=list(DISTURBANCES))
    parser.add_argument("--targets", nargs="+", default=[], help="of Snakemake, instead of the whole study")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="lumbar_reliability_") as folder:
        series = Series.begun(Here(tuple(options.targets)), Path(folder).resolve())
        wrong = [met(series, name) for name in options.only]
    return int(any(wrong))


if __name__ == "__main__":
    sys.exit(main())
