"""Fixtures that all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def project() -> Path:
    """Folder of the project."""
    return PROJECT


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of recordings for tests: beside the project, or where LUMBAR_SHARED says."""
    folder = Path(os.environ.get("LUMBAR_SHARED", PROJECT.parent / "shared"))
    if not (folder / "real").is_dir():
        pytest.skip(
            f"no recordings in {folder}: get those that config/studies/*.yaml name, as real/<data set>/ in a folder, "
            "and set LUMBAR_SHARED to it"
        )
    return folder


@pytest.fixture(scope="session")
def default_run(tmp_path_factory):
    """Folder of a project copy in which the default study was run with two cores, and what was printed."""
    from running import copy_project, snakemake

    folder = copy_project(tmp_path_factory.mktemp("default"))
    run = snakemake(folder, "--cores", "2")
    assert run.status == 0, run.text[-6000:]
    return folder, run
