"""Seeded defects of files: each is caught before the library is played, and VDMCheck2 agrees that sound ones are sound."""

import os
import re
import shutil
import subprocess
import warnings
import zipfile
from pathlib import Path

import pytest
from c_programs import ON_LINUX

from case_tables import cases
from lumbar.tissue.fmu.build.package import write_fmu
from lumbar.tissue.fmu.check.file_check import check_files
from lumbar.tissue.fmu.check.lint import open_fmu

pytestmark = ON_LINUX
DESCRIPTION = "modelDescription.xml"
BINARY = {2: "binaries/linux64/KB.so", 3: "binaries/x86_64-linux/KB.so"}
VDMCHECK = os.environ.get("VDMCHECK2", "")
"""Folder of VDMCheck2, as tests/get_vdmcheck.sh makes it."""


def edited(before: str, after: str, path: str = DESCRIPTION):
    """Return a defect that replaces text in one file."""

    def change(files: dict[str, bytes], version: int) -> None:
        changed = files[path].replace(before.encode(), after.encode())
        assert changed != files[path], f"{before} is not in {path}"
        files[path] = changed

    return change


def without(path: str):
    """Return a defect that takes a file away."""

    def change(files: dict[str, bytes], version: int) -> None:
        del files[BINARY[version] if path == "binary" else path]

    return change


def binary(change_bytes):
    """Return a defect of the library."""

    def change(files: dict[str, bytes], version: int) -> None:
        files[BINARY[version]] = change_bytes(files[BINARY[version]])

    return change


def moved(files: dict[str, bytes], version: int) -> None:
    """The library of Linux in the folder of Windows."""
    name = BINARY[version]
    folder = "win64" if version == 2 else "x86_64-windows"
    files[f"binaries/{folder}/KB.dll"] = files[name]


def retokened(files: dict[str, bytes], version: int) -> None:
    """A library with another model's token."""
    token = re.search(rb'(?:guid|instantiationToken)="([^"]+)"', files[DESCRIPTION]).group(1)
    assert token in files[BINARY[version]]
    files[BINARY[version]] = files[BINARY[version]].replace(token, token[::-1])


def escaping(files: dict[str, bytes], version: int) -> None:
    files["../evil.txt"] = b"x"


BOTH = {
    "another model's name": edited('modelIdentifier="KB"', 'modelIdentifier="KC"'),
    "identifier that C does not allow": edited('modelIdentifier="KB"', 'modelIdentifier="K-B"'),
    "missing binary": without("binary"),
    "binary of another platform": moved,
    "truncated binary": binary(lambda data: data[:1000]),
    "binary without FMI": binary(lambda data: data.replace(b"DoStep", b"NoStep")),
    "binary of another model": retokened,
    "no description": without(DESCRIPTION),
    "description cut off": edited("</ModelVariables>", ""),
    "entry that leaves the archive": escaping,
    "start above max": edited('start="15.0"', 'start="16.0"'),
    "nominal of zero": edited('nominal="1.0"', 'nominal="0.0"'),
    "bounds the wrong way round": edited('min="0.0" max="10.0"', 'min="20.0" max="10.0"'),
    "start that is no number": edited('start="1.0"', 'start="NaN"'),
    "nominal that is a word": edited('nominal="1.0"', 'nominal="one"'),
    "negative step": edited('stepSize="0.01"', 'stepSize="-0.01"'),
    "stop before start": edited('stopTime="10.0"', 'stopTime="-1.0"'),
    "input without start": edited('unit="mm" start="0.0"', 'unit="mm"'),
    "variable twice": edited('name="gain"', 'name="force_limit"'),
    "value reference twice": edited('valueReference="3"', 'valueReference="4"'),
    "unit that is not defined": edited('<Unit name="mm">', '<Unit name="furlong">'),
    "two outputs": edited(
        'causality="parameter" variability="tunable" initial="exact"', 'causality="output"'
    ),
    "no input": edited('causality="input"', 'causality="local"'),
    "dependency on nothing": edited('dependencies="', 'dependencies="99 '),
    "another version of FMI": edited('fmiVersion="', 'fmiVersion="1'),
    "no simulation": edited("CoSimulation", "Simulation"),
    "unknown attribute": edited("generationTool", "generatedBy"),
}
"""Defects of both versions' files."""
ONLY = {
    ("empty token", 2): edited('guid="', 'guid="" old="'),
    ("empty token", 3): edited('instantiationToken="', 'instantiationToken="" old="'),
    ("wrong token", 2): edited('guid="', 'guid="0'),
    ("wrong token", 3): edited('instantiationToken="', 'instantiationToken="0'),
    ("output without structure", 2): edited('<Unknown index="2"', '<Unknown index="1"'),
    ("output without structure", 3): edited('<Output valueReference="2"', '<Output valueReference="1"'),
    ("negative internal step", 3): edited('fixedInternalStepSize="0.01"', 'fixedInternalStepSize="-0.01"'),
    ("build description cut off", 3): edited("</BuildConfiguration>", "", "sources/buildDescription.xml"),
}
SAID = cases(__file__, "said")
"""Words of the sentence that tells a defect."""
CASES = [*((name, version, change) for name, change in BOTH.items() for version in (2, 3))] + [
    (name, version, change) for (name, version), change in ONLY.items()
]


