"""FMUs in importers other than fmpy: the same bits as from fmpy, one by one, where the importer does not round inputs."""

import csv
import os
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest
from c_programs import ON_LINUX
from effect_entries import COMBINATIONS, effect_entry
from runtime_models import POSITION, SETTINGS, TARGET, get, models_json, put, selected

from lumbar.tissue.fmu.build.package import export_fmus
from study_settings import changed

FOLDER = Path(os.environ.get("LUMBAR_IMPORTERS", "absent"))
"""Made by tests/get_importers.sh."""
GET_IMPORTERS = "tests/get_importers.sh FOLDER and set LUMBAR_IMPORTERS=FOLDER"
PYTHON = FOLDER / "python" / "bin" / "python"
FMUSIM = FOLDER / "bin" / "fmusim"
HERE = Path(__file__).parents[3] / "importers"
EFFECTS = effect_entry(*COMBINATIONS[1])
NAMES = ["IL", "MW", "KB", "HO", "KB+coulomb_friction", EFFECTS["name"]]
STEP = "0.01"
pytestmark = ON_LINUX
with_python = pytest.mark.skipif(not PYTHON.exists(), reason=f"no libcosim and Ecos: {GET_IMPORTERS}")
with_java = pytest.mark.skipif(
    not (FOLDER / "jars").is_dir() or shutil.which("java") is None,
    reason=f"no FMI4j: apt-get install default-jre maven, then {GET_IMPORTERS}",
)
with_fmusim = pytest.mark.skipif(
    not FMUSIM.exists(),
    reason=f"no fmusim: apt-get install cargo, put its sources there, then {GET_IMPORTERS}",
)


@pytest.fixture(scope="module")
def folder(fmu_folder, zig_cache):
    """Return the folder of shared FMUs, with one more whose input and output forms have memory."""
    chosen = selected(models_json(EFFECTS), changed(SETTINGS, models=[EFFECTS["name"]]))
    export_fmus(chosen, fmu_folder, "synthetic twin", TARGET, zig_cache)
    return fmu_folder


@pytest.fixture(scope="module")
def positions_file(fmu_positions, tmp_path_factory):
    """Return a CSV file with time and position."""
    path = tmp_path_factory.mktemp("positions") / "positions.csv"
    rows = [f"{k * float(STEP)!r},{value!r}" for k, value in enumerate(fmu_positions.tolist())]
    path.write_text("\n".join(["time,position", *rows]) + "\n")
    return path


@pytest.fixture
def expected(folder, fmu_instance, fmu_positions):
    """Return a function that plays the positions through fmpy as importers do: set, step, get."""

    def forces(name: str, version: int) -> list[float]:
        slave = fmu_instance(name, version)
        slave.exitInitializationMode()
        read = []
        for k, position in enumerate(fmu_positions.tolist()):
            put(slave, POSITION, position)
            slave.doStep(k * float(STEP), float(STEP))
            read.append(get(slave))
        return read

    return forces


def printed(command: list, **environment: str) -> list[float]:
    """Forces that a program prints, one in a line; importers print lines of their own between them."""
    done = subprocess.run(
        [*map(str, command)], capture_output=True, text=True, check=False, env={**os.environ, **environment}
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    lines = [line for line in done.stdout.splitlines() if line.startswith(("0x", "-0x"))]
    return [float.fromhex(line) for line in lines]


def players() -> list:
    """Command, version of FMI (libcosim of libcosimpy 0.0.6 and FMI4j 0.38 have no FMI 3.0) and mark of each that plays rows."""
    java = ["java", "-cp", f"{FOLDER}/jars/*", HERE / "PlayFmi4j.java"]
    ecos = [PYTHON, HERE / "play_ecos.py"]
    return [
        pytest.param([PYTHON, HERE / "play_libcosim.py"], 2, marks=with_python, id="libcosim-fmi2"),
        *(pytest.param(ecos, version, marks=with_python, id=f"ecos-fmi{version}") for version in (2, 3)),
        pytest.param(java, 2, marks=with_java, id="fmi4j-fmi2"),
    ]


@pytest.mark.parametrize(("player", "version"), players())
@pytest.mark.parametrize("name", NAMES)
def test_another_importer_reads_the_forces(name, player, version, folder, positions_file, expected):
    command = [*player, folder / f"{name}_fmi{version}.fmu", positions_file, STEP]
    libraries = {"LD_LIBRARY_PATH": str(FOLDER / "python" / "lib")} if "play_ecos" in str(player[-1]) else {}
    assert printed(command, **libraries) == expected(name, version)


def fmusim(fmu: Path, folder: Path, *options: str) -> list[float]:
    """Forces that fmusim, the FMI project's own simulator, records for the file's reference input, one per instant."""
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder, ["resources/reference_input.csv"])
    inputs, outputs = folder / "resources" / "reference_input.csv", folder / "forces.csv"
    with inputs.open() as file:
        end = list(csv.DictReader(file))[-1]["time"]
    command = [FMUSIM, "simulate", "--input-file", inputs, "--output-file", outputs, "--stop-time", end]
    command += ["--output-interval", STEP, *options, fmu]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    with outputs.open() as file:  # at an event it records before and after: the last row of an instant counts
        return list({row["time"]: float(row["force"]) for row in csv.DictReader(file)}.values())


def embedded(fmu: Path, name: str) -> list[float]:
    """Column of a reference signal of an FMU."""
    with zipfile.ZipFile(fmu) as archive:
        rows = archive.read(f"resources/{name}.csv").decode().splitlines()[1:]
    return [float(row.split(",")[1]) for row in rows]


@with_fmusim
@pytest.mark.parametrize(
    ("version", "options", "reference"),
    [
        (2, [], "reference_output"),
        (3, [], "reference_output_without_event_mode"),
        (3, ["--event-mode-used"], "reference_output"),
        (3, ["--event-mode-used", "--early-return-allowed"], "reference_output"),
    ],
)
@pytest.mark.parametrize("name", NAMES)
def test_fmusim_validates_and_reads_the_embedded_references(
    name, version, options, reference, folder, tmp_path
):
    fmu = folder / f"{name}_fmi{version}.fmu"
    subprocess.run([FMUSIM, "validate", fmu], check=True, capture_output=True)
    read, expected = fmusim(fmu, tmp_path, *options), embedded(fmu, reference)
    assert read == pytest.approx(expected, rel=0, abs=1e-11)
    assert max(map(abs, expected)) > 1.0
