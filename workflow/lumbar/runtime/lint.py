"""Checks of a finished FMU that fmpy's validation leaves out: files, names, token, bounds."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path, PurePosixPath

_C_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def lint_fmu(path: Path) -> list[str]:
    """Return the problems found; an empty list for a sound FMU.

    Looks for: entries that leave the archive or stand twice; a model identifier that C does not allow or that
    the binaries do not have; a token that is not in the binaries; source files that are listed but missing; a
    start value outside min and max; a nominal value or a step size that is not positive; no documentation.
    """
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        files = {name: archive.read(name) for name in names}
    problems = _lint_names(names)
    if "modelDescription.xml" not in files:
        return [*problems, "there is no modelDescription.xml"]
    root = ElementTree.fromstring(files["modelDescription.xml"])
    if "documentation/index.html" not in files:
        problems.append("there is no documentation/index.html")
    simulation = root.find("CoSimulation")
    if simulation is None:
        return [*problems, "there is no CoSimulation element"]
    identifier = simulation.get("modelIdentifier", "")
    token = root.get("guid") or root.get("instantiationToken") or ""
    problems += _lint_binaries(files, identifier, token)
    problems += _lint_sources(files, simulation, identifier)
    problems += _lint_steps(root, simulation)
    for variable in _variables(root):
        problems += _lint_variable(*variable)
    return problems


def _lint_names(names: list[str]) -> list[str]:
    problems = [
        f"{name!r} stands twice in the archive" for name in sorted(set(names)) if names.count(name) > 1
    ]
    for name in names:
        if "\\" in name or PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
            problems.append(f"{name!r} leads out of the archive")
    return problems


def _lint_binaries(files: dict[str, bytes], identifier: str, token: str) -> list[str]:
    problems = []
    if not _C_IDENTIFIER.fullmatch(identifier):
        problems.append(f"modelIdentifier {identifier!r} is no C identifier")
    if not token:
        problems.append("the GUID or instantiation token is empty")
    binaries = [name for name in files if name.startswith("binaries/") and not name.endswith("/")]
    if not binaries:
        problems.append("there is no binary")
    for name in binaries:
        if PurePosixPath(name).stem != identifier:
            problems.append(f"{name} is not named after the modelIdentifier {identifier!r}")
        if token.encode() not in files[name]:
            problems.append(f"{name} does not hold the token {token!r}: it was built from something else")
    return problems


def _lint_sources(files: dict[str, bytes], simulation: ElementTree.Element, identifier: str) -> list[str]:
    problems = []
    listed = [file.get("name") for file in simulation.findall("SourceFiles/File")]
    if "sources/buildDescription.xml" in files:
        build = ElementTree.fromstring(files["sources/buildDescription.xml"])
        listed += [file.get("name") for file in build.iter("SourceFile")]
        for configuration in build.iter("BuildConfiguration"):
            if configuration.get("modelIdentifier") != identifier:
                problems.append(f"buildDescription.xml builds {configuration.get('modelIdentifier')!r}")
    if not listed:
        problems.append("no source files are listed")
    return problems + [
        f"the source file {name} is missing" for name in listed if f"sources/{name}" not in files
    ]


def _lint_steps(root: ElementTree.Element, simulation: ElementTree.Element) -> list[str]:
    steps = {"fixedInternalStepSize": simulation.get("fixedInternalStepSize")}
    experiment = root.find("DefaultExperiment")
    if experiment is not None:
        steps["stepSize"] = experiment.get("stepSize")
    return [
        f"{name} is {value}, not above 0" for name, value in steps.items() if value and not float(value) > 0
    ]


def _variables(root: ElementTree.Element):
    """Name and attributes of every variable, in both versions' layouts."""
    for element in root.find("ModelVariables"):
        typed = element.find("Real") if element.tag == "ScalarVariable" else element
        if typed is not None:
            yield element.get("name"), {**element.attrib, **typed.attrib}


def _lint_variable(name: str, attributes: dict[str, str]) -> list[str]:
    given = {key: float(attributes[key]) for key in ("min", "max", "start", "nominal") if key in attributes}
    problems = []
    low, high = given.get("min", float("-inf")), given.get("max", float("inf"))
    if not low <= high:
        problems.append(f"{name}: min {low:g} above max {high:g}")
    if "start" in given and not low <= given["start"] <= high:
        problems.append(f"{name}: start {given['start']:g} outside [{low:g}, {high:g}]")
    if "nominal" in given and not given["nominal"] > 0:
        problems.append(f"{name}: nominal {given['nominal']:g}, not above 0")
    return problems
