"""Python environments for `make test-portable`: the locked, the lowest and the newest packages that are allowed."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

from portable.runs import Run

PROJECT = Path(__file__).resolve().parents[2]


def interpreter_of(run: Run, output: Path, log: Path) -> Path:
    """Return the interpreter of a run; its environment is made below ``<output>/environments`` where it is missing.

    Raises
    ------
    subprocess.CalledProcessError
        The packages could not be installed: the log says why.
    """
    if run.packages == "present":
        return run.python
    folder = output / "environments" / run.name.replace(" ", "_")
    python = folder / "bin" / "python"
    if (folder / "installed").is_file():
        return python
    with log.open("w", encoding="utf-8") as stream:

        def call(*command):
            subprocess.run(command, cwd=PROJECT, stdout=stream, stderr=subprocess.STDOUT, check=True)

        call(run.python, "-m", "venv", "--clear", folder)
        pip = (python, "-m", "pip", "--disable-pip-version-check", "install", "--quiet")
        if run.packages == "locked":
            call(*pip, "--require-hashes", "-r", "envs/build-lock.txt")
            call(*pip, "--require-hashes", "--no-build-isolation", "-r", "envs/lock.txt")
        else:
            call(*pip, *requirements(run.packages))
    (folder / "installed").touch()
    return python


def requirements(packages: str) -> list[str]:
    """Return the requirements of pyproject.toml, each at its lower bound or without upper limit."""
    description = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))
    wanted = description["project"]["dependencies"]
    if packages == "lowest":
        wanted = [re.sub(r">=", "==", requirement) for requirement in wanted]
    return [*wanted, *description["dependency-groups"]["dev"]]
