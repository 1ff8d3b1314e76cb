"""Run a small cohort on a local SLURM and compare the results with those of a run without SLURM, byte for byte.

    .venv/bin/python benchmarks/slurm_cohort.py
    .venv/bin/python benchmarks/slurm_cohort.py --persons 10 --folder build/slurm
    .venv/bin/python benchmarks/slurm_cohort.py --moto build/moto/bin/moto_server

Needs `make cluster` and the Debian packages slurmctld, slurmd, slurm-client and munge. The script starts a SLURM with one node,
its own authentication and no accounting. It does not touch any other SLURM on this machine. With `--moto` (the program of
`pip install "moto[s3,server]"`), the survey chapter is also run with its results in a local object store.

Exits with 1 if any result differs.
"""

import argparse
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(PROJECT / "tests"))

from running import copy_project  # noqa: E402

PROGRAMS = ("slurmctld", "slurmd", "sbatch", "srun", "sinfo", "munged")
COHORT = """
twin:
  lifting:
    cohort: {{trials: 2, groups: {{expert: {{persons: {0}}}, novice: {{persons: {0}}}}}}}
"""
COHORT_FILES = ("--configfile", "config/studies/cohort.yaml", "config/small_cohort.yaml")
SLURM_PROFILE = (
    *("--workflow-profile", "slurm", "--slurm-status-command", "squeue", "--latency-wait", "10"),
    *("--slurm-init-seconds-before-status-checks", "2", "--seconds-between-status-checks", "2"),
)
"""The project's profile for SLURM, but with squeue (this node has no accounting) and with frequent status checks."""
CONFIGURATION = """
ClusterName=lumbar
SlurmctldHost={node}(127.0.0.1)
SlurmctldPort={controller_port}
SlurmdPort={node_port}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
CryptoType=crypto/munge
AuthInfo=socket={folder}/munge.socket
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/linux
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
MpiDefault=none
ReturnToService=2
SlurmdParameters=config_overrides
NodeName={node} NodeAddr=127.0.0.1 CPUs={processors} RealMemory={memory_mb} State=UNKNOWN
PartitionName=all Nodes={node} Default=YES MaxTime=INFINITE DefMemPerCPU=1000 State=UP
"""
BUCKET, PREFIX = "lab", "study"
NOT_COMPARED = {"logs", "benchmarks", "run_environment.json"}
"""Files with times, memory and versions."""


def missing_requirement() -> str:
    """Return what this machine lacks to run jobs through SLURM; empty if nothing."""
    if find_spec("snakemake_executor_plugin_slurm") is None:
        return "the SLURM plugin of Snakemake is not installed in this Python: make cluster"
    programs = [program for program in PROGRAMS if shutil.which(program) is None]
    packages = "slurmctld slurmd slurm-client munge"
    return f"not installed: {', '.join(programs)}; apt-get install {packages}" if programs else ""


def free_port() -> int:
    """Return a port that no program uses now."""
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        return server.getsockname()[1]


def wait_for(condition: Callable[[], object], what: str, seconds: float = 60) -> None:
    """Wait until a condition is true.

    Raises
    ------
    TimeoutError
        If it is not true within `seconds`.
    """
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f"{what}: not within {seconds:g} s")
        time.sleep(0.2)


