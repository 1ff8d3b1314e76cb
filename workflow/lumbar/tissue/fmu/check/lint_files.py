"""Checks of an FMU's files: names, binaries, sources, terminals, and numbers that it tells more than once."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from html import unescape
from pathlib import PurePosixPath
from xml.etree.ElementTree import Element

from lumbar.tissue.fmu.build.compiler import TARGETS
from lumbar.tissue.fmu.conventions import REFERENCE, WITHOUT_EVENT_MODE, base_unit

_UNIVERSAL = b"\xca\xfe\xba\xbe"
_MACHINES = {
    "x86_64-linux": lambda data: data[:4] == b"\x7fELF" and data[18:20] == b"\x3e\x00",
    "aarch64-linux": lambda data: data[:4] == b"\x7fELF" and data[18:20] == b"\xb7\x00",
    "x86_64-windows": lambda data: data[:2] == b"MZ" and _pe_machine(data) == b"\x64\x86",
    "x86_64-darwin": lambda data: data[:8] == b"\xcf\xfa\xed\xfe\x07\x00\x00\x01",
    "aarch64-darwin": lambda data: data[:8] == b"\xcf\xfa\xed\xfe\x0c\x00\x00\x01",
    "wasm32-wasi": lambda data: data[:4] == b"\0asm",
}
"""How a library of each target begins: ELF, PE, Mach-O and WebAssembly."""
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


_CONSTANT = re.compile(r"\.(\w+) = ([^,\s}\\]+)")
_ROW = re.compile(r"<tr>((?:<td>[^<]*</td>)+)</tr>")
_CELL = re.compile(r"<td>([^<]*)</td>")


def model_constants(files: Mapping[str, bytes]) -> dict[str, str]:
    """Return the constants of ``sources/model_data.h`` by name, as they are written, and the moving average as ``window``."""
    data, size = (
        files.get(f"sources/{name}", b"").decode("utf-8", errors="replace")
        for name in ("model_data.h", "model_size.h")
    )
    constants = dict(_CONSTANT.findall(data[data.find("MODEL_CONSTANTS") :]))
    window = re.search(r"#define MODEL_WINDOW (\d+)", size + data)
    return {**constants, "window": window[1]} if window else constants


def lint_constants(
    files: Mapping[str, bytes], variables: list[tuple[str, dict]], steps: Mapping[str, float]
) -> list[str]:
    """Return where description and sources say different numbers.

    Parameters
    ----------
    variables : list of tuple
        Name and attributes.
    steps : mapping of str to float
        Numbers of the description that are the sampling time, by attribute.
    """
    constants, given = model_constants(files), dict(variables)
    source, force = (ports(variables).get(causality, "") for causality in ("input", "output"))
    told = [(key, value, "sampling_time") for key, value in steps.items()]
    for name, attribute, constant, sign in (
        (source, "start", "input_offset", 1),
        (f"{source}_offset", "start", "input_offset", 1),
        (f"{force}_offset", "start", "output_offset", 1),
        (f"{force}_limit", "start", "output_limit", 1),
        (f"{force}_limit", "max", "output_limit", 1),
        (force, "max", "output_limit", 1),
        (force, "min", "output_limit", -1),
        ("gain", "max", "gain_limit", 1),
    ):
        try:
            value = sign * float(given.get(name, {})[attribute])
        except (KeyError, ValueError):
            continue  # told by the lint of the variables
        told.append((f"{name}: {attribute}", value, constant))
    problems = []
    for place, value, constant in told:
        try:
            expected = float.fromhex(constants[constant])
        except (KeyError, ValueError):
            problems.append(f"sources/model_data.h has no number {constant}")
            continue
        if value != expected:
            problems.append(f"{place} is {value!r}; the sources have {constant} {expected!r}")
    return list(dict.fromkeys(problems))


def lint_units(root: Element) -> list[str]:
    """Return the units that are defined otherwise than by their names."""
    problems = []
    for unit in root.iterfind("UnitDefinitions/Unit"):
        name, base = unit.get("name", ""), unit.find("BaseUnit")
        known = base_unit(name)
        if known is None:
            continue
        try:
            found = {key: float(value) for key, value in base.attrib.items()} if base is not None else {}
        except ValueError:
            found = {}
        if found != known:
            problems.append(f"the unit {name} is defined as {_words(found)}; it is {_words(known)}")
    return problems


def _words(base: Mapping[str, float]) -> str:
    return " ".join(f"{key}={value:g}" for key, value in base.items()) or "nothing"


def lint_references(variables: list[tuple[str, dict]]) -> list[str]:
    """Return names that do not stand at their place in the library: the enumeration of ``sources/sampled_force.h``."""
    source, force = (ports(variables).get(causality, "") for causality in ("input", "output"))
    guards = (f"{force}_rate_limit", "device_damping", "energy_reserve", "energy")
    places = ("time", source, force, "gain", f"{force}_offset", f"{force}_limit", f"{source}_offset", *guards)
    expected = {name: str(place) for place, name in enumerate(places)}
    return [
        f"{name}: its value reference is {attributes.get('valueReference')}; in the sources it is {expected[name]}"
        for name, attributes in variables
        if name in expected and attributes.get("valueReference") != expected[name]
    ]


def lint_page(files: Mapping[str, bytes], root: Element, variables: list[tuple[str, dict]]) -> list[str]:
    """Return where ``documentation/index.html`` tells other numbers than the description and the sources."""
    page = files.get("documentation/index.html", b"").decode("utf-8", errors="replace")
    if not page:
        return []  # told as a missing file
    title = f"<title>{root.get('modelName')} (FMI {root.get('fmiVersion')})</title>"
    if title not in unescape(page):
        return [f"documentation/index.html is another FMU's; {title} is needed"]
    problems = []
    rows = {cells[0]: cells[1:6] for cells in map(_CELL.findall, _ROW.findall(page))}
    for name, attributes in variables:
        if attributes.get("causality") == "independent":
            continue
        expected = [attributes.get("causality", ""), attributes.get("unit", "1")]
        expected += [
            f"{float(attributes[key]):g}" if key in attributes else "–" for key in ("start", "min", "max")
        ]
        if rows.get(name) != expected:
            found = ", ".join(rows.get(name, [])) or "nothing"
            problems.append(
                f"{name}: documentation/index.html has {found}; modelDescription.xml has {', '.join(expected)} "
                "(kind, unit, start, min, max)"
            )
    samples = re.search(r"mean of the last (\d+) samples", page)
    window = samples[1] if samples else "1"
    sizes = files.get("sources/model_size.h", b"").decode("utf-8", errors="replace")
    sized = re.search(r"#define MODEL_WINDOW (\d+)", sizes)
    if sized and window != sized[1]:
        problems.append(
            f"documentation/index.html says a moving average of {window} samples; the sources have {sized[1]}"
        )
    step = re.search(r"samples its input every ([0-9.e+-]+) s", page)
    told = root.find("DefaultExperiment")
    expected_step = told.get("stepSize", "") if told is not None else ""
    if step is None or float(step[1]) != float(f"{float(expected_step or 0):g}"):
        problems.append(
            f"documentation/index.html says a sampling time of {step[1] if step else 'nothing'} s; it is {expected_step} s"
        )
    return problems
