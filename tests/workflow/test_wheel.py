"""The wheel by itself, in an empty folder, does what the README promises of ``lumbar``."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import pictures
from running import PROJECT, ZIG_CACHE
from study_settings import study_settings

PACKED = ("pyproject.toml", "README.md", "LICENSE", "workflow")
FEWER = """
tissue: {bootstrap: {resamples: 100}}
improvement: {most_effects: 1}
surgeon: {bandwidth: {resamples: 200}}
survey: {resamples: 1000}
stability: {knots: 201, attack: {starts: 20}, checks: [simulation], grid: {knots: 101}}
"""

MAIN = "import sys; from lumbar.cli import main; sys.exit(main())"
ONE_AFTER_THE_OTHER = f"""
{Path(pictures.__file__).read_text(encoding="utf-8")}
import contextlib, io, json, sys
from lumbar.cli import main
said = []
for command in json.loads(sys.argv[1]):
    with sketched(), contextlib.redirect_stdout(io.StringIO()) as out:
        status = main(command)
    if status:
        sys.exit(f"{{command}}: status {{status}}")
    said.append(out.getvalue())
print(json.dumps(said))
"""
"""Each command in a process of its own would import SciPy a dozen times; pictures are sketched."""


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


def say(call, *commands):
    """What each command prints."""
    listed = json.dumps([[str(part) for part in command] for command in commands])
    return json.loads(call(listed, program=ONE_AFTER_THE_OTHER))


def test_the_wheel_is_what_runs(lumbar, installed):
    _, call = lumbar
    assert call(program="import lumbar; print(lumbar.__file__)").startswith(str(installed))
    version = call("--version").split()[1]
    assert f"version: {version}\n" in (PROJECT / "CITATION.cff").read_text(encoding="utf-8")
    assert (installed / f"lumbar-{version}.dist-info").is_dir()


@pytest.mark.nightly
def test_tissue_tests_become_models_a_diagnosis_and_fmus(lumbar, installed):
    from lumbar.settings.twin import SyntheticTissueSettings
    from lumbar.twin.tissue_recordings import play

    folder, call = lumbar
    (folder / "study.yaml").write_text(FEWER, encoding="utf-8")
    call("signals", "--band", 5, "--output", "signals")
    (folder / "tissue").mkdir()
    for number, name in enumerate(("multisine", "noise", "chirp")):
        signal, recording = folder / "signals" / f"{name}.csv", folder / "tissue" / f"{name}.csv"
        play(signal, recording, SyntheticTissueSettings(), 45, number)
    fewer = ("--config", "study.yaml")
    checked, identified, _, _, diagnosed, *_ = say(
        call,
        ("check", "tissue"),
        ("identify", "tissue", "--train", "multisine", "--output", "identified", *fewer),
        ("compare", "tissue", "--output", "compared"),
        ("locate", "tissue", "--output", "located"),
        ("diagnose", "tissue", "--output", "diagnosed", *fewer),
        ("refine", "tissue", "--add", "hardening_stiffness", "--output", "refined"),
        ("export", "identified/models.json", "--model", "KB", "--output", "fmu"),
        ("export", "refined/refined.json", "--output", "fmu"),
    )
    assert "multisine.csv: " in checked
    assert "models.json" in identified
    assert "missing hardening stiffness" in diagnosed
    assert (folder / "diagnosed" / "diagnosis.html").is_file()
    made = sorted(path.name for path in (folder / "fmu").iterdir())
    assert made == [
        f"KB{more}_fmi{version}.fmu" for more in ("+hardening_stiffness", "") for version in (2, 3)
    ]
    assert all(zipfile.is_zipfile(folder / "fmu" / name) for name in made)
    assert {path.name for path in (folder / "cache" / "lumbar").iterdir()} == {"zig"}
    beside = [path.name for path in installed.iterdir() if path.name != "bin"]
    assert sorted(name.split("-")[0] for name in beside) == ["lumbar", "lumbar"]
    assert not list(installed.rglob("*zig*"))


@pytest.mark.nightly
def test_surgeons_participants_and_lifts(lumbar):
    from lumbar.base.files import write_csv
    from lumbar.twin.lifting_recordings import write_lift
    from lumbar.twin.surgeon_recordings import surgeon_trial

    folder, call = lumbar
    (folder / "study.yaml").write_text(FEWER, encoding="utf-8")
    twin = study_settings().twin
    (folder / "surgeon").mkdir()
    for surgeon in twin.surgeon.surgeons:
        for number in (1, 2):
            name = f"{surgeon}_trial_{number}"
            write_csv(folder / "surgeon" / f"{name}.csv", surgeon_trial(name, surgeon, twin.surgeon, 45))
    write_lift(twin.lifting, "expert_23kg", [45], folder / "expert_23kg.c3d", None)
    shutil.copy(PROJECT / "config" / "subjects" / "expert.yaml", folder / "expert.yaml")
    sheet = PROJECT / "resources" / "survey" / "survey_reconstructed.csv"
    bandwidth, survey, *_ = say(
        call,
        ("bandwidth", "surgeon", "--config", "study.yaml"),
        ("survey", sheet, "--output", "survey", "--config", "study.yaml"),
        ("lift", "expert_23kg.c3d", "--subject", "expert.yaml", "--box-mass", 23, "--output", "lifted"),
        ("basin", "lifted/pendulum.csv", "--output", "lifted", "--config", "study.yaml"),
    )
    assert "velocity, power_share: 2." in bandwidth
    assert "45 participants" in survey
    rows = np.genfromtxt(
        folder / "lifted" / "boa.csv", delimiter=",", names=True, dtype=None, encoding="utf-8"
    )
    assert (rows["mean_area"] > 0).all()
