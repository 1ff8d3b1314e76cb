"""Running the workflow in a copy of the project, for tests."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from lumbar.tissue.fmu.build.compiler import cache_folder

PROJECT = Path(__file__).resolve().parent.parent
PARTS = ("Snakefile", "profiles", "config", "workflow", "resources", "envs")
ZIG_CACHE = cache_folder(None)
"""The cache that the workflow uses too, the user's; a cold one costs seconds and has a test of its own."""
NOT_INHERITED = ("PYTHONPATH", "LUMBAR_DATA", "PYTHONDONTWRITEBYTECODE")
"""Without bytecode, as in many containers, every job would compile the library again; a copy of the project may hold it."""


def python(*arguments: str | Path) -> str:
    """Run a Python of its own, which must end well; what it prints."""
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@dataclass(frozen=True)
class Run:
    """What one call of Snakemake said."""

    status: int
    text: str

    @property
    def jobs(self) -> dict[str, int]:
        """Number of jobs per rule from the table of jobs that Snakemake prints."""
        table = re.search(r"^job +count\n[- ]+\n(.*?)\n\n", self.text, flags=re.M | re.S)
        rows = table[1].splitlines() if table else []
        counts = {row.split()[0]: int(row.split()[1]) for row in rows}
        counts.pop("total", None)
        return counts

    def whole(self) -> Self:
        """Return it; it must have ended well."""
        assert self.status == 0, self.text[-6000:]
        return self


def copy_project(folder: Path) -> Path:
    """Copy what the workflow needs into `folder`, without results."""
    folder.mkdir(parents=True, exist_ok=True)
    ignore = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for part in PARTS:
        source = PROJECT / part
        if source.is_dir():
            shutil.copytree(source, folder / part, ignore=ignore)
        else:
            shutil.copy2(source, folder / part)
    return folder


def snakemake(folder: Path, *arguments: str, env: dict[str, str] | None = None) -> Run:
    """Call Snakemake in a project folder, as users do, with variables added to the inherited ones."""
    environment = {key: value for key, value in os.environ.items() if key not in NOT_INHERITED} | (env or {})
    command = [sys.executable, "-m", "snakemake", "--nocolor", *arguments]
    run = subprocess.run(
        command,
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        check=False,
        encoding="utf-8",
    )
    return Run(run.returncode, run.stdout)
