"""FMUs on every platform, in the loaders of examples/haptic_runtime, and in fmusim: the same forces, and answers to misuse."""

import csv
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import fmpy
import numpy as np
import pytest
from c_programs import (
    ON_LINUX,
    WINE,
    add_library,
    compile_object,
    library_path,
    loader_program,
    with_wine,
    write_sources,
)
from driven_fmu import DrivenFmu
from effect_entries import COMBINATIONS, effect_entry
from runtime_models import RANGE, TARGET, contents, entry, export, exported, unzipped
from spatial_models import FIVE, integrated, spatial_export

from patience import PATIENCE_S
from running import PROJECT

pytestmark = ON_LINUX
HERE = Path(__file__).parents[2]
LOADERS = PROJECT / "examples" / "haptic_runtime"
STUBS = PROJECT / "tests" / "loaders"
UNITY = LOADERS / "unity"
QEMU = shutil.which("qemu-aarch64")
ARM_LIBRARIES = Path("/usr/aarch64-linux-gnu")
LINUX = TARGET[0]
FMUSIM = Path(os.environ.get("LUMBAR_IMPORTERS", "absent")) / "bin" / "fmusim"
"""Made by tests/get_fmusim.sh."""
with_mono = pytest.mark.skipif(
    shutil.which("mcs") is None or shutil.which("mono") is None,
    reason="no C# compiler: apt-get install mono-mcs mono-runtime libmono-system-xml4.0-cil",
)
with_cpp = pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler: apt-get install g++")
with_gcc = pytest.mark.skipif(
    shutil.which("gcc") is None, reason="no gcc with sanitizers: apt-get install gcc libc6-dev"
)
with_qemu = pytest.mark.skipif(
    QEMU is None or not ARM_LIBRARIES.is_dir(),
    reason="no qemu-aarch64 or no C library for it: apt-get install qemu-user libc6-arm64-cross",
)
with_fmusim = pytest.mark.skipif(
    not FMUSIM.exists(),
    reason="no fmusim: apt-get install cargo, put its sources into LUMBAR_SHARED/importers/fmusim, then "
    "tests/get_fmusim.sh FOLDER and set LUMBAR_IMPORTERS=FOLDER",
)
NONLINEAR = effect_entry(
    "KB", "coulomb_friction/stribeck", "hysteresis/dahl", "softening/path", "periodic_disturbance/sine"
)
EFFECTS = effect_entry(*COMBINATIONS[1])


def output_of(*command, **options) -> str:
    """Run a program, which must end well and print no error, and return its output."""
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, **options)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    return done.stdout


def platform_models():
    """KB, a static gain, and a model with effects."""
    linear = {"moving_average_ms": 0, "output_limit": 1e9}
    kb = exported(entry("KB", [1.9, -1.2], [1.0, -0.45]), **linear)
    return [kb, exported(entry("gain", [1.0], [1.0]), **linear), exported(NONLINEAR)]


