"""The wheel by itself, in an empty folder, does what the README promises of ``lumbar``."""

import os
import shutil
import subprocess
import sys

import pytest

from column_files import write_records
from running import PROJECT, ZIG_CACHE
from twin_examples import example_records

pytestmark = pytest.mark.nightly
PACKED = ("pyproject.toml", "README.md", "LICENSE", "workflow")
MAIN = "import sys; from lumbar.cli import main; sys.exit(main())"


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Folder into which the project's own wheel was unpacked, without its dependencies and without the sources."""
    folder = tmp_path_factory.mktemp("wheel")
    sources = folder / "sources"
    sources.mkdir()
    for part in PACKED:
        ignore = shutil.ignore_patterns("__pycache__", "*.egg-info")
        copy = shutil.copytree if (PROJECT / part).is_dir() else shutil.copy2
        copy(PROJECT / part, sources / part, **({"ignore": ignore} if copy is shutil.copytree else {}))
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    build = [*pip, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(sources)]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    subprocess.run([*pip, "install", "--no-deps", "--target", str(folder / "site"), str(wheel)], check=True)
    shutil.rmtree(sources)
    return folder / "site"


@pytest.fixture(scope="module")
def lumbar(installed, tmp_path_factory):
    """Call a program of the installed package in an empty folder; return that folder and the function."""
    folder = tmp_path_factory.mktemp("empty")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("LUMBAR_")}
    environment |= {"PYTHONPATH": str(installed), "XDG_CACHE_HOME": str(folder / "cache")}
    # What the compiler builds once of a platform, another test lets it build from nothing.
    ZIG_CACHE.mkdir(parents=True, exist_ok=True)
    (folder / "cache" / "lumbar").mkdir(parents=True)
    (folder / "cache" / "lumbar" / "zig").symlink_to(ZIG_CACHE)

    def call(*arguments, program=MAIN):
        command = [sys.executable, "-P", "-c", program, *map(str, arguments)]
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr[-3000:]
        return done.stdout

    return folder, call


def test_command_runs_from_the_installed_wheel(lumbar, installed):
    _, call = lumbar
    assert call(program="import lumbar; print(lumbar.__file__)").startswith(str(installed))
    version = call("--version").split()[1]
    assert f"version: {version}\n" in (PROJECT / "CITATION.cff").read_text(encoding="utf-8")
    assert (installed / f"lumbar-{version}.dist-info").is_dir()


def test_wheel_contains_every_file_of_the_library(installed):
    """Templates, catalogues, C sources and tables too: what they are for, other tests try in the sources."""

    def files(root):
        return {
            path.relative_to(root) for path in root.rglob("*") if path.is_file() and path.suffix != ".pyc"
        }

    assert files(installed / "lumbar") == files(PROJECT / "workflow" / "lumbar")


def test_tissue_tests_become_models_a_diagnosis_and_an_fmu(lumbar, installed):
    """Nothing is written into the package, and nothing beside its cache."""
    folder, call = lumbar
    write_records(folder / "tissue", example_records())
    assert "coulomb friction" in call("diagnose", "tissue", "--output", "diagnosed")
    assert (folder / "diagnosed" / "diagnosis.html").is_file()
    call("export", "diagnosed/refined.json", "--model", "KB", "--output", "fmu")
    made = sorted(path.name for path in (folder / "fmu").iterdir())
    assert made == [f"KB_fmi{version}.fmu" for version in (2, 3)]
    assert {path.name for path in (folder / "cache" / "lumbar").iterdir()} == {"zig"}
    beside = [path.name for path in installed.iterdir() if path.name != "bin"]
    assert sorted(name.split("-")[0] for name in beside) == ["lumbar", "lumbar"]
    assert not list(installed.rglob("*zig*"))
