"""The loaders of examples/haptic_runtime: compiled, run on exported FMUs at any rate, and misused."""

import json
import os
import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest
from c_programs import ON_LINUX, WINE, loader_program, with_wine, zig_cc
from runtime_models import RANGE, TARGET
from spatial_models import FIVE, spatial_export

from lumbar.tissue.fmu.build.compiler import TARGETS, compile_library
from lumbar.tissue.fmu.build.package import export_fmus
from lumbar.tissue.fmu.build.sources import C_FILES
from running import PROJECT

pytestmark = ON_LINUX
LOADERS = PROJECT / "examples" / "haptic_runtime"
STUBS = PROJECT / "tests" / "loaders"
UNITY = LOADERS / "unity"
with_mono = pytest.mark.skipif(
    shutil.which("mcs") is None or shutil.which("mono") is None,
    reason="no C# compiler: apt-get install mono-mcs mono-runtime libmono-system-xml4.0-cil",
)
with_cpp = pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler: apt-get install g++")


@pytest.fixture(scope="module")
def unzipped(fmu_folder, tmp_path_factory, zig_cache):
    """Return a folder with unzipped FMUs: KB for FMI 3.0, ``old`` for FMI 2.0, ``empty`` without a library, ``space``."""
    folder = tmp_path_factory.mktemp("unzipped")
    for name, file in (
        ("KB", "KB_fmi3"),
        ("old", "KB_fmi2"),
        ("empty", "KB_fmi3"),
        ("effects", "KB+coulomb_friction_fmi3"),
    ):
        with zipfile.ZipFile(fmu_folder / f"{file}.fmu") as archive:
            archive.extractall(folder / name)
    shutil.rmtree(folder / "empty" / "binaries")
    (made, *_) = export_fmus([spatial_export(FIVE)], folder, "own", TARGET, zig_cache, versions=["3.0"])
    with zipfile.ZipFile(made) as archive:
        archive.extractall(folder / "space")
    return folder


@pytest.fixture(scope="module")
def player(zig_cache, tmp_path_factory):
    """Return a function that plays rows of time and position through the loader in C."""
    program = loader_program(
        LOADERS / "play_fmu.c", "x86_64-linux", tmp_path_factory.mktemp("player"), zig_cache
    )
    return lambda *arguments: played([program], *arguments)


def played(command: list, folder: Path, rows, *parameters: str, environment=None) -> np.ndarray:
    """Forces that a player prints for rows of time and position, or for a file of them."""
    file = rows
    if not isinstance(rows, Path):
        file = folder.parent / "rows.csv"
        lines = [
            " ".join(f"{value:.17g}" for value in row).replace(" ", ",", 1)
            for row in np.asarray(rows).tolist()
        ]
        file.write_text("\n".join(["time,position", *lines]))
    command = [*command, folder, file, *parameters]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    head, *lines = done.stdout.splitlines()
    assert head == "time,position,force"
    forces = np.array([line.split(",")[2].split() for line in lines], dtype=float)
    return forces[:, 0] if forces.shape[1] == 1 else forces


def signal(folder: Path, name: str) -> np.ndarray:
    """Time and value of a reference signal."""
    text = (folder / "resources" / f"reference_{name}.csv").read_text().replace(",", " ")
    return np.array([line.split() for line in text.splitlines()[1:]], dtype=float)


@pytest.fixture(scope="module")
def csharp_player(tmp_path_factory):
    """Return the same for the loader in C#."""
    program = tmp_path_factory.mktemp("csharp") / "play.exe"
    sources = [LOADERS / "PlayFmu.cs", UNITY / "Runtime" / "TissueForce.cs"]
    subprocess.run(
        ["mcs", "-warn:4", "-warnaserror", f"-out:{program}", "-r:System.Xml", *sources], check=True
    )
    return lambda *arguments: played(["mono", program], *arguments)


@pytest.fixture(scope="module")
def windows_player(unzipped, zig_cache, tmp_path_factory):
    """Return the same for the loader in C as a program of Windows."""
    platform = TARGETS["x86_64-windows"]
    for fmu in (unzipped / "KB", unzipped / "effects", unzipped / "space"):
        (native,) = (fmu / "binaries" / "x86_64-linux").iterdir()
        library = fmu / "sources" / f"{native.stem}{platform.suffix}"
        compile_library([library.parent / name for name in C_FILES], library, "x86_64-windows", zig_cache)
        place = fmu / "binaries" / platform.fmi3
        place.mkdir()
        shutil.move(library, place / library.name)
    folder = tmp_path_factory.mktemp("windows")
    program = loader_program(LOADERS / "play_fmu.c", "x86_64-windows", folder, zig_cache)
    environment = {**os.environ, "WINEPREFIX": str(folder / "wine"), "WINEDEBUG": "-all"}
    # Wine's first run makes its folder, and says so.
    subprocess.run([WINE, program], env=environment, check=False, capture_output=True)
    return lambda *arguments: played([WINE, program], *arguments, environment=environment)


