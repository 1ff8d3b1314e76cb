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
        pytest.skip(f"no recordings for tests in {folder} (set LUMBAR_SHARED)")
    return folder
