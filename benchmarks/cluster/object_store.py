"""A study on a local S3 server: the server, the calls of Snakemake, and what is found in the store and on the disk."""

from __future__ import annotations

import base64
import contextlib
import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
PROJECT = HERE.parent.parent
SERVER_ENVIRONMENT = PROJECT / "build" / "s3-server"
BUCKET, PREFIX = "lab", "study"
STORED = ("--default-storage-provider", "s3", "--default-storage-prefix", f"s3://{BUCKET}/{PREFIX}")
NOT_COMPARED = ("/logs/", "/benchmarks/")
"""Files of times and of paths."""
PATIENCE_S = 3600


def what_is_missing() -> str:
    """Say what this Python or machine needs for these runs; empty where nothing is missing."""
    if find_spec("snakemake_storage_plugin_s3") is None:
        return "snakemake-storage-plugin-s3 is not installed: make cluster"
    if server_python() is None:
        return (
            "no S3 server: python3 benchmarks/cluster/run_s3.py --install makes an environment that has one"
        )
    return ""


def server_python() -> Path | None:
    """Python of the environment that has moto."""
    if find_spec("moto") and find_spec("flask_cors"):
        return Path(sys.executable)
    own = SERVER_ENVIRONMENT / "bin" / "python"
    return own if own.is_file() else None


@dataclass
class Store:
    """A running server, with credentials of its own.

    Attributes
    ----------
    folder : Path
        Where the server is told what to hold.
    endpoint : str
    secret : str
        New with every server, so that it can be looked for.
    """

    folder: Path
    endpoint: str
    secret: str = field(default_factory=lambda: secrets.token_hex(20), repr=False)

    @property
    def environment(self) -> dict[str, str]:
        """Variables that bring Snakemake to the store: nothing of it stands on a command line."""
        return {
            "AWS_ACCESS_KEY_ID": "lumbar-test",
            "AWS_SECRET_ACCESS_KEY": self.secret,
            "SNAKEMAKE_STORAGE_S3_ENDPOINT_URL": self.endpoint,
        }

    @property
    def bucket(self):
        """The bucket, as boto3 gives it."""
        import boto3

        access = {"aws_access_key_id": "lumbar-test", "aws_secret_access_key": self.secret}
        return boto3.resource("s3", endpoint_url=self.endpoint, region_name="us-east-1", **access).Bucket(
            BUCKET
        )

    def objects(self, below: str = "") -> dict[str, bytes]:
        """All objects whose key begins so, by the rest of the key."""
        return {
            item.key.removeprefix(below): item.get()["Body"].read()
            for item in self.bucket.objects.filter(Prefix=below)
        }

    def betrays(self, content: bytes) -> bool:
        """Whether the secret stands there, as it is or as Snakemake encodes arguments."""
        return self.secret.encode() in content or base64.b64encode(self.secret.encode()) in content


@contextlib.contextmanager
def serving(folder: Path) -> Iterator[Store]:
    """Run a server in an empty folder, with an empty bucket."""
    folder.mkdir(parents=True)
    with (folder / "server.log").open("wb") as log:
        command = [str(server_python()), str(HERE / "s3_server.py"), str(folder)]
        server = subprocess.Popen(command, stdout=log, stderr=log)
        try:
            wait_for(lambda: (folder / "port").is_file() and (folder / "port").read_text(), server)
            store = Store(folder, f"http://127.0.0.1:{(folder / 'port').read_text()}")
            store.bucket.create()
            yield store
        finally:
            server.terminate()
            server.wait()


def wait_for(condition, process: subprocess.Popen) -> None:
    """Wait until it holds.

    Raises
    ------
    RuntimeError
        Where the process ends before, or after an hour.
    """
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        if process.poll() is not None or time.monotonic() > deadline:
            raise RuntimeError(f"{process.args}: status {process.poll()} before what was waited for")
        time.sleep(0.02)


def run_and_kill(project: Path, store: Store, upload: str, arguments: list[str]) -> None:
    """Start Snakemake and end it and all its jobs by SIGKILL when half of one upload has arrived."""
    order, held = store.folder / "hold", store.folder / "held"
    order.write_text(upload)
    with (project / "killed.log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "snakemake", "--nocolor", *arguments],
            cwd=project,
            env=os.environ | store.environment,
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
        try:
            wait_for(held.is_file, process)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            order.unlink()


def results_on_disk(project: Path) -> dict[str, bytes]:
    """Every result by its path, without logs and timings."""
    folder = project / "results"
    found = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    return {name: path.read_bytes() for name, path in found.items() if is_result(name)}


def results_in_store(store: Store) -> dict[str, bytes]:
    """As `results_on_disk`, of the objects."""
    found = store.objects(f"{PREFIX}/results/")
    return {name: content for name, content in found.items() if is_result(name)}


def is_result(name: str) -> bool:
    """Whether a file is the same in every run."""
    return not any(part in f"/{name}" for part in NOT_COMPARED)


def betrayed(project: Path, store: Store) -> list[str]:
    """Files of the project and objects of the store in which the secret stands."""
    files = [path for path in sorted(project.rglob("*")) if path.is_file()]
    found = [str(path) for path in files if store.betrays(path.read_bytes())]
    return found + [key for key, content in store.objects().items() if store.betrays(content)]