def contents(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def validated(path: Path) -> list[str]:
    """Problems that fmpy's validation finds; a file that it cannot read counts as one."""
    from fmpy.validation import validate_fmu

    try:
        return list(validate_fmu(str(path)))
    except Exception as error:
        return [str(error)]


def vdmchecked(path: Path) -> list[str]:
    """Problems that VDMCheck2 finds."""
    command = ["java", "-jar", "vdmcheck2.jar", str(path)]
    done = subprocess.run(command, cwd=VDMCHECK, capture_output=True, text=True, check=False)
    lines = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
    return [] if lines and lines[-1].startswith("No errors found") else lines


@pytest.mark.parametrize(("name", "version", "change"), CASES, ids=[f"{n}-fmi{v}" for n, v, _ in CASES])
def test_defect_is_caught(name, version, change, fmu_folder, zig_cache, tmp_path):
    files = contents(fmu_folder / f"KB_fmi{version}.fmu")
    change(files, version)
    broken = tmp_path / f"KB_fmi{version}.fmu"
    write_fmu(broken, files)
    check = check_files([broken], zig_cache)[0]
    assert any(SAID.get(name, "") in problem for problem in check.problems), check.problems
    assert not check.played


def test_damaged_archives_are_caught(fmu_folder, tmp_path):
    whole = (fmu_folder / "KB_fmi2.fmu").read_bytes()
    middle = len(whole) // 2
    for index, damaged in enumerate(
        (b"", whole[:middle], whole[:middle] + bytes([whole[middle] ^ 255]) + whole[middle + 1 :])
    ):
        path = tmp_path / f"{index}.fmu"
        path.write_bytes(damaged)
        assert any("cannot be read" in problem for problem in open_fmu(path)[1])
    double = tmp_path / "double.fmu"
    double.write_bytes(whole)
    with warnings.catch_warnings(), zipfile.ZipFile(double, "a") as archive:
        warnings.simplefilter("ignore")
        archive.writestr(DESCRIPTION, "<other/>")
    assert any("stands twice" in problem for problem in open_fmu(double)[1])


@pytest.mark.parametrize("name", ["IL", "MW", "KB", "HO"])
@pytest.mark.parametrize("version", [2, 3])
def test_sound_files_pass_all_checks(name, version, fmu_folder):
    path = fmu_folder / f"{name}_fmi{version}.fmu"
    assert open_fmu(path)[1] == []
    assert validated(path) == []


@pytest.mark.skipif(
    shutil.which("java") is None or not VDMCHECK,
    reason="no VDMCheck2: apt-get install default-jre maven unzip, then tests/get_vdmcheck.sh FOLDER and set VDMCHECK2=FOLDER",
)
def test_vdmcheck_finds_nothing_in_sound_files_and_something_in_broken_ones(fmu_folder, tmp_path):
    for model in ("IL", "KB", "HO", "KB+coulomb_friction"):
        assert vdmchecked(fmu_folder / f"{model}_fmi2.fmu") == []
    caught = []
    for name in ("start above max", "variable twice", "value reference twice", "unit that is not defined"):
        files = contents(fmu_folder / "KB_fmi2.fmu")
        BOTH[name](files, 2)
        write_fmu(tmp_path / "KB_fmi2.fmu", files)
        caught += [name] if vdmchecked(tmp_path / "KB_fmi2.fmu") else []
    assert caught


def test_terminals_follow_the_standards_schema(fmu_folder):
    import fmpy
    from lxml import etree

    schema = etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "schema/fmi3/fmi3TerminalsAndIcons.xsd"))
    files = contents(fmu_folder / "KB_fmi3.fmu")
    schema.assertValid(etree.fromstring(files["terminalsAndIcons/terminalsAndIcons.xml"]))
    assert files["terminalsAndIcons/icon.png"].startswith(b"\x89PNG")
    assert contents(fmu_folder / "KB_fmi2.fmu")["model.png"].startswith(b"\x89PNG")
