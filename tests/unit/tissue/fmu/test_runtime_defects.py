"""Exported files have none of the faults that fmpy's validation misses; VDMCheck2 agrees that they are valid."""

import os
import re
import shutil
import subprocess
import zipfile
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

import pytest
from c_programs import ON_LINUX
from fmpy.validation import validate_fmu
from runtime_models import contents, export
from spatial_models import FIVE, spatial_export

pytestmark = ON_LINUX
DESCRIPTION = "modelDescription.xml"

VDMCHECK = os.environ.get("VDMCHECK2", "")
"""Folder of VDMCheck2, as tests/get_vdmcheck.sh makes it."""


def numbers(attributes: dict[str, str], key: str) -> list[float]:
    return [float(text) for text in attributes.get(key, "").split()]


def faults(files: dict[str, bytes]) -> list[str]:  # noqa: C901 - one fault after the other
    """Return the faults of a file whose description is valid by its schema."""
    root = ElementTree.fromstring(files[DESCRIPTION])
    simulation, problems = root.find("CoSimulation"), []
    token = root.get("guid") or root.get("instantiationToken")
    for name in (name for name in files if name.startswith("binaries/")):
        if PurePosixPath(name).stem != simulation.get("modelIdentifier"):
            problems.append(f"{name}: another model identifier")
        if token.encode() not in files[name]:
            problems.append(f"{name}: another token")
    listed = [item.get("name") for item in root.iterfind("CoSimulation/SourceFiles/File")]
    if "sources/buildDescription.xml" in files:
        build = ElementTree.fromstring(files["sources/buildDescription.xml"])
        listed = [item.get("name") for item in build.iter("SourceFile")]
    problems += [f"{name}: no such source" for name in listed if f"sources/{name}" not in files]
    if not listed:
        problems.append("no sources")
    steps = {**simulation.attrib, **root.find("DefaultExperiment").attrib}
    for key in ("stepSize", "fixedInternalStepSize"):
        if any(step <= 0 for step in numbers(steps, key)):
            problems.append(f"{key}: not above 0")
    for element in root.iterfind("ModelVariables/*"):
        typed = element.find("Real") if element.tag == "ScalarVariable" else element
        values = {} if typed is None else {**element.attrib, **typed.attrib}
        low, high = numbers(values, "min") or [-float("inf")], numbers(values, "max") or [float("inf")]
        if not all(low[0] <= start <= high[0] for start in numbers(values, "start")):
            problems.append(f"{values['name']}: start outside min and max")
        if any(nominal <= 0 for nominal in numbers(values, "nominal")):
            problems.append(f"{values['name']}: nominal not above 0")
    return problems


def test_exported_files_have_no_fault(fmu_folder, tmp_path):
    for path in [*fmu_folder.glob("*.fmu"), *export([spatial_export(FIVE)], tmp_path)]:
        assert validate_fmu(str(path)) == [], path.name
        assert faults(contents(path)) == [], path.name


def replaced(before: str, after: str, path: str = DESCRIPTION):
    def change(files: dict[str, bytes]) -> None:
        changed = re.sub(before.encode(), after.encode(), files[path], count=1)
        assert changed != files[path], f"{before} is not in {path}"
        files[path] = changed

    return change


def remove_source(files: dict[str, bytes]) -> None:
    del files["sources/fmi2.c"]


MISSED = {
    "start above max": (replaced('start="15.0"', 'start="16.0"'), "start outside"),
    "another token": (replaced('(guid|instantiationToken)="', r'\1="0'), "another token"),
    "another identifier": (
        replaced('modelIdentifier="KB"', 'modelIdentifier="KC"'),
        "another model identifier",
    ),
    "missing source": (remove_source, "no such source"),
    "nominal of zero": (replaced('nominal="1.0"', 'nominal="0.0"'), "nominal not above 0"),
    "negative step": (replaced('stepSize="0.01"', 'stepSize="-0.01"'), "stepSize: not above 0"),
    "negative internal step": (
        replaced('fixedInternalStepSize="0.01"', 'fixedInternalStepSize="-0.01"'),
        "fixedInternalStepSize: not above 0",
    ),
}
"""Faults that fmpy misses, at least in one version, and a part of the message of each."""


@pytest.mark.parametrize(
    ("fault", "version"),
    [(fault, version) for fault in MISSED for version in (2, 3)[fault == "negative internal step" :]],
)
def test_seeded_fault_is_detected(fault, version, fmu_folder):
    change, message = MISSED[fault]
    files = contents(fmu_folder / f"KB_fmi{version}.fmu")
    change(files)
    assert any(message in sentence for sentence in faults(files))


def vdmchecked(path: Path) -> list[str]:
    """Problems that VDMCheck2 finds."""
    command = ["java", "-jar", "vdmcheck2.jar", str(path)]
    done = subprocess.run(command, cwd=VDMCHECK, capture_output=True, text=True, check=False)
    lines = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
    return [] if lines and lines[-1].startswith("No errors found") else lines


@pytest.mark.skipif(
    shutil.which("java") is None or not VDMCHECK,
    reason="no VDMCheck2: apt-get install default-jre maven unzip, then tests/get_vdmcheck.sh FOLDER and set VDMCHECK2=FOLDER",
)
def test_vdmcheck_rejects_only_broken_files(fmu_folder, tmp_path):
    for model in ("IL", "KB", "HO", "KB+coulomb_friction"):
        assert vdmchecked(fmu_folder / f"{model}_fmi2.fmu") == []
    files = contents(fmu_folder / "KB_fmi2.fmu")
    MISSED["start above max"][0](files)
    with zipfile.ZipFile(tmp_path / "KB_fmi2.fmu", "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    assert vdmchecked(tmp_path / "KB_fmi2.fmu")


def test_terminals_follow_the_standards_schema(fmu_folder):
    import fmpy
    from lxml import etree

    schema = etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "schema/fmi3/fmi3TerminalsAndIcons.xsd"))
    files = contents(fmu_folder / "KB_fmi3.fmu")
    schema.assertValid(etree.fromstring(files["terminalsAndIcons/terminalsAndIcons.xml"]))
    assert files["terminalsAndIcons/icon.png"].startswith(b"\x89PNG")
    assert contents(fmu_folder / "KB_fmi2.fmu")["model.png"].startswith(b"\x89PNG")