@contextmanager
def daemon(log: Path, *command: str | Path, env: dict[str, str] | None = None) -> Iterator[subprocess.Popen]:
    """Run a program in the background, with its output in a file, and end it afterwards."""
    with log.open("wb") as stream:
        process = subprocess.Popen([str(word) for word in command], stdout=stream, stderr=stream, env=env)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def write_slurm_configuration(folder: Path, processors: int) -> dict[str, str]:
    """Write all files that SLURM reads, and return the environment variables with which its programs find them."""
    for part in ("state", "spool", "bin"):
        (folder / part).mkdir(parents=True, mode=0o700)
    key = folder / "munge.key"
    key.touch(mode=0o600)
    key.write_bytes(os.urandom(128))
    node, memory = (
        socket.gethostname().split(".")[0],
        os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
    )
    configuration = CONFIGURATION.format(
        folder=folder,
        node=node,
        user=subprocess.run(["id", "-un"], capture_output=True, text=True, check=True).stdout.strip(),
        controller_port=free_port(),
        node_port=free_port(),
        processors=processors,
        memory_mb=int(0.9 * memory / 2**20),
    )
    path = folder / "slurm.conf"
    path.write_text(configuration, encoding="utf-8")
    # Before 23.02, slurmd always loads a control-group plugin; version 1 needs no mounted control groups.
    version = subprocess.run(["slurmd", "-V"], capture_output=True, text=True, check=True).stdout
    plugin = "cgroup/v1" if re.search(r" 2[0-2]\.", version) else "disabled"
    (folder / "cgroup.conf").write_text(f"CgroupPlugin={plugin}\n", encoding="utf-8")
    # The plugin calls srun in its jobs without SLURM_CONF.
    srun = folder / "bin" / "srun"
    srun.write_text(f'#!/bin/sh\nexec env SLURM_CONF="{path}" "{shutil.which("srun")}" "$@"\n')
    srun.chmod(0o755)
    return {"SLURM_CONF": str(path), "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"}


@contextmanager
def slurm_node(folder: Path, processors: int) -> Iterator[dict[str, str]]:
    """Run a SLURM with one node; yield the environment variables with which its programs find it."""
    variables = write_slurm_configuration(folder, processors)
    environment = os.environ | variables

    def is_idle() -> bool:
        command = ["sinfo", "--noheader", "--format=%T"]
        return (
            subprocess.run(command, env=environment, capture_output=True, check=False).stdout.strip()
            == b"idle"
        )

    munge = [f"--{name}-file={folder}/munge.{name}" for name in ("key", "seed", "pid", "log")]
    with ExitStack() as stack:
        # --force: munged otherwise rejects folders below those that other users can write to, such as /tmp.
        stack.enter_context(
            daemon(
                folder / "munged.out",
                "munged",
                "--foreground",
                "--force",
                f"--socket={folder}/munge.socket",
                *munge,
            )
        )
        wait_for((folder / "munge.socket").exists, f"munged ({folder}/munge.log)")
        for program in ("slurmctld", "slurmd"):
            command = (program, "-D", "-f", folder / "slurm.conf")
            stack.enter_context(daemon(folder / f"{program}.log", *command, env=environment))
        wait_for(is_idle, f"an idle node ({folder}/slurmctld.log, {folder}/slurmd.log)")
        yield variables
        subprocess.run(["scancel", "--me"], env=environment, check=False)


def run_snakemake(project: Path, *arguments: str, env: dict[str, str] | None = None) -> str:
    """Call Snakemake in a copy of the project and return what it prints.

    Raises
    ------
    RuntimeError
        If it fails; with the end of its output.
    """
    inherited = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "LUMBAR_DATA")}
    command = [sys.executable, "-m", "snakemake", "--nocolor", *arguments]
    output = project / "snakemake.txt"
    with output.open("wb") as stream:
        done = subprocess.run(
            command, cwd=project, env=inherited | (env or {}), stdout=stream, stderr=stream, check=False
        )
    text = output.read_text(encoding="utf-8")
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}\n{text[-4000:]}")
    return text


def results_on_disk(folder: Path) -> dict[str, bytes]:
    """Return every result below a folder by its path, without `NOT_COMPARED`."""
    files = {path.relative_to(folder): path for path in folder.rglob("*") if path.is_file()}
    return {
        str(name): path.read_bytes() for name, path in files.items() if not NOT_COMPARED & set(name.parts)
    }


def differing(one: dict[str, bytes], other: dict[str, bytes]) -> list[str]:
    """Return the names of results that are missing on one side or have other bytes."""
    return sorted(name for name in one | other if one.get(name) != other.get(name))