@pytest.fixture(scope="module")
def run_client(zig_cache, tmp_path_factory):
    """Return a function that runs a mode of fmu_client.c on one of the platform's models."""
    built = {}

    def run(target: str, mode: str, name: str, *arguments, before=()) -> str:
        if target not in built:
            folder = tmp_path_factory.mktemp(target)
            for path in export(platform_models(), folder, targets=[target], versions=["3.0"]):
                unzipped(path, folder / path.stem)
            built[target] = folder, loader_program(HERE / "fmu_client.c", target, folder, zig_cache)
        folder, program = built[target]
        fmu = folder / f"{name}_fmi3"
        token = fmpy.read_model_description(str(fmu)).instantiationToken
        environment = {**os.environ, "WINEPREFIX": str(folder / "wine"), "WINEDEBUG": "-all"}
        command = [*before, program, mode, library_path(fmu, target), token, *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    return run


@pytest.mark.parametrize("name", ["KB", NONLINEAR["name"]])
@pytest.mark.parametrize(
    ("target", "before"),
    [
        pytest.param("x86_64-windows", [WINE], marks=[pytest.mark.nightly, with_wine]),
        pytest.param("aarch64-linux", [QEMU, "-L", ARM_LIBRARIES], marks=with_qemu),
    ],
)
def test_forces_on_other_platforms_are_those_on_linux(target, before, name, run_client):
    expected = run_client(LINUX, "hash", name, 200_000)
    assert run_client(target, "hash", name, 200_000, before=before) == expected


@pytest.mark.parametrize("step", [pytest.param("0.01", marks=pytest.mark.nightly), "0.001"])
def test_no_sample_of_ten_million_is_mistimed(step, run_client):
    """A client that sums up steps of 10 ms and 1 ms; a mistimed sample has the force of another one."""
    assert run_client(LINUX, "mistimed", "gain", 10_000_000, step) == "0"


@pytest.mark.parametrize("name", ["KB", NONLINEAR["name"]])
def test_eight_instances_in_threads_are_equal(name, run_client):
    assert run_client(LINUX, "threads", name, 50_000) == "0"


SANITIZED = ["-std=c99", "-g", "-O1", "-Wall", "-Wextra", "-Werror"]
SANITIZED += ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


@with_gcc
@pytest.mark.parametrize(
    "kind",
    ["linear", *(pytest.param(kind, marks=pytest.mark.nightly) for kind in ("effects", "space"))],
)
def test_misuse_is_rejected_and_sanitizers_find_no_fault(kind, tmp_path):
    """Address and undefined-behaviour sanitizers of gcc: another compiler than the FMUs are built with.

    First every misuse with the status that it should give, of scalars, then calls in any order with any values.
    """
    guarded = spatial_export(FIVE, device_damping=2.0, output_rate_limit=500.0)
    linear, _, effects = platform_models()
    files = write_sources({"linear": linear, "effects": effects, "space": guarded}[kind], tmp_path)
    shutil.copy(HERE / "fmu_misuse.c", tmp_path)
    command = ["gcc", *SANITIZED, "fmu_misuse.c", *files, "-lm", "-o", "misuse"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    for arguments in ([], ["random", "1", "200000"], ["random", "2", "200000"])[kind == "space" :]:
        assert output_of(tmp_path / "misuse", *arguments, timeout=PATIENCE_S) == ""


@pytest.fixture(scope="module")
def fmus(fmu_folder, tmp_path_factory):
    """Return a folder with unzipped FMUs: KB for FMI 3.0, ``old`` for FMI 2.0, ``empty`` without a library, ``space``."""
    folder = tmp_path_factory.mktemp("unzipped")
    files = {"KB": "KB_fmi3", "old": "KB_fmi2", "empty": "KB_fmi3", "effects": "KB+coulomb_friction_fmi3"}
    for name, file in files.items():
        unzipped(fmu_folder / f"{file}.fmu", folder / name)
    shutil.rmtree(folder / "empty" / "binaries")
    (made,) = export([spatial_export(FIVE)], folder, versions=["3.0"])
    unzipped(made, folder / "space")
    return folder


@pytest.fixture(scope="module")
def player(zig_cache, tmp_path_factory):
    """Return a function that plays rows of time and position through the loader in C."""
    program = loader_program(LOADERS / "play_fmu.c", LINUX, tmp_path_factory.mktemp("player"), zig_cache)
    return lambda *arguments: run_player([program], *arguments)


def run_player(command: list, folder: Path, rows, *parameters: str, environment=None) -> np.ndarray:
    """Forces that a player prints for rows of time and position, or for a file of them."""
    file = rows
    if not isinstance(rows, Path):
        file = folder.parent / "rows.csv"
        table = ([f"{value:.17g}" for value in row] for row in np.asarray(rows).tolist())
        lines = [f"{time},{' '.join(position)}" for time, *position in table]
        file.write_text("\n".join(["time,position", *lines]))
    head, *lines = output_of(*command, folder, file, *parameters, env=environment).splitlines()
    assert head == "time,position,force"
    forces = np.array([line.split(",")[2].split() for line in lines], dtype=float)
    return forces[:, 0] if forces.shape[1] == 1 else forces


def compile_csharp(program: Path, sources: list[Path], *flags: str) -> None:
    command = ["mcs", "-warn:4", "-warnaserror", *flags, f"-out:{program}", "-r:System.Xml", *sources]
    subprocess.run(command, check=True)


@pytest.fixture(scope="module")
def csharp_player(tmp_path_factory):
    """Return the same for the loader in C#."""
    program = tmp_path_factory.mktemp("csharp") / "play.exe"
    sources = [LOADERS / "PlayFmu.cs", UNITY / "Runtime" / "TissueForce.cs"]
    compile_csharp(program, sources)
    return lambda *arguments: run_player(["mono", program], *arguments)


@pytest.fixture(scope="module")
def windows_player(fmus, zig_cache, tmp_path_factory):
    """Return the same for the loader in C as a program of Windows."""
    for name in ("KB", "effects", "space"):
        add_library(fmus / name, "x86_64-windows", zig_cache)
    folder = tmp_path_factory.mktemp("windows")
    program = loader_program(LOADERS / "play_fmu.c", "x86_64-windows", folder, zig_cache)
    environment = {**os.environ, "WINEPREFIX": str(folder / "wine"), "WINEDEBUG": "-all"}
    # Wine's first run makes its folder and reports it.
    subprocess.run([WINE, program], env=environment, check=False, capture_output=True)
    return lambda *arguments: run_player([WINE, program], *arguments, environment=environment)


@pytest.mark.parametrize("name", ["KB", "effects", "space"])
def test_the_embedded_reference_is_run_player(name, fmus, player):
    folder = fmus / name
    forces = player(folder, folder / "resources" / "reference_input.csv")
    expected = DrivenFmu(folder).signal("resources/reference_output.csv")
    np.testing.assert_allclose(forces, expected, atol=1e-13)
    assert np.abs(expected).max() > 0.1


@pytest.mark.parametrize("name", ["KB", "effects", "space"])
@pytest.mark.parametrize(
    "other",
    [
        pytest.param("csharp_player", marks=with_mono),
        pytest.param("windows_player", marks=[pytest.mark.nightly, with_wine]),
    ],
)
def test_loaders_and_platforms_give_the_same_bits(other, name, fmus, player, request):
    """Under the reference, and under walks at rates that are the model's, faster, slower and uneven; parameters too."""
    folder, generator, other = fmus / name, np.random.default_rng(7), request.getfixturevalue(other)
    reference = folder / "resources" / "reference_input.csv"
    np.testing.assert_array_equal(other(folder, reference), player(folder, reference))
    for step in (0.01, 0.001, 0.03, None):
        steps = np.full(5000, step) if step else generator.uniform(0.0, 0.02, 5000)
        walk = generator.standard_normal((5000, 3 if name == "space" else 1))
        rows = np.column_stack([np.cumsum(steps), np.cumsum(walk, axis=0) * 0.1])
        np.testing.assert_array_equal(other(folder, rows), player(folder, rows))
    given = (folder, rows, "gain=0.5", "force_offset=1", "force_limit=2", "position_offset=0.25")
    np.testing.assert_array_equal(other(*given), player(*given))


@pytest.mark.parametrize("target", ["x86_64-windows", "aarch64-linux", "aarch64-darwin"])
def test_loaders_compile_for_other_platforms(target, zig_cache, tmp_path):
    assert compile_object(LOADERS / "play_fmu.c", target, tmp_path, zig_cache).stat().st_size > 1000


def cpp_program(source: Path, folder: Path) -> Path:
    """Compile a C++ program that uses the loader."""
    program = folder / source.stem
    flags = ["-std=c++11", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-I{LOADERS}", f"-I{STUBS}"]
    subprocess.run(["g++", *flags, source, "-o", program, "-ldl"], check=True)
    return program


@with_cpp
def test_cpp_loader_returns_forces_and_rejects_wrong_use(fmus, player, tmp_path):
    program = cpp_program(STUBS / "use_loader.cpp", tmp_path)
    printed = output_of(program, fmus / "KB", "KB.so", fmus / "old", fmus / "empty").splitlines()
    lines = [line.partition(": ")[::2] for line in printed]
    answers = dict(lines)
    numbers = [RANGE[name] for name in ("lowest", "highest", "speed", "lowest_Hz", "highest_Hz")]
    assert answers["described"] == " ".join(f"{value:g}" for value in (0.01, 1, 1, *numbers))
    assert answers["in range"] == "1 0"
    first, second = player(fmus / "KB", [[0.0, 0.0], [0.01, 1.0]])
    assert [float(item) for item in answers["forces"].split()] == [first, second, second]
    again = answers["again"].split()
    assert ([float(again[0]), float(again[1])], again[2:]) == ([first, second], ["limit", "5"])
    assert [answer for key, answer in lines if key == "loaded"] == ["1", "0"]
    logged = [answer for key, answer in lines if key == "log"]
    assert [line.partition(": ")[0] for line in logged] == ["fmi3SetFloat64"]
    for key, message in (
        ("back", "-1.01 s"),
        ("pause", "2.99 s"),
        ("no time", "time"),
        ("too much", "force_limit"),
        ("quietly too much", "force_limit"),
        ("no parameter", "stiffness"),
        ("an output", "parameter force"),
        ("no first position", "first position"),
        ("no folder", "absent/modelDescription.xml"),
        ("FMI 2.0", "<model>_fmi3.fmu"),
        ("no library", "(x86_64-linux)"),
    ):
        assert message in answers[key], key


@with_cpp
def test_chai3d_example_presses_into_tissue(fmus, player, tmp_path):
    """Against a stub of CHAI3D's headers: 200 ticks of 1 ms, forces out of the tissue within what the device can do."""
    program = cpp_program(LOADERS / "chai3d_tissue.cpp", tmp_path)
    *forces, released, closed = (line.split()[-1] for line in output_of(program, fmus / "KB").splitlines())
    time = np.arange(200) * 0.001
    depth = 2.0 * np.sin(0.01 * np.arange(200))
    expected = player(fmus / "KB", np.column_stack([time, depth]), "force_limit=8")
    np.testing.assert_allclose([float(force) for force in forces], expected, atol=1e-12)
    assert expected.max() > 1.0
    assert (float(released), closed) == (0.0, "closed")
    sent = [line.split() for line in output_of(program, fmus / "space").splitlines()[:-2]]
    moved = np.column_stack([np.sin(0.02 * np.arange(200)), np.zeros(200), -depth])
    expected = player(fmus / "space", np.column_stack([time, moved]), "force_limit=8")
    np.testing.assert_allclose(np.array(sent, dtype=float), -expected, atol=1e-12)
    assert np.abs(expected).max(axis=0).min() > 0.1


@with_mono
def test_unity_package_returns_forces_and_rejects_wrong_use(fmus, player, tmp_path):
    """Against stubs of Unity, with its symbol defined: sample, haptic thread, errors, a comma as decimal sign."""
    program = tmp_path / "unity.exe"
    sources = [*UNITY.rglob("*.cs"), STUBS / "UnityStubs.cs", STUBS / "UseUnityPackage.cs"]
    compile_csharp(program, sources, "-nowarn:0649,0414", "-define:UNITY_5_3_OR_NEWER")
    lines = output_of("mono", program, fmus, "KB.so", fmus / "old", fmus / "empty").splitlines()
    frames = np.array([line.split()[1:] for line in lines if line.startswith("frame ")], dtype=float)
    rows = np.column_stack([3.0 + 0.02 * np.arange(100), -1000.0 * frames[:, 0]])
    np.testing.assert_array_equal(frames[:, 1], player(fmus / "KB", rows))
    np.testing.assert_allclose(frames[:, 2], frames[:, 1], rtol=1e-6)
    frames = np.array([line.split()[1:] for line in lines if line.startswith("space ")], dtype=float)
    rows = np.column_stack([3.0 + 0.02 * np.arange(100), 1000.0 * frames[:, :3]])
    np.testing.assert_allclose(frames[:, 3:], -player(fmus / "space", rows), rtol=1e-6, atol=1e-6)
    first, second = player(fmus / "KB", [[0.0, 0.0], [0.01, 1.0]], "gain=2")
    answers = {line.split()[0]: line for line in lines}
    assert answers["callback"] == "callback True True"
    assert answers["again"] == f"again {first:.17g} {second:.17g} 2 5"
    assert [line for line in lines if line.startswith("loaded ")] == ["loaded False", "loaded False"]
    numbers = [RANGE[name] for name in ("lowest", "highest", "speed", "lowest_Hz", "highest_Hz")]
    described = answers["described"].split()
    assert described[2:6] == ["position", "mm", "force", "N"]
    assert [float(item) for item in (described[1], *described[6:])] == [0.01, 1, *numbers]
    assert answers["thread"] == "thread True 0 True"
    logged = [line for line in lines if line.startswith("log: ")]
    assert [line.split(": ")[1] for line in logged] == ["fmi3SetFloat64"]
    for start, error, token in (
        ("too much", "ArgumentOutOfRangeException", "force_limit"),
        ("no parameter", "ArgumentException", "stiffness"),
        ("back", "ArgumentException", "-1 s"),
        ("pause", "ArgumentException", "2 s .*0.25"),
        ("disposed", "ObjectDisposedException", ""),
        ("FMI 2.0", "NotSupportedException", "FMI 3.0"),
        ("several axes", "InvalidOperationException", "axes"),
        ("no library", "DllNotFoundException", "x86_64-linux"),
    ):
        assert any(re.match(rf"{start} {error}\b.*{token}", line) for line in lines), start


def test_unity_package_is_complete():
    """Unity ignores files of an installed package that have no .meta file, and samples that it does not list."""
    package = json.loads((UNITY / "package.json").read_text())
    assert re.fullmatch(r"[a-z0-9-]+(\.[a-z0-9-]+)+", package["name"])
    assert re.fullmatch(r"\d+\.\d+\.\d+", package["version"])
    assert all((UNITY / sample["path"]).is_dir() for sample in package["samples"])
    assembly = json.loads((UNITY / "Runtime" / "Lumbar.TissueForce.asmdef").read_text())
    assert assembly["name"] == "Lumbar.TissueForce"
    paths = (path for path in UNITY.rglob("*") if path.suffix != ".meta")
    shown = [path for path in paths if "~" not in str(path.relative_to(UNITY))]
    identities = [re.search(r"guid: ([0-9a-f]{32})", Path(f"{path}.meta").read_text())[1] for path in shown]
    assert len(set(identities)) == len(shown) == 5


def fmusim(fmu: Path, folder: Path, *options: str, step: str = "0.01") -> list:
    """Forces that fmusim, the FMI project's own simulator, records for the file's reference input, one per instant."""
    inputs = unzipped(fmu, folder / "fmu") / "resources" / "reference_input.csv"
    outputs = folder / "forces.csv"
    with inputs.open() as file:
        end = list(csv.DictReader(file))[-1]["time"]
    command = [FMUSIM, "simulate", "--input-file", inputs, "--output-file", outputs, "--stop-time", end]
    command += ["--output-interval", step, *options, fmu]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    with outputs.open() as file:  # at an event it records before and after: the last row of an instant counts
        return list({row["time"]: recorded_force(row) for row in csv.DictReader(file)}.values())


def recorded_force(row: dict[str, str]):
    """Force of a recorded row: a number, or the vector of an array or of scalars."""
    values = " ".join(text for name, text in row.items() if name.partition("[")[0] == "force").split()
    return float(values[0]) if len(values) == 1 else list(map(float, values))


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
@pytest.mark.parametrize("name", ["IL", "MW", "KB", "HO", "KB+coulomb_friction", EFFECTS["name"]])
def test_fmusim_validates_and_reads_the_embedded_references(
    name, version, options, reference, fmu_folder, tmp_path
):
    fmu = fmu_folder / f"{name}_fmi{version}.fmu"
    if name == EFFECTS["name"]:  # input and output forms with memory
        fmu = next(
            path for path in export([exported(EFFECTS)], tmp_path) if path.stem.endswith(f"fmi{version}")
        )
    subprocess.run([FMUSIM, "validate", fmu], check=True, capture_output=True)
    rows = contents(fmu)[f"resources/{reference}.csv"].decode().splitlines()[1:]
    read, expected = fmusim(fmu, tmp_path, *options), [float(row.split(",")[1]) for row in rows]
    assert read == pytest.approx(expected, rel=0, abs=1e-11)
    assert max(map(abs, expected)) > 1.0


@with_fmusim
@pytest.mark.parametrize(("version", "options"), [(2, []), (3, []), (3, ["--event-mode-used"])])
def test_fmusim_reads_vectors_of_an_independent_integration(version, options, tmp_path):
    export([spatial_export(FIVE)], tmp_path)
    (fmu,) = tmp_path.glob(f"*_fmi{version}.fmu")
    subprocess.run([FMUSIM, "validate", fmu], check=True, capture_output=True)
    read = np.array(fmusim(fmu, tmp_path, *options, step="0.001"))
    cells = (
        (tmp_path / "fmu" / "resources" / "reference_input.csv")
        .read_text()
        .replace(",", " ")
        .splitlines()[1:]
    )
    expected = integrated(np.array([row.split()[1:] for row in cells], dtype=float), 1e-3)
    if not options:
        expected = np.concatenate([expected[:1], expected[:-1]])
    assert np.abs(expected).max() > 1.0
    assert np.abs(read - expected).max() <= 1e-12 * np.abs(expected).max()