@pytest.mark.parametrize("name", ["KB", "effects", "space"])
def test_the_embedded_reference_is_played(name, unzipped, player):
    folder = unzipped / name
    forces = player(folder, folder / "resources" / "reference_input.csv")
    expected = signal(folder, "output")[:, 1:].squeeze()
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
def test_loaders_and_platforms_give_the_same_bits(other, name, unzipped, player, request):
    """Under the reference, and under walks at rates that are the model's, faster, slower and uneven; parameters too."""
    folder, generator, other = unzipped / name, np.random.default_rng(7), request.getfixturevalue(other)
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
    flags = ["-c", "-Wall", "-Wextra", "-Werror", "-target", TARGETS[target].triple]
    zig_cc(["-std=c99", *flags, str(LOADERS / "play_fmu.c"), "-o", "play.o"], tmp_path, zig_cache)
    assert (tmp_path / "play.o").stat().st_size > 1000


def cpp_program(source: Path, folder: Path) -> Path:
    """Compile a C++ program that uses the loader."""
    program = folder / source.stem
    flags = ["-std=c++11", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-I{LOADERS}", f"-I{STUBS}"]
    subprocess.run(["g++", *flags, source, "-o", program, "-ldl"], check=True)
    return program


@with_cpp
def test_the_loader_in_cpp_answers_right_and_wrong_use(unzipped, player, tmp_path):
    program = cpp_program(STUBS / "use_loader.cpp", tmp_path)
    command = [program, unzipped / "KB", "KB.so", unzipped / "old", unzipped / "empty"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    said = [line.partition(": ")[::2] for line in done.stdout.splitlines()]
    answers = dict(said)
    numbers = [RANGE[name] for name in ("lowest", "highest", "speed", "lowest_Hz", "highest_Hz")]
    assert answers["described"] == " ".join(f"{value:g}" for value in (0.01, 1, 1, *numbers))
    assert answers["in range"] == "1 0"
    first, second = player(unzipped / "KB", [[0.0, 0.0], [0.01, 1.0]])
    assert [float(item) for item in answers["forces"].split()] == [first, second, second]
    again = answers["again"].split()
    assert ([float(again[0]), float(again[1])], again[2:]) == ([first, second], ["limit", "5"])
    assert [answer for key, answer in said if key == "loaded"] == ["1", "0"]
    assert [answer for key, answer in said if key == "log"] == [
        "fmi3SetFloat64: the value is outside min and max; not set."
    ]
    for key, words in (
        ("back", "-1.01 s since the last step"),
        ("pause", "2.99 s since the last step"),
        ("no time", "the time is not finite"),
        ("too much", "does not allow this value of force_limit"),
        ("quietly too much", "does not allow this value of force_limit"),
        ("no parameter", "no parameter stiffness"),
        ("an output", "no parameter force"),
        ("no first position", "the first position is not finite"),
        ("no folder", "cannot read absent/modelDescription.xml"),
        ("FMI 2.0", "unzip <model>_fmi3.fmu"),
        ("no library", "no library for this platform (x86_64-linux)"),
    ):
        assert words in answers[key], key


@with_cpp
def test_the_chai3d_example_presses_into_tissue(unzipped, player, tmp_path):
    """Against a stub of CHAI3D's headers: 200 ticks of 1 ms, forces out of the tissue within what the device can do."""
    program = cpp_program(LOADERS / "chai3d_tissue.cpp", tmp_path)
    done = subprocess.run([program, unzipped / "KB"], capture_output=True, text=True, check=True)
    *forces, released, closed = (line.split()[-1] for line in done.stdout.splitlines())
    time = np.arange(200) * 0.001
    depth = 2.0 * np.sin(0.01 * np.arange(200))
    expected = player(unzipped / "KB", np.column_stack([time, depth]), "force_limit=8")
    np.testing.assert_allclose([float(force) for force in forces], expected, atol=1e-12)
    assert expected.max() > 1.0
    assert (float(released), closed) == (0.0, "closed")
    done = subprocess.run([program, unzipped / "space"], capture_output=True, text=True, check=True)
    sent = np.array([line.split() for line in done.stdout.splitlines()[:-2]], dtype=float)
    moved = np.column_stack([np.sin(0.02 * np.arange(200)), np.zeros(200), -depth])
    expected = player(unzipped / "space", np.column_stack([time, moved]), "force_limit=8")
    np.testing.assert_allclose(sent, -expected, atol=1e-12)
    assert np.abs(expected).max(axis=0).min() > 0.1


@with_mono
def test_the_unity_package_answers_right_and_wrong_use(unzipped, player, tmp_path):
    """Against stubs of Unity, with its symbol defined: sample, haptic thread, errors, a comma as decimal sign."""
    program = tmp_path / "unity.exe"
    sources = [*UNITY.rglob("*.cs"), STUBS / "UnityStubs.cs", STUBS / "UseUnityPackage.cs"]
    flags = [
        "-warn:4",
        "-warnaserror",
        "-nowarn:0649,0414",
        "-define:UNITY_5_3_OR_NEWER",
        f"-out:{program}",
        "-r:System.Xml",
    ]
    subprocess.run(["mcs", *flags, *sources], check=True)
    command = ["mono", program, unzipped, "KB.so", unzipped / "old", unzipped / "empty"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    frames = np.array([line.split()[1:] for line in lines if line.startswith("frame ")], dtype=float)
    rows = np.column_stack([3.0 + 0.02 * np.arange(100), -1000.0 * frames[:, 0]])
    np.testing.assert_array_equal(frames[:, 1], player(unzipped / "KB", rows))
    np.testing.assert_allclose(frames[:, 2], frames[:, 1], rtol=1e-6)
    frames = np.array([line.split()[1:] for line in lines if line.startswith("space ")], dtype=float)
    rows = np.column_stack([3.0 + 0.02 * np.arange(100), 1000.0 * frames[:, :3]])
    np.testing.assert_allclose(frames[:, 3:], -player(unzipped / "space", rows), rtol=1e-6, atol=1e-6)
    first, second = player(unzipped / "KB", [[0.0, 0.0], [0.01, 1.0]], "gain=2")
    answers = {line.split()[0]: line for line in lines}
    assert answers["callback"] == "callback True True"
    assert answers["again"] == f"again {first:.17g} {second:.17g} 2 5"
    assert [line for line in lines if line.startswith("loaded ")] == ["loaded False", "loaded False"]
    numbers = [RANGE[name] for name in ("lowest", "highest", "speed", "lowest_Hz", "highest_Hz")]
    described = answers["described"].split()
    assert described[2:6] == ["position", "mm", "force", "N"]
    assert [float(item) for item in (described[1], *described[6:])] == [0.01, 1, *numbers]
    assert answers["thread"] == "thread True 0 True"
    assert [line for line in lines if line.startswith("log: ")] == [
        "log: fmi3SetFloat64: the value is outside min and max; not set."
    ]
    for start, words in (
        (
            "too much",
            "ArgumentOutOfRangeException: modelDescription.xml does not allow this value of force_limit",
        ),
        ("no parameter", "ArgumentException: the FMU has no variable stiffness"),
        ("back", "ArgumentException: -1 s since the last step"),
        ("pause", "ArgumentException: 2 s since the last step; 0 to 0.25 are allowed. Are they seconds?"),
        ("disposed", "ObjectDisposedException"),
        ("FMI 2.0", "NotSupportedException: not an FMU of FMI 3.0"),
        ("several axes", "InvalidOperationException: the model has several axes"),
        ("no library", "DllNotFoundException: the FMU has no library for x86_64-linux"),
    ):
        assert any(line.startswith(f"{start} {words}") for line in lines), start


def test_the_unity_package_is_one():
    """Unity ignores files of an installed package that have no .meta file, and samples that it does not list."""
    package = json.loads((UNITY / "package.json").read_text())
    assert re.fullmatch(r"[a-z0-9-]+(\.[a-z0-9-]+)+", package["name"])
    assert re.fullmatch(r"\d+\.\d+\.\d+", package["version"])
    assert all((UNITY / sample["path"]).is_dir() for sample in package["samples"])
    assembly = json.loads((UNITY / "Runtime" / "Lumbar.TissueForce.asmdef").read_text())
    assert assembly["name"] == "Lumbar.TissueForce"
    shown = [
        path
        for path in UNITY.rglob("*")
        if "~" not in str(path.relative_to(UNITY)) and path.suffix != ".meta"
    ]
    identities = [re.search(r"guid: ([0-9a-f]{32})", Path(f"{path}.meta").read_text())[1] for path in shown]
    assert len(set(identities)) == len(shown) == 5