def compare_cohort(work: Path, persons: int, processors: int) -> tuple[int, list[str]]:
    """Run the cohort study with and without SLURM; return the number of results and those that differ."""
    local, slurm = (copy_project(work / name) for name in ("local", "slurm"))
    for folder in (local, slurm):
        (folder / "config" / "small_cohort.yaml").write_text(COHORT.format(persons), encoding="utf-8")
    run_snakemake(local, "--cores", str(processors), *COHORT_FILES)
    with slurm_node(work / "node", processors) as environment:
        text = run_snakemake(slurm, *SLURM_PROFILE, *COHORT_FILES, env=environment)
    submitted = text.count("has been submitted with SLURM jobid")
    print(f"{submitted} jobs were submitted to SLURM", flush=True)
    if not submitted:
        raise RuntimeError(f"no job went through SLURM\n{text[-4000:]}")
    expected, received = (results_on_disk(folder / "results") for folder in (local, slurm))
    return len(expected), differing(expected, received)


def compare_object_store(work: Path, moto_server: Path) -> tuple[int, list[str]]:
    """Run the survey chapter with its results on the disk and in an object store; return as `compare_cohort`."""
    import boto3

    disk, store = (copy_project(work / name) for name in ("on_disk", "in_store"))
    address = f"http://127.0.0.1:{(port := free_port())}"
    access = {"AWS_ACCESS_KEY_ID": "lumbar-test", "AWS_SECRET_ACCESS_KEY": "not-secret"}
    environment = {**access, "SNAKEMAKE_STORAGE_S3_ENDPOINT_URL": address}
    keys = {name.lower(): value for name, value in access.items()}
    prefix = f"s3://{BUCKET}/{PREFIX}"
    run_snakemake(disk, "--cores", "1", "survey")
    with daemon(work / "moto.log", moto_server, "-H", "127.0.0.1", "-p", str(port)):
        wait_for(lambda: socket.socket().connect_ex(("127.0.0.1", port)) == 0, "the object store")
        bucket = boto3.resource("s3", endpoint_url=address, region_name="us-east-1", **keys).Bucket(BUCKET)
        bucket.create()
        options = ("--default-storage-provider", "s3", "--default-storage-prefix", prefix)
        run_snakemake(store, "--cores", "1", "survey", *options, env=environment)
        objects = {
            Path(item.key).relative_to(PREFIX, "results"): item.get()["Body"].read()
            for item in bucket.objects.filter(Prefix=f"{PREFIX}/results/")
        }
    stored = {str(name): content for name, content in objects.items() if not NOT_COMPARED & set(name.parts)}
    expected = results_on_disk(disk / "results")
    left = results_on_disk(store / "results")
    return len(expected), differing(expected, stored) + [f"{name} (also on the disk)" for name in left]


def main() -> int:
    """Compare, and print what differs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--persons", type=int, default=3, help="persons in each of the two groups")
    parser.add_argument("--processors", type=int, default=os.cpu_count(), help="of the node")
    parser.add_argument("--folder", type=Path, help="keep all files in this new folder")
    parser.add_argument("--moto", type=Path, help="moto_server: also compare the survey in an object store")
    options = parser.parse_args()
    os.environ["PATH"] += f"{os.pathsep}/usr/sbin"
    if missing := missing_requirement():
        parser.error(missing)
    failed = False
    with tempfile.TemporaryDirectory(prefix="lumbar_slurm_") as name:
        work = (options.folder or Path(name)).resolve()
        parts = {"cohort": lambda: compare_cohort(work, options.persons, options.processors)}
        if options.moto:
            parts["object store"] = lambda: compare_object_store(work, options.moto.resolve())
        for part, compare in parts.items():
            start = time.monotonic()
            count, names = compare()
            failed |= bool(names) or not count
            print(
                f"{part}: {count} results, {len(names)} differ ({time.monotonic() - start:.0f} s)",
                *names,
                sep="\n",
            )
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
