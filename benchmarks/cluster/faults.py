"""What happens to jobs on a cluster, done to a small study: each ends with the same bytes as if nothing had happened."""

from __future__ import annotations

import os
import re
import shutil
import signal
from pathlib import Path

from cluster.slurm_node import Call, Node, wait_for

CHAPTER = "survey"
RULES = ("twin_survey", "check_survey_recordings", "survey_tables", "survey_figures")
RESULTS = Path("results") / "thesis"


def anew(folder: Path) -> None:
    """Remove what earlier calls made."""
    for name in ("results", ".snakemake"):
        shutil.rmtree(folder / name, ignore_errors=True)


def in_the_midst(node: Node, folder: Path) -> str:
    """Wait until the first file of the chapter is made, and return the job that is making the next."""
    (job,) = wait_for(lambda: node.jobs("RUNNING"), "a running job")
    wait_for(lambda: list((folder / RESULTS).glob("checked/*.json")), "the first file of the chapter")
    return job


def asked(node: Node, call: Call) -> list[dict[str, str]]:
    """State, time limit and memory of the jobs that a call submitted, in order."""
    (name,) = set(re.findall(r"SLURM run ID: (\S+)", call.text))
    lines = node.command(
        "squeue", "--noheader", "--states=all", f"--name={name}", "--sort=i", "--format=%T %l %m"
    )
    return [
        dict(zip(("state", "minutes", "memory"), line.split(), strict=True)) for line in lines.splitlines()
    ]


def must(condition: object, call: Call, what: str) -> None:
    """Fail with what the call said, unless the condition is true."""
    if not condition:
        raise AssertionError(f"{what}\n{call.text[-4000:]}")


def ended_after_retry(call: Call) -> None:
    """Hold that the call ended well, after a job was submitted again."""
    must(call.end() == 0, call, "the call did not end well")
    must("Trying to restart job" in call.text, call, "no job was submitted again")


def job_cancelled(node: Node, folder: Path) -> None:
    """scancel of the running job: submitted again."""
    call = node.start(folder, CHAPTER)
    node.command("scancel", in_the_midst(node, folder))
    ended_after_retry(call)


def worker_killed(node: Node, folder: Path) -> None:
    """kill -9 of all processes of the running job: submitted again."""
    call = node.start(folder, CHAPTER)
    for process in node.processes(in_the_midst(node, folder)):
        os.kill(process, signal.SIGKILL)
    ended_after_retry(call)


def worker_killed_without_retry(node: Node, folder: Path) -> None:
    """kill -9 of one worker, no retries: the rule and its log are named, the status is 1, the next call ends the study."""
    call = node.start(folder, CHAPTER, "--retries", "0")
    os.kill(node.processes(in_the_midst(node, folder))[-1], signal.SIGKILL)
    must(call.end() == 1, call, "the status is not 1")
    logs = re.findall(r"\(log: (\S+)\)", call.text)
    must(
        "FAILED:" in call.text and all(Path(log).is_file() for log in logs), call, "job and log are not named"
    )
    again = node.run(folder, CHAPTER, "--retries", "0")
    must(again.process.returncode == 0, again, "the next call did not end well")


def node_drained(node: Node, folder: Path) -> None:
    """Node drained while a job runs, each rule a job of its own: the next waits, and runs once the node is resumed."""
    call = node.start(folder, CHAPTER, "--groups", *(f"{rule}={rule}" for rule in RULES))

    wait_for(lambda: node.jobs("RUNNING"), "a running job")
    node.set_state("drain")
    wait_for(lambda: not node.jobs("RUNNING") and node.jobs("PENDING"), "its end, and a job that waits")
    node.set_state("resume")
    must(call.end() == 0, call, "the call did not end well")


def node_lost(node: Node, folder: Path) -> None:
    """Node down while a job runs, and back: SLURM puts the job into the queue again, from which it runs minutes later."""
    call = node.start(folder, CHAPTER)
    in_the_midst(node, folder)
    node.set_state("down")
    must(call.end() == 0, call, "the call did not end well")


def time_over(node: Node, folder: Path) -> None:
    """Job stopped in its tracks until its time limit: submitted again, with more time."""
    call = node.start(folder, CHAPTER)
    job = in_the_midst(node, folder)
    minutes = int(asked(node, call)[-1]["minutes"].split(":")[0])
    node.command("scontrol", "update", f"JobId={job}", "TimeLimit=1")
    os.kill(node.processes(job)[-1], signal.SIGSTOP)
    ended_after_retry(call)
    first, second = asked(node, call)
    must(first["state"] == "TIMEOUT" and second["state"] == "COMPLETED", call, "no time limit was hit")
    must(
        second["minutes"] == f"{2 * minutes}:00",
        call,
        f"asked for {second['minutes']}, twice {minutes} min expected",
    )


def memory_over(node: Node, folder: Path) -> None:
    """Job that asks for too little memory: killed, submitted again with more until it suffices."""
    memory = [f"{rule}:mem_mb=attempt*150" for rule in RULES]
    call = node.start(folder, CHAPTER, "--retries", "5", "--set-resources", *memory)
    ended_after_retry(call)
    memories = [job["memory"] for job in asked(node, call)]
    must(memories[:2] == ["150M", "300M"], call, f"asked for {memories}")


def snakemake_killed(node: Node, folder: Path) -> None:
    """kill -9 of the Snakemake that submits: after scancel and --unlock the next call ends the study."""
    call = node.start(folder, CHAPTER)
    in_the_midst(node, folder)
    call.process.kill()
    call.end()
    refused = node.run(folder, CHAPTER)
    must(refused.process.returncode == 1 and "--unlock" in refused.text, refused, "the folder is not locked")
    (name,) = set(re.findall(r"SLURM run ID: (\S+)", call.text))
    node.command("scancel", f"--name={name}")
    wait_for(lambda: not node.jobs("RUNNING,COMPLETING"), "the end of the cancelled job")
    must(node.run(folder, "--unlock").process.returncode == 0, refused, "--unlock failed")
    again = node.run(folder, CHAPTER)
    must(again.process.returncode == 0, again, "the next call did not end well")


FAULTS = (
    *(job_cancelled, worker_killed, worker_killed_without_retry, node_drained, node_lost),
    *(time_over, memory_over, snakemake_killed),
)
