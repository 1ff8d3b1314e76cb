"""The shell blocks of README and pages run, page by page and in order, in a folder that holds what a reader has."""

import html
import os
import re
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from test_code_blocks import PAGES, blocks

import lumbar
from column_files import write_columns, write_records
from running import PROJECT, ZIG_CACHE, copy_project, snakemake
from twin_examples import example_lift, example_records

pytestmark = pytest.mark.nightly

NOT_RUN = {
    "docs/cluster.md": "needs a cluster with SLURM, or an object store",
}
"""Pages whose blocks are not run, and why."""
BEFORE = {
    "docs/index.md": "rm -r FOLDER",  # the page makes it
    "docs/tissue/haptic_runtime.md": """
lumbar export results/thesis/tissue/models.json --model KB --output results/thesis/fmu""",
    "docs/tissue/pendulum_moment.md": "rm -r FOLDER; ln -s results/thesis/twin/hip_moment FOLDER",
    "docs/tissue/relaxation_and_creep.md": "rm -r FOLDER",  # the page makes it
    "docs/tissue/tutorial.md": "ln -s ../shared/real/friction_damper/*.csv.gz .",
}
"""What makes the things that the readers of single pages have."""
QUOTING = {
    f"docs/tissue/{name}.md"
    for name in ("haptic_runtime", "pendulum_moment", "relaxation_and_creep", "space", "tutorial", "verdicts")
}
"""Pages whose other blocks hold what their commands print, or sentences of the diagnosis."""
REFUSED = {"lumbar import counts.csv --dry-run\n"}
"""Blocks that show a refusal."""
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")
COMMAND = re.compile(r"^ *(lumbar|python|snakemake|make|source|sed|unzip) ", flags=re.M)
SHELL = {
    name: [block for block in blocks(page, "", "sh") if COMMAND.search(block)] for name, page in PAGES.items()
}
ABRIDGED = Path(__file__).with_name("abridged.sh").read_text(encoding="utf-8")
"""What takes long is only planned, a page is served until it stands, few effects are tried, and what a person fills in is;
the C compiler is the project's own."""
LEFT = ("tissue/models.json", "twin/two_hidden_effects/noise.csv", "twin/hip_moment/slow.csv")


def quoted(page: str) -> list[str]:
    """Lines that the commands of a page print, as it says."""
    shown = [block for block in blocks(PAGES[page], "") if not COMMAND.search(block)] * (page in QUOTING)
    lines = [line.strip(" …") for block in shown for line in block.splitlines()]
    return [line for line in lines if line]


def is_printed(line: str, told: str) -> bool:
    """Whether a line is printed, its numbers as another processor rounds them."""
    numbers = [float(number) for number in NUMBER.findall(line)]
    printed = f"({NUMBER.pattern})".join(map(re.escape, NUMBER.split(line)))
    found = [match.groups() for match in re.finditer(printed, told)]
    return any(np.allclose(numbers, [float(item) for item in row], rtol=0.1) for row in found)


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """A project, with recordings under the names that the pages use and some of what the default study leaves."""
    project = copy_project(tmp_path_factory.mktemp("pages"))
    made = [f"results/thesis/{name}" for name in LEFT]
    assert not (run := snakemake(project, "--cores", "1", *made)).status, run.text
    for name in ("Makefile", "pyproject.toml", "README.md", "examples", "tests", "docs"):
        (project / name).symlink_to(PROJECT / name)
    (project / ".venv").symlink_to(sys.prefix)
    records = write_records(project / "FOLDER", example_records())
    for number, file in enumerate(sorted(records.iterdir()), 1):
        for name in (f"trial_{number}.txt", f"trial_{number}.lvm"):
            shutil.copy(file, project / name)
    write_bench(project)
    subject = example_lift(project / "trial.c3d")
    (project / "ann.yaml").write_text(
        yaml.safe_dump({"subject": subject.model_dump(mode="json")}), encoding="utf-8"
    )
    for folder in ("folder", "recordings/my_lab"):
        (project / folder).mkdir(parents=True)
        shutil.copy(project / "trial.c3d", project / folder)
    lumbar.lift(project / "trial.c3d", subject).save(project / "results/thesis/lifting/expert_23kg")
    return project


def write_bench(project: Path) -> None:
    """Two minutes of a bench with the number of the trial, and counts of an encoder."""
    time = np.arange(0, 120, 0.02)
    position = sum(np.sin(2 * np.pi * f * time + f) for f in (0.31, 0.77, 1.3))
    force = 1.8 * position + 0.1 * np.gradient(position, time)
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(time))
    write_columns(
        project / "bench.csv", time_s=time, position_mm=position, force_N=force + noise, trial=time // 60 + 1
    )
    columns = {"time [s]": time, "encoder [counts]": 100 * position, "torque transducer [V]": force / 35.15}
    write_columns(project / "counts.csv", "%.6f", **columns)


@pytest.mark.parametrize("page", [name for name, found in SHELL.items() if found and name not in NOT_RUN])
def test_shell_blocks_of_a_page_run(page, prepared, shared, tmp_path):
    (tmp_path / "shared").symlink_to(shared)  # where the studies of recordings of others look for them
    project = shutil.copytree(prepared, tmp_path / "project", symlinks=True)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = os.environ | {
        "PATH": path, "HOME": str(tmp_path), "PORT": port,
        "PYTHONPATH": str(PROJECT / "workflow"), "XDG_CACHE_HOME": str(ZIG_CACHE.parents[1]),
    }  # fmt: skip
    failed, told = [], ""
    for block in [BEFORE.get(page, ""), *SHELL[page]]:
        command = ["bash", "-c", ABRIDGED + block]
        ran = subprocess.run(
            command, cwd=project, env=environment, capture_output=True, text=True, check=False
        )
        if ran.returncode != (block in REFUSED):
            failed.append(f"{block}{ran.stdout[-1000:]}{ran.stderr[-1000:]}")
        written = project / "out" / "diagnosis.html"
        told += ran.stdout + (html.unescape(written.read_text("utf-8")) if written.is_file() else "")
    assert not failed, "\n".join(failed)
    assert [line for line in quoted(page) if not is_printed(line, told)] == []


def test_pages_that_are_not_run_are_there():
    assert set(NOT_RUN) <= {name for name, found in SHELL.items() if found}
