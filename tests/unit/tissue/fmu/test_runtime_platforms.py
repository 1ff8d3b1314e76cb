"""FMUs on every platform and in other importers than fmpy: the same bits, timing of samples, threads, sanitizers."""

import csv
import os
import shutil
import struct
import subprocess
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from c_programs import ON_LINUX, WINE, loader_program, with_wine, write_sources
from effect_entries import COMBINATIONS, FIVE_EFFECTS, effect_entry
from runtime_models import SETTINGS, TARGET, entry, models_json, selected
from spatial_models import FIVE, integrated, spatial_export

from lumbar.base.errors import InputError
from lumbar.tissue.fmu.build import compiler
from lumbar.tissue.fmu.build.compiler import TARGETS, host_target, resolve_targets
from lumbar.tissue.fmu.build.package import export_fmus, fmu_contents, universal_library
from patience import PATIENCE_S
from study_settings import changed

HERE = Path(__file__).parents[2]
QEMU = shutil.which("qemu-aarch64")
ARM_LIBRARIES = Path("/usr/aarch64-linux-gnu")
STEPS = 200_000
with_qemu = pytest.mark.skipif(
    QEMU is None or not ARM_LIBRARIES.is_dir(),
    reason="no qemu-aarch64 or no C library for it: apt-get install qemu-user libc6-arm64-cross",
)
NONLINEAR = effect_entry(
    "KB", "coulomb_friction/stribeck", "hysteresis/dahl", "softening/path", "periodic_disturbance/sine"
)


def some_models():
    """KB, a static gain, and a model with effects."""
    entries = [entry("KB", [1.9, -1.2], [1.0, -0.45]), entry("gain", [1.0], [1.0])]
    linear = selected(
        models_json(*entries), changed(SETTINGS, models=["KB", "gain"], moving_average_ms=0, output_limit=1e9)
    )
    settings = changed(SETTINGS, models=[NONLINEAR["name"]])
    return [*linear, *selected(models_json(NONLINEAR), settings)]


@pytest.fixture(scope="module")
def platform_fmus(zig_cache, tmp_path_factory):
    """Return a function that builds the models for one target and unzips the FMI 3.0 files."""
    built = {}

    def build(target: str) -> dict[str, Path]:
        if target not in built:
            folder = tmp_path_factory.mktemp(target)
            for path in export_fmus(some_models(), folder, "test", [target], zig_cache):
                with zipfile.ZipFile(path) as archive:
                    archive.extractall(folder / path.stem)
            program = loader_program(HERE / "fmu_client.c", target, folder, zig_cache)
            built[target] = {"program": program, "folder": folder}
        return built[target]

    return build


