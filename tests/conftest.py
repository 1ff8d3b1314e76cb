"""Fixtures that all tests share."""

import os
import pickle
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock

from lumbar.base.environment import use_one_thread

# In containers that leave no bytecode behind every program that a test starts would compile the library again.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
use_one_thread()  # as in the workflow, and before numpy is imported: workers would fight for the cores

TESTS = Path(__file__).resolve().parent
PROJECT = TESTS.parent


def pytest_collection_modifyitems(items):
    """Mark tests by their folder: what starts Snakemake is an integration test, all else a unit test.

    Files of integration tests take minutes: they begin, so that no worker is left with one at the end.
    """
    folders = tuple(f"{TESTS / name}{os.sep}" for name in ("workflow", "end_to_end", "browser"))
    for item in items:
        item.add_marker("integration" if str(item.path).startswith(folders) else "unit")
    items.sort(key=lambda item: item.get_closest_marker("integration") is None)


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
            f"no recordings in {folder}: get those that config/studies/*.yaml and tests/real_records/README.md name, as "
            "real/<data set>/ in a folder, and set LUMBAR_SHARED to it"
        )
    return folder


@dataclass(frozen=True)
class SharedResults:
    """Things made once below one folder that all workers of a session see."""

    root: Path

    def __call__(self, name: str, make: Callable[[Path], Any]) -> tuple[Path, Any]:
        """Return the folder ``root/name``, filled by `make`, and what `make` returned, which can be pickled.

        Where `make` failed in one worker, all fail: it is not tried again.
        """
        folder, outcome = self.root / name, self.root / f"{name}.outcome"
        with FileLock(self.root / f"{name}.lock"):
            if not outcome.exists():
                folder.mkdir()
                outcome.write_bytes(pickle.dumps(_attempt(make, folder)))
        error, made = pickle.loads(outcome.read_bytes())
        assert error is None, f"{name}: {error}"
        return folder, made


def _attempt(make: Callable[[Path], Any], folder: Path) -> tuple[str | None, Any]:
    try:
        return None, make(folder)
    except Exception as error:
        return f"{type(error).__name__}: {error}", None


@pytest.fixture(scope="session")
def share_result(tmp_path_factory):
    """Return what makes results once for all workers of a session, by name."""
    base = tmp_path_factory.getbasetemp()
    return SharedResults(base.parent if "PYTEST_XDIST_WORKER" in os.environ else base)


@pytest.fixture(scope="session")
def saved_lift(share_result):
    """Folder of a saved synthetic lift, and the page that was made before it was saved."""
    import lumbar
    from lumbar.twin.examples import example_lift

    def analyse(folder):
        lifter = example_lift(folder / "lift.c3d")
        lift = lumbar.lift(folder / "lift.c3d", lifter, box_mass_kg=15, source_label="synthetic twin")
        lift.save(folder)
        return lumbar.lift_page(lift).to_html()

    return share_result("lift", analyse)
