"""Whether an FMU is sound in itself: archive, libraries, and numbers of its description that fmpy's validation leaves out."""

import math
import re
import xml.etree.ElementTree as ElementTree
import zipfile
from collections import Counter
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from lumbar.base.files import LARGEST_FILE
from lumbar.tissue.fmu.build.compiler import TARGETS

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


_MOST_FILES, _LONGEST_DESCRIPTION = 1000, 2_000_000
"""Files of an archive, and bytes of its description: far more than a model of forces has. The standard's schema may find a
fault in every ten, each told in a thousand."""
_MOST_TOLD = 12
"""Problems of a file: a record of another model alters everything."""
BROKEN_XML = (ElementTree.ParseError, LookupError, ValueError)
"""What its reader raises, of encodings that it does not know or that take several bytes too."""
_C_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def told(problems: list[str], of: str = "problems") -> tuple[str, ...]:
    """The first problems, and how many there are besides."""
    more = len(problems) - _MOST_TOLD
    return (*problems[:_MOST_TOLD], *([f"{more} more {of}"] if more > 0 else []))


def open_fmu(path: Path) -> tuple[dict[str, bytes], list[str]]:
    """Return an FMU's files by their paths, and the problems of the archive and of each file by itself.

    Looks for: a file that is no archive or is damaged; entries that leave the archive or stand twice; a description
    that is no XML or has another version; a model identifier that C does not allow or that the binaries do not have;
    binaries of another platform than their folder's, without FMI's functions or without the token; variables that stand
    twice, have a start value outside min and max, numbers that are not finite, a nominal value that is not positive, a unit
    that is not defined, or no place in the model structure; steps and stop times that are not positive. What files say of
    each other is for `lumbar.tissue.fmu.check.agreement`.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            if len(names) > _MOST_FILES:
                return {}, [f"the archive holds {len(names)} files; at most {_MOST_FILES} are read"]
            size = sum(item.file_size for item in archive.infolist())
            if size > LARGEST_FILE:
                return {}, [
                    f"the archive unpacks to {size / 1e6:.0f} MB; at most {LARGEST_FILE // 1_000_000} MB are read"
                ]
            files = {item.filename: _unpacked(archive, item) for item in archive.infolist()}
    except Exception as error:  # a broken archive leads to errors of many kinds
        return {}, [f"the archive cannot be read: {error}"]
    return files, _lint_names(names) + _lint_files(files)


def _unpacked(archive: zipfile.ZipFile, item: zipfile.ZipInfo) -> bytes:
    """A file of the archive; asked for no more than it is said to hold, Python unpacks no more."""
    with archive.open(item) as file:
        return file.read(item.file_size + 1)


def _lint_files(files: Mapping[str, bytes]) -> list[str]:
    if "modelDescription.xml" not in files:
        return ["there is no modelDescription.xml"]
    if len(files["modelDescription.xml"]) > _LONGEST_DESCRIPTION:
        return [f"modelDescription.xml is longer than {_LONGEST_DESCRIPTION // 1_000_000} MB"]
    try:
        root = ElementTree.fromstring(files["modelDescription.xml"])
    except BROKEN_XML as error:
        return [f"modelDescription.xml is no XML: {error}"]
    problems = []
    version, simulation = root.get("fmiVersion", ""), root.find("CoSimulation")
    if version not in ("2.0", "3.0"):
        problems.append(f"fmiVersion is {version!r}, neither 2.0 nor 3.0")
    if simulation is None:
        return [*problems, "there is no CoSimulation element"]
    identifier = simulation.get("modelIdentifier", "")
    token = root.get("guid" if version == "2.0" else "instantiationToken", "")
    if not _C_IDENTIFIER.fullmatch(identifier):
        problems.append(f"modelIdentifier {identifier!r} is no C identifier")
    problems += _lint_binaries(files, identifier, token, version)
    return [*problems, *_lint_steps(root, simulation), *_lint_variables(list(_variables(root)), root)]


def _pe_machine(data: bytes) -> bytes:
    start = int.from_bytes(data[0x3C:0x40], "little")
    return data[start + 4 : start + 6]


def _lint_names(names: list[str]) -> list[str]:
    """Problems of the entries' names."""
    problems = [
        f"{name!r} stands twice in the archive" for name in sorted(set(names)) if names.count(name) > 1
    ]
    for name in names:
        if "\\" in name or PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
            problems.append(f"{name!r} leads out of the archive")
    return problems


def _lint_binaries(files: Mapping[str, bytes], identifier: str, token: str, version: str) -> list[str]:
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


