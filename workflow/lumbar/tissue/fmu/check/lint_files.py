"""Checks of the files in an FMU: names, binaries, sources, terminals and reference signals."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import PurePosixPath

from lumbar.tissue.fmu.build.compiler import TARGETS
from lumbar.tissue.fmu.conventions import REFERENCE, WITHOUT_EVENT_MODE

_UNIVERSAL = b"\xca\xfe\xba\xbe"
_MACHINES = {
    "x86_64-linux": lambda data: data[:4] == b"\x7fELF" and data[18:20] == b"\x3e\x00",
    "aarch64-linux": lambda data: data[:4] == b"\x7fELF" and data[18:20] == b"\xb7\x00",
    "x86_64-windows": lambda data: data[:2] == b"MZ" and _pe_machine(data) == b"\x64\x86",
    "x86_64-darwin": lambda data: data[:8] == b"\xcf\xfa\xed\xfe\x07\x00\x00\x01",
    "aarch64-darwin": lambda data: data[:8] == b"\xcf\xfa\xed\xfe\x0c\x00\x00\x01",
}
"""How a library of each target begins: ELF, PE and Mach-O."""
_FUNCTIONS = {"2.0": b"fmi2DoStep", "3.0": b"fmi3DoStep"}
_INCLUDE = re.compile(rb'^#include "([^"]+)"', re.MULTILINE)


def _pe_machine(data: bytes) -> bytes:
    start = int.from_bytes(data[0x3C:0x40], "little")
    return data[start + 4 : start + 6]


def lint_names(names: list[str]) -> list[str]:
    """Return problems of the entries' names."""
    problems = [
        f"{name!r} stands twice in the archive" for name in sorted(set(names)) if names.count(name) > 1
    ]
    for name in names:
        if "\\" in name or PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
            problems.append(f"{name!r} leads out of the archive")
    return problems


def lint_binaries(files: Mapping[str, bytes], identifier: str, token: str, version: str) -> list[str]:
    """Return problems of the libraries: name, platform, functions, token."""
    problems = [] if token else ["the GUID or instantiation token is empty"]
    binaries = [name for name in files if name.startswith("binaries/") and not name.endswith("/")]
    if not binaries:
        problems.append("there is no binary")
    folders = {target.fmi2 if version == "2.0" else target.fmi3: name for name, target in TARGETS.items()}
    for name in binaries:
        path, data = PurePosixPath(name), files[name]
        if path.stem != identifier:
            problems.append(f"{name} is not named after the modelIdentifier {identifier!r}")
        target = folders.get(path.parent.name)
        universal = path.parent.name == "darwin64" and data[:4] == _UNIVERSAL
        if target is None:
            problems.append(f"{name} is in a folder that no importer of FMI {version} looks into")
        elif not universal and not _MACHINES[target](data):
            problems.append(f"{name} is no library for {target}")
        if _FUNCTIONS.get(version, b"") not in data:
            problems.append(f"{name} has no {_FUNCTIONS[version].decode()}")
        if token.encode() not in data:
            problems.append(f"{name} does not hold the token {token!r}: it was built from something else")
    return problems


def _parsed(data: bytes, name: str, problems: list[str]) -> ElementTree.Element:
    """Return the root of a document; an empty one, and a problem more, where it is no XML."""
    try:
        return ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        problems.append(f"{name} is no XML: {error}")
        return ElementTree.Element("nothing")


def lint_sources(
    files: Mapping[str, bytes], simulation: ElementTree.Element, identifier: str, version: str
) -> list[str]:
    """Return problems of the sources: what is listed or included must be there."""
    problems = []
    listed = [file.get("name") for file in simulation.findall("SourceFiles/File")]
    if "sources/buildDescription.xml" in files:
        build = _parsed(files["sources/buildDescription.xml"], "buildDescription.xml", problems)
        listed += [file.get("name") for file in build.iter("SourceFile")]
        if any(item.get("compilerOptions") for item in build.iter()) or list(
            build.iter("PreprocessorDefinition")
        ):
            problems.append("buildDescription.xml has compiler options or definitions; the sources need none")
        for configuration in build.iter("BuildConfiguration"):
            if configuration.get("modelIdentifier") != identifier:
                problems.append(f"buildDescription.xml builds {configuration.get('modelIdentifier')!r}")
    elif version == "3.0":
        problems.append("there is no sources/buildDescription.xml")
    if not listed:
        problems.append("no source files are listed")
    problems += [f"the source file {name} is missing" for name in listed if f"sources/{name}" not in files]
    for name, data in files.items():
        if name.startswith("sources/"):
            for header in (match.decode() for match in _INCLUDE.findall(data)):
                if f"sources/{header}" not in files:
                    problems.append(f"{name} includes {header}, which is missing")
    return problems


def ports(variables: list[tuple[str, dict]]) -> dict[str, str]:
    """Return the names of input and force: the first output; others tell more of the simulation."""
    found: dict[str, str] = {}
    for name, attributes in variables:
        found.setdefault(attributes.get("causality", ""), name)
    return found


def lint_resources(
    files: Mapping[str, bytes], variables: list[tuple[str, dict]], version: str, step: float | None
) -> list[str]:
    """Return problems of terminals and reference signals: both name variables."""
    names = ports(variables)
    problems = []
    signals = [*zip(REFERENCE, ("input", "output"), strict=True)]
    if version == "3.0":
        signals.append((WITHOUT_EVENT_MODE, "output"))
    for path, causality in signals:
        expected = f"time,{names.get(causality)}"
        head = files.get(path, b"").split(b"\n", 1)[0].decode("utf-8", errors="replace")
        if path not in files:
            problems.append(f"there is no {path}")
        elif head != expected:
            problems.append(f"{path} begins with {head!r}, not {expected!r}")
    problems += _lint_signals({path: files[path] for path, _ in signals if path in files}, step)
    terminals = files.get("terminalsAndIcons/terminalsAndIcons.xml")
    if terminals is not None:
        known = {name for name, _ in variables}
        for member in _parsed(terminals, "terminalsAndIcons.xml", problems).iter("TerminalMemberVariable"):
            if member.get("variableName") not in known:
                problems.append(f"a terminal has {member.get('variableName')!r}, which is no variable")
    return problems


def _lint_signals(signals: Mapping[str, bytes], step: float | None) -> list[str]:
    """All reference signals are rows of two finite numbers, one row per step of the description."""
    problems = []
    for path, signal in signals.items():
        rows = [row.split(b",") for row in signal.splitlines()[1:]]
        try:
            numbers = [(float(time), float(value)) for time, value in rows]
        except ValueError:
            problems.append(f"{path} holds a row that is not two numbers")
            continue
        if len(numbers) < 2 or not all(math.isfinite(value) for row in numbers for value in row):
            problems.append(f"{path} holds less than two rows, or a number that is not finite")
            continue
        late = next(
            (k for k, (time, _) in enumerate(numbers) if step and abs(time - k * step) > 1e-6 * step), None
        )
        if late is not None:
            problems.append(
                f"{path} has row {late} at {numbers[late][0]:g} s; with stepSize {step:g} it must be at {late * step:g} s"
            )
    if len({len(signal.splitlines()) for signal in signals.values()}) > 1:
        problems.append("the reference signals differ in length")
    return problems
