"""Fixtures that all tests share."""

import os
import sys
from pathlib import Path

import pytest

from lumbar.base.environment import use_one_thread
from making_once import MadeOnce

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
    for item in items:
        starts_snakemake = {TESTS / "workflow", TESTS / "end_to_end", TESTS / "browser"} & set(
            item.path.parents
        )
        item.add_marker("integration" if starts_snakemake else "unit")
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


@pytest.fixture(scope="session")
def made_once(tmp_path_factory):
    """Make things once for all workers of a session, by name."""
    own = tmp_path_factory.getbasetemp()
    return MadeOnce(own.parent if "PYTEST_XDIST_WORKER" in os.environ else own)


@pytest.fixture(scope="session")
def saved_lift(made_once):
    """Folder of a saved synthetic lift, and the page that was made before it was saved."""
    import lumbar
    from lumbar.twin.examples import example_lift

    def analyse(folder):
        somebody = example_lift(folder / "lift.c3d")
        lift = lumbar.lift(folder / "lift.c3d", somebody, box_mass_kg=15, data="synthetic twin")
        lift.save(folder)
        return lumbar.lift_page(lift).to_html()

    return made_once("lift", analyse)
