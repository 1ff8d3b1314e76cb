"""A whole study in a local object store, from a clean machine: its recordings and results are S3 objects, it is killed in the
middle of an upload, and resumed; at the end it has the same bytes as on a disk, and no file holds the credentials.

``python3 benchmarks/cluster/run_s3.py`` makes what it needs (``make cluster``; the server's environment in build/s3-server) and
runs the synthetic study; ``--targets survey signals`` makes less of it; ``--install`` only makes the environments.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from cluster import object_store  # noqa: E402
from cluster.object_store import PROJECT, SERVER_ENVIRONMENT, STORED  # noqa: E402

SERVER = ("moto[s3]>=5,<6", "flask>=3", "flask-cors>=5")
"""What moto's server needs of moto[server]; the rest serves other services."""
OWN = PROJECT / ".venv" / "bin" / "python"
RECORDED = {
    "study": "recorded",
    "data": "recordings",
    "data_source": {"name": "synthetic twin", "licence": "MIT", "obtain": "the default study makes them"},
    "chapters": ["surgeon", "signals", "survey"],
}
"""A study whose recordings are given, some of those that the default study makes."""


def install() -> None:
    """Make the environments that are not there."""
    if object_store.server_python() is None:
        subprocess.run([sys.executable, "-m", "venv", SERVER_ENVIRONMENT], check=True)
        pip = [SERVER_ENVIRONMENT / "bin" / "python", "-m", "pip", "install", "--quiet"]
        subprocess.run([*pip, *SERVER], check=True)
    if "plugin" in object_store.what_is_missing():
        subprocess.run(["make", "cluster"], cwd=PROJECT, check=True)
        if Path(sys.executable) != OWN:
            os.execv(OWN, [str(OWN), *sys.argv])


def snakemake(project: Path, *arguments: str, env: dict[str, str] | None = None) -> str:
    """Call Snakemake as a user does and return what it said.

    Raises
    ------
    SystemExit
        With its last words, where it fails.
    """
    print(f"snakemake {' '.join(arguments)}", flush=True)
    command = [sys.executable, "-m", "snakemake", "--nocolor", *arguments]
    done = subprocess.run(
        command, cwd=project, env=os.environ | (env or {}), capture_output=True, text=True, check=False
    )
    if done.returncode:
        sys.exit(f"{' '.join(arguments)}: status {done.returncode}\n{(done.stdout + done.stderr)[-4000:]}")
    return done.stdout + done.stderr


def compare(on_disk: dict[str, bytes], stored: dict[str, bytes]) -> list[str]:
    """Name results that one side lacks or that differ."""
    lacking = [
        f"{name}: only {'on disk' if name in on_disk else 'stored'}"
        for name in on_disk.keys() ^ stored.keys()
    ]
    return lacking + [
        f"{name}: differs" for name in on_disk.keys() & stored.keys() if on_disk[name] != stored[name]
    ]


def run(folder: Path, targets: list[str], cores: str) -> list[str]:
    """Run both studies in `folder`, on disk and in the store; return what is wrong."""
    from running import copy_project

    on_disk, stored = copy_project(folder / "on_disk"), copy_project(folder / "stored")
    os.environ["SOURCE_DATE_EPOCH"] = "0"  # the moment that an archive of a run says
    recordings = ["twin_surgeon", "twin_survey"]  # of the other study
    made = ["--cores", cores, *recordings, *targets]
    given = ["--cores", cores, "--configfile", "recorded.json"]
    snakemake(on_disk, *made)
    with object_store.serving(folder / "server") as store:
        for project, root in ((on_disk, "recordings"), (stored, f"s3://{object_store.BUCKET}/recordings")):
            (project / "recorded.json").write_text(json.dumps({**RECORDED, "data_root": root}))
        shutil.copytree(on_disk / "results" / "thesis" / "twin", on_disk / "recordings")
        for path in filter(Path.is_file, (on_disk / "recordings").rglob("*")):
            store.bucket.upload_file(str(path), path.relative_to(on_disk).as_posix())
        snakemake(on_disk, *given)
        results = object_store.results_on_disk(on_disk)
        wrong, said = killed_and_resumed(stored, store, made, sorted(results))
        said += snakemake(stored, *given, *STORED, env=store.environment)
        said += snakemake(stored, *made, *STORED, "--report", "provenance.html", env=store.environment)
        again = snakemake(stored, *made, *STORED, "--dry-run", env=store.environment)
        if "Nothing to be done" not in again:
            wrong.append(f"a second call makes something anew:\n{again[-3000:]}")
        found = object_store.results_in_store(store)
        wrong += compare(results, found)
        wrong += [f"{place}: holds the secret key" for place in object_store.betrayed(folder, store)]
        wrong += ["Snakemake said the secret key"] if store.betrays(said.encode()) else []
        print(
            f"{len(results)} results on disk, {len(found)} in the store, {len(store.objects())} objects in all"
        )
    return wrong


def killed_and_resumed(project: Path, store: object_store.Store, call: list[str], results: list[str]):
    """Kill the study while a page of it is uploaded, and resume; return what is wrong and what Snakemake said."""
    upload = next(name for name in results if name.startswith("thesis/") and name.endswith(".html"))
    print(f"killed while {upload} is uploaded", flush=True)
    object_store.run_and_kill(project, store, upload, [*call, *STORED])
    wrong = [f"{upload}: half an object"] if upload in object_store.results_in_store(store) else []
    snakemake(project, "--unlock", *call, *STORED, env=store.environment)
    return wrong, snakemake(project, *call, *STORED, env=store.environment)


def main() -> int:
    """Install, run, compare; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--targets", nargs="*", default=["all", "report", "crate"])
    parser.add_argument("--cores", default="2")
    parser.add_argument("--install", action="store_true", help="make the environments and end")
    parser.add_argument("--folder", type=Path, help="keep everything there, instead of in a temporary one")
    options = parser.parse_args()
    install()
    if options.install:
        return 0
    sys.path[:0] = [str(PROJECT / "tests"), str(PROJECT / "workflow")]
    with tempfile.TemporaryDirectory(prefix="lumbar_s3_") as name:
        wrong = run((options.folder or Path(name)).resolve(), options.targets, options.cores)
    print("\n".join(wrong) or "the same bytes in the store as on disk; nothing holds the credentials")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