def run_client(build: dict, target: str, mode: str, name: str, *arguments, before=()) -> str:
    model = build["folder"] / f"{name}_fmi3"
    description = fmpy.read_model_description(str(model))
    identifier = description.coSimulation.modelIdentifier
    library = model / "binaries" / TARGETS[target].fmi3 / f"{identifier}{TARGETS[target].suffix}"
    environment = {**os.environ, "WINEPREFIX": str(build["folder"] / "wine"), "WINEDEBUG": "-all"}
    command = [*before, build["program"], mode, library, description.instantiationToken, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.nightly
@ON_LINUX
@with_wine
@pytest.mark.parametrize("name", ["KB", NONLINEAR["name"]])
def test_forces_on_windows_are_those_on_linux(name, platform_fmus):
    linux = run_client(platform_fmus("x86_64-linux"), "x86_64-linux", "hash", name, STEPS)
    windows = platform_fmus("x86_64-windows")
    assert run_client(windows, "x86_64-windows", "hash", name, STEPS, before=[WINE]) == linux


@ON_LINUX
@with_qemu
@pytest.mark.parametrize("name", ["KB", pytest.param(NONLINEAR["name"], marks=pytest.mark.nightly)])
def test_forces_on_arm_are_those_on_intel(name, platform_fmus):
    linux = run_client(platform_fmus("x86_64-linux"), "x86_64-linux", "hash", name, STEPS)
    arm = platform_fmus("aarch64-linux")
    emulated = [QEMU, "-L", ARM_LIBRARIES]
    assert run_client(arm, "aarch64-linux", "hash", name, STEPS, before=emulated) == linux


@ON_LINUX
@pytest.mark.parametrize("step", [pytest.param("0.01", marks=pytest.mark.nightly), "0.001"])
def test_no_sample_of_ten_million_is_mistimed(step, platform_fmus):
    """A client that sums up steps of 10 ms and 1 ms; a sample is mistimed where the force is another's."""
    build = platform_fmus("x86_64-linux")
    assert run_client(build, "x86_64-linux", "mistimed", "gain", 10_000_000, step) == "0"


@ON_LINUX
@pytest.mark.parametrize("name", ["KB", NONLINEAR["name"]])
def test_eight_instances_in_threads_are_alike(name, platform_fmus):
    assert run_client(platform_fmus("x86_64-linux"), "x86_64-linux", "threads", name, 50_000) == "0"


@pytest.mark.nightly
@ON_LINUX
@with_wine
def test_all_platforms_fit_into_200_kilobytes(zig_cache, tmp_path):
    """A linear model, and the most effects that a diagnosis adds at the rate of a haptic loop."""
    chosen = changed(SETTINGS, models=[FIVE_EFFECTS["name"]], rate_Hz=1000, moving_average_ms=3.0)
    models = [some_models()[0], *selected(models_json(FIVE_EFFECTS), chosen)]
    for path in export_fmus(models, tmp_path, "synthetic twin", list(TARGETS), zig_cache):
        assert path.stat().st_size <= 200_000, path.name


def test_folders_are_those_of_each_standard():
    """FMI 2.0 has platforms of its own names and one macOS; FMI 3.0 names processor and system."""
    model = some_models()[0]
    mach_o = struct.pack("<III", 0xFEEDFACF, 0x01000007, 3) + b"code"
    libraries = dict.fromkeys(TARGETS, mach_o)
    found = {
        version: {
            name.split("/")[1] for name in fmu_contents(model, version, "", libraries) if "binaries" in name
        }
        for version in ("2.0", "3.0")
    }
    assert found["2.0"] == {"linux64", "win64", "darwin64", "aarch64-linux"}
    assert found["3.0"] == {
        "x86_64-linux",
        "x86_64-windows",
        "aarch64-linux",
        "x86_64-darwin",
        "aarch64-darwin",
    }


def test_universal_library_is_read_back():
    """By the layout of mach-o/fat.h, written out here once more."""
    parts = [
        struct.pack("<III", 0xFEEDFACF, cpu, kind) + bytes([cpu & 255]) * 40_000
        for cpu, kind in ((7, 3), (12, 0))
    ]
    joined = universal_library(parts)
    magic, count = struct.unpack_from(">II", joined)
    assert (magic, count) == (0xCAFEBABE, 2)
    for index, part in enumerate(parts):
        cpu, _, offset, size, align = struct.unpack_from(">IIIII", joined, 8 + 20 * index)
        assert cpu == part[4]
        assert offset % (1 << align) == 0
        assert joined[offset : offset + size] == part
    with pytest.raises(ValueError, match="Mach-O"):
        universal_library([b"\x7fELF" + bytes(20)])


def test_host_is_this_machine_and_others_are_named(monkeypatch):
    assert resolve_targets(["host"]) == [host_target()]
    assert resolve_targets(["x86_64-windows", "host", "x86_64-linux"])[0] == "x86_64-linux"
    monkeypatch.setattr(compiler, "machine", lambda: "ARM64")
    monkeypatch.setattr(compiler, "system", lambda: "Darwin")
    assert host_target() == "aarch64-darwin"
    monkeypatch.setattr(compiler, "machine", lambda: "riscv64")
    with pytest.raises(InputError, match=r"riscv64-darwin.*x86_64-linux"):
        host_target()
    with pytest.raises(InputError, match="allowed are host"):
        resolve_targets([])


SANITIZED = ["-std=c99", "-g", "-O1", "-Wall", "-Wextra", "-Werror"]
SANITIZED += ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


@ON_LINUX
@pytest.mark.skipif(
    shutil.which("gcc") is None, reason="no gcc with sanitizers: apt-get install gcc libc6-dev"
)
@pytest.mark.parametrize(
    "kind",
    ["linear", *(pytest.param(kind, marks=pytest.mark.nightly) for kind in ("effects", "space"))],
)
def test_misuse_is_answered_and_sanitizers_find_nothing(kind, tmp_path):
    """Address and undefined-behaviour sanitizers of gcc: another compiler than the FMUs are built with.

    First every misuse with the status that it should give, of scalars, then calls in any order with any values.
    """
    guarded = spatial_export(FIVE, device_damping=2.0, output_rate_limit=500.0)
    linear, _, effects = some_models()
    files = write_sources({"linear": linear, "effects": effects, "space": guarded}[kind], tmp_path)
    shutil.copy(HERE / "fmu_misuse.c", tmp_path)
    command = ["gcc", *SANITIZED, "fmu_misuse.c", *files, "-lm", "-o", "misuse"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    for arguments in ([], ["random", "1", "200000"], ["random", "2", "200000"])[kind == "space" :]:
        done = subprocess.run(
            [tmp_path / "misuse", *arguments], capture_output=True, text=True, check=False, timeout=PATIENCE_S
        )
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


FOLDER = Path(os.environ.get("LUMBAR_IMPORTERS", "absent"))
"""Made by tests/get_fmusim.sh."""
GET_FMUSIM = "tests/get_fmusim.sh FOLDER and set LUMBAR_IMPORTERS=FOLDER"
FMUSIM = FOLDER / "bin" / "fmusim"
EFFECTS = effect_entry(*COMBINATIONS[1])
NAMES = ["IL", "MW", "KB", "HO", "KB+coulomb_friction", EFFECTS["name"]]
STEP = "0.01"
with_fmusim = pytest.mark.skipif(
    not FMUSIM.exists(),
    reason=f"no fmusim: apt-get install cargo, put its sources into LUMBAR_SHARED/importers/fmusim, then {GET_FMUSIM}",
)


@pytest.fixture(scope="module")
def folder(fmu_folder, zig_cache):
    """Return the folder of shared FMUs, with one more whose input and output forms have memory."""
    chosen = selected(models_json(EFFECTS), changed(SETTINGS, models=[EFFECTS["name"]]))
    export_fmus(chosen, fmu_folder, "synthetic twin", TARGET, zig_cache)
    return fmu_folder


def fmusim(fmu: Path, folder: Path, *options: str, step: str = STEP) -> list:
    """Forces that fmusim, the FMI project's own simulator, records for the file's reference input, one per instant."""
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder, ["resources/reference_input.csv"])
    inputs, outputs = folder / "resources" / "reference_input.csv", folder / "forces.csv"
    with inputs.open() as file:
        end = list(csv.DictReader(file))[-1]["time"]
    command = [FMUSIM, "simulate", "--input-file", inputs, "--output-file", outputs, "--stop-time", end]
    command += ["--output-interval", step, *options, fmu]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    with outputs.open() as file:  # at an event it records before and after: the last row of an instant counts
        return list({row["time"]: forces_of(row) for row in csv.DictReader(file)}.values())


def forces_of(row: dict[str, str]):
    """Force of a recorded row: a number, or the vector of an array or of scalars."""
    values = " ".join(text for name, text in row.items() if name.partition("[")[0] == "force").split()
    return float(values[0]) if len(values) == 1 else list(map(float, values))


def embedded(fmu: Path, name: str) -> list[float]:
    """Column of a reference signal of an FMU."""
    with zipfile.ZipFile(fmu) as archive:
        rows = archive.read(f"resources/{name}.csv").decode().splitlines()[1:]
    return [float(row.split(",")[1]) for row in rows]


@ON_LINUX
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


@ON_LINUX
@with_fmusim
@pytest.mark.parametrize(("version", "options"), [(2, []), (3, []), (3, ["--event-mode-used"])])
def test_fmusim_reads_the_vectors_of_an_integration_of_its_own(version, options, zig_cache, tmp_path):
    export_fmus([spatial_export(FIVE)], tmp_path, "own", TARGET, zig_cache)
    (fmu,) = tmp_path.glob(f"*_fmi{version}.fmu")
    subprocess.run([FMUSIM, "validate", fmu], check=True, capture_output=True)
    read = np.array(fmusim(fmu, tmp_path, *options, step="0.001"))
    cells = (tmp_path / "resources" / "reference_input.csv").read_text().replace(",", " ").splitlines()[1:]
    expected = integrated(np.array([row.split()[1:] for row in cells], dtype=float), 1e-3)
    if not options:
        expected = np.concatenate([expected[:1], expected[:-1]])
    assert np.abs(expected).max() > 1.0
    assert np.abs(read - expected).max() <= 1e-12 * np.abs(expected).max()