def _numbers(attributes: dict[str, str], keys: tuple[str, ...]) -> tuple[dict[str, float], list[str]]:
    """Return the attributes that are finite numbers, and words on those that are not."""
    given, problems = {}, []
    for key in keys:
        if key in attributes:
            try:  # of an array the value that is farthest from 0
                given[key] = max(map(float, attributes[key].split()), key=abs)
            except ValueError:
                given[key] = math.nan
            if not math.isfinite(given[key]):
                problems.append(f"{key} is {attributes[key]}, no finite number")
                del given[key]
    return given, problems


def _lint_steps(root: ElementTree.Element, simulation: ElementTree.Element) -> list[str]:
    """Return words on steps and times that cannot be."""
    experiment = root.find("DefaultExperiment")
    attributes = {**simulation.attrib, **(experiment.attrib if experiment is not None else {})}
    names = ("stepSize", *(["fixedInternalStepSize"] if root.get("fmiVersion") == "3.0" else []))
    given, problems = _numbers(attributes, (*names, "startTime", "stopTime"))
    problems += [f"there is no {key}" for key in names if key not in attributes]
    problems += [f"{key} is {given[key]:g}, not above 0" for key in names if not given.get(key, 1.0) > 0]
    if not given.get("startTime", 0.0) < given.get("stopTime", math.inf):
        problems.append(f"stopTime {given['stopTime']:g} is not after startTime")
    return problems


def _variables(root: ElementTree.Element):
    """Name and attributes of every variable, in both versions' layouts."""
    for element in root.iterfind("ModelVariables/*"):
        typed = element.find("Real") if element.tag == "ScalarVariable" else element
        if typed is not None:
            yield element.get("name", ""), {**element.attrib, **typed.attrib}


def _lint_variables(variables: list[tuple[str, dict]], root: ElementTree.Element) -> list[str]:
    problems = []
    for label, values in (
        ("the name", [name for name, _ in variables]),
        ("the value reference", [attributes.get("valueReference", "") for _, attributes in variables]),
    ):
        problems += [
            f"{label} {value!r} stands twice" for value, count in Counter(values).items() if count > 1
        ]
    # Scalars named position[1], … are one input.
    kinds = {(attributes.get("causality"), name.partition("[")[0]) for name, attributes in variables}
    causalities = Counter(kind for kind, _ in kinds)
    if causalities["input"] != 1:
        problems.append(f"there are {causalities['input']} inputs; a force model has one")
    if not causalities["output"]:
        problems.append("there is no output; a force model has one")
    units = {unit.get("name") for unit in root.iterfind("UnitDefinitions/Unit")}
    for name, attributes in variables:
        problems += _lint_variable(name, attributes)
        if attributes.get("unit", next(iter(units), None)) not in units:
            problems.append(f"{name}: the unit {attributes['unit']!r} is not defined")
    return problems + _lint_structure(variables, root)


def _lint_structure(variables: list[tuple[str, dict]], root: ElementTree.Element) -> list[str]:
    """Every output stands in the model structure, and nothing there refers to what does not exist."""
    if root.get("fmiVersion") == "2.0":
        known = {str(index): name for index, (name, _) in enumerate(variables, start=1)}
        outputs = [item.get("index") for item in root.iterfind("ModelStructure/Outputs/Unknown")]
    else:
        known = {attributes.get("valueReference"): name for name, attributes in variables}
        outputs = [item.get("valueReference") for item in root.iterfind("ModelStructure/Output")]
    structure = root.find("ModelStructure")
    named = [text for item in structure.iter() for text in item.get("dependencies", "").split()]
    problems = [
        f"the model structure names {number}, which is no variable"
        for number in dict.fromkeys([*outputs, *named])
        if number not in known
    ]
    missing = {name for name, attributes in variables if attributes.get("causality") == "output"}
    missing -= {known.get(number) for number in outputs}
    return problems + [f"the output {name} is not in the model structure" for name in sorted(missing)]


def _lint_variable(name: str, attributes: dict[str, str]) -> list[str]:
    given, unsound = _numbers(attributes, ("min", "max", "start", "nominal"))
    problems = [f"{name}: {text}" for text in unsound]
    low, high = given.get("min", -math.inf), given.get("max", math.inf)
    if not low <= high:
        problems.append(f"{name}: min {low:g} above max {high:g}")
    elif "start" in given and not low <= given["start"] <= high:
        problems.append(f"{name}: start {given['start']:g} outside [{low:g}, {high:g}]")
    if "start" not in attributes and attributes.get("causality") in ("input", "parameter"):
        problems.append(f"{name}: no start value")
    if not given.get("nominal", 1.0) > 0:
        problems.append(f"{name}: nominal {given['nominal']:g}, not above 0")
    return problems
